"""Draw pictures of a scene: the triangles that a camera sees, their depths and their colours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from radartwin.scene.raster import drawn_faces
from radartwin.scene.scene import Scene
from radartwin.scene.textures import texture

UNCOLOURED = 200.0  # grey level (0 to 255) of a mesh without colours
BACKGROUND = 255.0
# brightness at grazing incidence, relative to normal incidence; larger for scan colours, which already contain shading
COLOURED_SHADE, UNCOLOURED_SHADE = 0.8, 0.35


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera: camera-to-world pose (4, 4) (x right, y down, z forward), intrinsics (3, 3), width and height in pixels."""

    pose: np.ndarray
    intrinsics: np.ndarray
    width: int
    height: int

    def part(self, left: float, top: float, right: float, bottom: float, width: int, height: int) -> Camera:
        """Return the camera that shows a rectangle of this camera's picture, with a picture size of `width` x `height` pixels.

        The rectangle's edges are in pixels of this camera's picture, whose first pixel starts at -0.5.
        """
        scale = np.diag([width / (right - left), height / (bottom - top), 1.0])
        shift = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]])
        centre = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1.0]])
        return Camera(self.pose, centre @ scale @ shift @ self.intrinsics, width, height)

    def widened(self, field_deg: float) -> Camera:
        """Return the same camera with a field of view of `field_deg` degrees and a square picture."""
        intrinsics = self.intrinsics.copy()
        intrinsics[0, 0] = intrinsics[1, 1] = self.width / (2 * np.tan(np.radians(field_deg) / 2))
        return Camera(self.pose, intrinsics, self.width, self.height)

    @classmethod
    def looking(cls, eye: np.ndarray, target: np.ndarray, field_deg: float, size: int) -> Camera:
        """Return an upright camera at the point `eye` (3,) that looks at the point `target` (3,), with a picture of `size` x `size`
        pixels.
        """
        forward = (target - eye) / np.linalg.norm(target - eye)
        up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.99 else np.array([1.0, 0.0, 0.0])
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :4] = np.column_stack([right, np.cross(forward, right), forward, eye])
        focal = size / (2 * np.tan(np.radians(field_deg) / 2))
        middle = (size - 1) / 2
        return cls(pose, np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1.0]]), size, size)


@dataclass(frozen=True, eq=False)
class Seen:
    """The visible triangle of each pixel: `face` (h, w) is its index (-1: none), `depth` (h, w) its depth along the camera axis (inf:
    none).
    """

    face: np.ndarray
    depth: np.ndarray


class Triangles:
    """The triangles of several surfaces: vertices (V, 3), faces (F, 3) sorted by surface, and the surface index of each face (F,)."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, surface: np.ndarray, surfaces: int) -> None:
        self.vertices, self.faces, self.surface = vertices, faces, surface
        self.first_face = np.searchsorted(surface, np.arange(surfaces + 1))
        corners = vertices[faces]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.area = np.linalg.norm(cross, axis=1) / 2
        self.normal = cross / np.maximum(2 * self.area, 1e-300)[:, None]

    def of(self, index: int) -> slice:
        """Return the slice of the face array that holds the faces of the surface with this index."""
        return slice(self.first_face[index], self.first_face[index + 1])

    def seen(self, camera: Camera) -> Seen:
        """Find the triangle that each pixel of a camera shows."""
        triangles, order = self._local(camera)[self.faces], np.arange(len(self.faces))
        return Seen(*drawn_faces(triangles, order, camera.intrinsics, (camera.width, camera.height)))

    def _local(self, camera: Camera) -> np.ndarray:
        """Return the vertices (V, 3) in the coordinates of the camera."""
        to_camera = np.linalg.inv(camera.pose)
        return self.vertices @ to_camera[:3, :3].T + to_camera[:3, 3]

    def surfaces(self, seen: Seen) -> np.ndarray:
        """Return the index of the surface that each pixel shows, (h, w); -1 for a pixel that shows no surface."""
        return np.where(seen.face >= 0, self.surface[np.maximum(seen.face, 0)], -1)

    def facing(self, camera: Camera, seen: Seen, mask: np.ndarray) -> np.ndarray:
        """Return the cosine (N,) of the angle between pixel ray and surface normal at the N pixels of `mask` (h, w); negative on front
        sides.
        """
        rows, columns = np.nonzero(mask)
        rays = np.column_stack([columns, rows, np.ones(rows.size)]) @ np.linalg.inv(camera.intrinsics).T @ camera.pose[:3, :3].T
        return np.einsum("ij,ij->i", rays, self.normal[seen.face[rows, columns]]) / np.linalg.norm(rays, axis=1)

    def coarser(self, cell_m: float) -> Triangles:
        """Simplify each surface: merge its vertices within each cubic grid cell of edge `cell_m`, and remove collapsed triangles.

        Every simplified surface keeps at least one triangle.
        """
        vertex_surface = np.zeros(len(self.vertices), np.int64)
        vertex_surface[self.faces] = self.surface[:, None]
        # Walls often lie at round coordinates. An irrational grid offset keeps a noisy wall within one layer of grid cells.
        key = np.column_stack([vertex_surface, np.floor(self.vertices / cell_m + np.sqrt(0.2)).astype(np.int64)])
        _, first, cell = np.unique(key, axis=0, return_index=True, return_inverse=True)
        faces = cell.reshape(-1)[self.faces]
        remains = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        unique = np.zeros(len(faces), bool)
        unique[np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]] = True
        remains &= unique
        vanished = ~np.isin(self.surface, self.surface[remains])
        vertices = np.concatenate([self.vertices[first], self.vertices])
        faces = np.where(vanished[:, None], self.faces + len(first), faces)
        remains |= vanished
        vertices = vertices if vanished.any() else vertices[: len(first)]
        return Triangles(vertices, faces[remains], self.surface[remains], len(self.first_face) - 1)


class Drawing(Triangles):
    """The triangles of a scene with the colours of their surfaces."""

    def __init__(self, scene: Scene) -> None:
        meshes = [surface.mesh for surface in scene]
        starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
        super().__init__(
            np.vstack([np.asarray(mesh.vertices, float) for mesh in meshes]),
            np.vstack([np.asarray(mesh.faces, np.int64) + start for mesh, start in zip(meshes, starts, strict=False)]),
            np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes]),
            len(meshes),
        )
        appearances = [_appearance(mesh) for mesh in meshes]
        self._corner_colour = np.concatenate([colours for colours, _, _ in appearances])
        self._textures = {index: of_mesh for index, (_, of_mesh, _) in enumerate(appearances) if of_mesh is not None}
        self._min_shade = np.repeat(np.array([shade for _, _, shade in appearances]), np.diff(self.first_face))

    def picture(self, camera: Camera, seen: Seen) -> np.ndarray:
        """Render a picture (h, w, 3) uint8 in the colours of the surfaces, lit by a lamp at the camera, on a white background."""
        shown = seen.face >= 0
        face, (rows, columns) = seen.face[shown], np.nonzero(shown)
        rays = np.column_stack([columns, rows, np.ones(len(face))]) @ np.linalg.inv(camera.intrinsics).T
        a, b, c = self._local(camera)[self.faces[face]].swapaxes(0, 1)
        # The ray d of a pixel hits the triangle a, b, c at the barycentric coordinates d.(b x c), d.(c x a) and d.(a x b) over their sum.
        weights = np.stack([(rays * np.cross(p, q)).sum(axis=1) for p, q in ((b, c), (c, a), (a, b))], axis=1)
        weights /= weights.sum(axis=1, keepdims=True)
        shade = self._min_shade[face] + (1 - self._min_shade[face]) * np.abs(self.facing(camera, seen, shown))
        colours = (shade[:, None] * np.einsum("nk,nkc->nc", weights, self._corner_colour[face])).astype(np.float32)
        weights = weights.astype(np.float32)
        for index in np.unique(self.surface[face]):
            if int(index) in self._textures:
                of_surface, (image, uv) = self.surface[face] == index, self._textures[int(index)]
                colours[of_surface] *= _texels(image, uv[face[of_surface] - self.first_face[index]], weights[of_surface])  # white before
        out = np.full((*seen.face.shape, 3), BACKGROUND)
        out[shown] = colours
        return np.clip(np.rint(out), 0, 255).astype(np.uint8)


def _texels(image: np.ndarray, uv: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the colours (N, 3), 0 to 1, of the texels nearest to points with barycentric coordinates (N, 3) on faces of `uv` (N, 3, 2)."""
    height, width = image.shape[:2]
    u, v = np.einsum("nk,nkc->cn", weights, uv)
    column = np.minimum((np.mod(u, 1.0) * width).astype(int), width - 1)
    row = np.minimum((np.mod(1.0 - v, 1.0) * height).astype(int), height - 1)
    return image[row, column].astype(np.float32) / 255


def _appearance(mesh: trimesh.Trimesh) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray] | None, float]:
    """Return corner colours (F, 3, 3) of a mesh (white with a texture), its texture or None, and the brightness at grazing incidence."""
    visual, faces = mesh.visual, np.asarray(mesh.faces)
    kind = getattr(visual, "kind", None)
    flat = np.ones((len(faces), 3, 3), np.float32)
    if kind == "texture":
        image, uv = texture(mesh), getattr(visual, "uv", None)
        if image is not None and uv is not None:
            return flat * 255, (np.asarray(image.convert("RGB")), np.asarray(uv, np.float32)[faces]), COLOURED_SHADE
        return flat * np.asarray(visual.material.main_color, np.float32)[:3], None, COLOURED_SHADE  # type: ignore[union-attr]
    if kind == "face":
        return flat * np.asarray(visual.face_colors, np.float32)[:, None, :3], None, COLOURED_SHADE  # type: ignore[union-attr]
    if kind == "vertex":
        return np.asarray(visual.vertex_colors, np.float32)[faces][..., :3], None, COLOURED_SHADE  # type: ignore[union-attr]
    return flat * UNCOLOURED, None, UNCOLOURED_SHADE

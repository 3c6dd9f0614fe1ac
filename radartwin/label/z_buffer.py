"""Render the triangles, depths and colours that a camera sees in a scene, with a deterministic z-buffer on the CPU.

The method is homogeneous rasterisation (M. Olano, T. Greer, Graphics Hardware 1997). The ray d = (x, y, 1) of a pixel hits the triangle
with corners a, b, c if d.(b x c), d.(c x a) and d.(a x b) have the same sign. The depth of the hit is a.(b x c) divided by the sum of these
three products. Therefore the rasteriser never clips a triangle, and never divides a vertex by its depth. Both sides of a triangle are
drawn, because a scan does not tell which side of a surface is the outer side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from radartwin.compiled import compiled
from radartwin.scene.scene import Scene
from radartwin.scene.textures import texture

NEAR_M = 0.05
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
        depth = np.full((camera.height, camera.width), np.inf)
        face = np.full((camera.height, camera.width), -1, np.int64)
        _rasterise(self._local(camera), self.faces, camera.intrinsics, np.linalg.inv(camera.intrinsics), depth, face)
        return Seen(face, depth)

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
        weights = np.zeros((*seen.face.shape, 3), np.float32)
        out = np.full((*seen.face.shape, 3), BACKGROUND, np.float32)
        rays = np.linalg.inv(camera.intrinsics)
        _paint(self._local(camera), self.faces, rays, seen.face, self._corner_colour, self._min_shade, weights, out)
        surface = self.surfaces(seen)
        for index, (image, uv) in self._textures.items():
            if (pixels := surface == index).any():
                # `out` is white at textured surfaces
                out[pixels] *= _texels(image, uv[seen.face[pixels] - self.first_face[index]], weights[pixels])
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


@compiled
def _paint(points, faces, rays, face, corner_colour, min_shade, weights, out):
    """Write the barycentric coordinates (h, w, 3) and shaded colours (h, w, 3) of the pixels that show a face (index `face` >= 0)."""
    height, width = face.shape
    for v in range(height):
        for u in range(width):
            f = face[v, u]
            if f < 0:
                continue
            x = rays[0, 0] * u + rays[0, 1] * v + rays[0, 2]
            y = rays[1, 0] * u + rays[1, 1] * v + rays[1, 2]
            ax, ay, az = points[faces[f, 0], 0], points[faces[f, 0], 1], points[faces[f, 0], 2]
            bx, by, bz = points[faces[f, 1], 0], points[faces[f, 1], 1], points[faces[f, 1], 2]
            gx, gy, gz = points[faces[f, 2], 0], points[faces[f, 2], 1], points[faces[f, 2], 2]
            p = x * (by * gz - bz * gy) + y * (bz * gx - bx * gz) + (bx * gy - by * gx)
            q = x * (gy * az - gz * ay) + y * (gz * ax - gx * az) + (gx * ay - gy * ax)
            r = x * (ay * bz - az * by) + y * (az * bx - ax * bz) + (ax * by - ay * bx)
            total = p + q + r
            p, q, r = p / total, q / total, r / total
            weights[v, u, 0], weights[v, u, 1], weights[v, u, 2] = p, q, r
            sx, sy, sz = bx - ax, by - ay, bz - az
            tx, ty, tz = gx - ax, gy - ay, gz - az
            nx, ny, nz = sy * tz - sz * ty, sz * tx - sx * tz, sx * ty - sy * tx
            facing = abs(x * nx + y * ny + nz) / max(np.sqrt((nx * nx + ny * ny + nz * nz) * (x * x + y * y + 1.0)), 1e-30)
            shade = min_shade[f] + (1.0 - min_shade[f]) * facing
            for c in range(3):
                out[v, u, c] = shade * (p * corner_colour[f, 0, c] + q * corner_colour[f, 1, c] + r * corner_colour[f, 2, c])


@compiled
def _rasterise(points, faces, intrinsics, rays, depth, face):
    """Fill `depth` (h, w) and `face` (h, w) from points (V, 3) in camera axes and faces (F, 3); at equal depth the face with the lower
    index is kept.
    """
    height, width = depth.shape
    fx, fy, cx, cy, skew = intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2], intrinsics[0, 1]
    for f in range(len(faces)):
        ax, ay, az = points[faces[f, 0], 0], points[faces[f, 0], 1], points[faces[f, 0], 2]
        bx, by, bz = points[faces[f, 1], 0], points[faces[f, 1], 1], points[faces[f, 1], 2]
        gx, gy, gz = points[faces[f, 2], 0], points[faces[f, 2], 1], points[faces[f, 2], 2]
        if max(az, bz, gz) <= NEAR_M:
            continue
        # Compute the pixel bounds of a triangle's part in front of the camera, from its corners and its edges' near-plane crossings.
        low_u, high_u, low_v, high_v = np.inf, -np.inf, np.inf, -np.inf
        for edge in range(3):
            p, q = points[faces[f, edge]], points[faces[f, (edge + 1) % 3]]
            if p[2] > NEAR_M:
                u, v = (fx * p[0] + skew * p[1]) / p[2] + cx, fy * p[1] / p[2] + cy
                low_u, high_u, low_v, high_v = min(low_u, u), max(high_u, u), min(low_v, v), max(high_v, v)
            if (p[2] > NEAR_M) != (q[2] > NEAR_M):
                s = (NEAR_M - p[2]) / (q[2] - p[2])
                x, y = p[0] + s * (q[0] - p[0]), p[1] + s * (q[1] - p[1])
                u, v = (fx * x + skew * y) / NEAR_M + cx, fy * y / NEAR_M + cy
                low_u, high_u, low_v, high_v = min(low_u, u), max(high_u, u), min(low_v, v), max(high_v, v)
        if high_u < 0 or low_u > width - 1 or high_v < 0 or low_v > height - 1:
            continue
        left, right = int(np.ceil(max(low_u, 0.0))), int(np.floor(min(high_u, width - 1.0)))
        top, bottom = int(np.ceil(max(low_v, 0.0))), int(np.floor(min(high_v, height - 1.0)))
        # The sign of the dot product of a ray with b x c, c x a or a x b tells on which side of the triangle edge between these two corners
        # the ray passes.
        e0x, e0y, e0z = by * gz - bz * gy, bz * gx - bx * gz, bx * gy - by * gx
        e1x, e1y, e1z = gy * az - gz * ay, gz * ax - gx * az, gx * ay - gy * ax
        e2x, e2y, e2z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        volume = ax * e0x + ay * e0y + az * e0z
        if volume == 0.0:
            continue
        sign = 1.0 if volume > 0 else -1.0
        for v in range(top, bottom + 1):
            for u in range(left, right + 1):
                x = rays[0, 0] * u + rays[0, 1] * v + rays[0, 2]
                y = rays[1, 0] * u + rays[1, 1] * v + rays[1, 2]
                first = sign * (x * e0x + y * e0y + e0z)
                second = sign * (x * e1x + y * e1y + e1z)
                third = sign * (x * e2x + y * e2y + e2z)
                if first < 0.0 or second < 0.0 or third < 0.0:
                    continue
                total = first + second + third
                if total <= 0.0:
                    continue
                z = sign * volume / total
                if z > NEAR_M and z < depth[v, u]:
                    depth[v, u] = z
                    face[v, u] = f

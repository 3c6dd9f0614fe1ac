"""Make pictures of a surface for a material question: a few crops in which the surface is outlined and its surroundings are visible.

The crops come from photographs that show the surface. If no photograph shows the surface, the mesh is rendered from viewpoints around it,
with the pictures of the scan file if it has any.
In both cases the geometry of the scene decides which parts of the surface are hidden. Views of a surface are ranked by the size of the
surface in the picture, the viewing angle and the sharpness. Two views of a surface must differ in direction, and the last view has a wide
margin. The same scene gives the same picture bytes.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from radartwin.label.photos import Photo, jpeg
from radartwin.label.z_buffer import Camera, Drawing, Triangles
from radartwin.scene.scene import Scene

SIZE = 512  # number of pixels along the longer side of a crop
QUALITY = 88  # JPEG quality of a crop
OUTLINE, HALO = (255, 0, 255), (0, 0, 0)
RANKING_PIXELS = 64  # width and height in pixels of the small rendered pictures that rank the viewpoints
FIELD_DEG, WIDE_FIELD_DEG = 60.0, 90.0
MARGIN, WIDE_MARGIN = 0.35, 1.5  # margin on each side of a crop, relative to the surface's size; the last crop has the wide margin
SMALL_PIXELS = 256  # width in pixels of the small pictures in which the module searches for a surface
MIN_PIXELS = 24  # smallest number of pixels of the surface in a photograph that is scaled to a width of SMALL_PIXELS
MIN_SHARE = 0.01  # rendered pictures in which the surface fills a smaller share are used only if there are no others
LARGE_M = 2.5
# to rank viewpoints, meshes with at least MANY_FACES faces are simplified to grid cells of CELL_M, which suffices for pictures of 64 pixels
MANY_FACES, CELL_M = 50_000, 0.08
MIN_ANGLE_DEG = 20.0  # smallest angle between the directions from which two crops show the same surface


@dataclass(frozen=True, eq=False)
class Crop:
    """A picture of a surface: JPEG bytes, their origin ("photo" or "mesh"), and the share of the pixels that show the surface."""

    jpeg: bytes
    origin: str
    share: float

    @property
    def digest(self) -> str:
        return hashlib.sha256(self.jpeg).hexdigest()


@dataclass(frozen=True, eq=False)
class _View:
    camera: Camera
    score: float
    direction: np.ndarray  # unit vector (3,) from the surface to the camera
    share: float
    photo: Photo | None = None


@dataclass(eq=False)
class Views:
    """Chooses viewpoints for the surfaces of a scene, and makes at most `count` pictures per surface from them."""

    scene: Scene
    photos: Sequence[Photo] = ()
    count: int = 3
    textured: Scene | None = None
    _drawing: Drawing = field(init=False, repr=False)
    _scan: Drawing = field(init=False, repr=False)  # the triangles whose colours the rendered pictures show
    _coarse: Triangles = field(init=False, repr=False)  # simplified triangles that are rendered to rank the viewpoints

    def __post_init__(self) -> None:
        self._drawing = Drawing(self.scene)
        self._scan = self._drawing if self.textured is None else Drawing(self.textured)
        self._coarse = self._drawing if len(self._drawing.faces) < MANY_FACES else self._drawing.coarser(CELL_M)

    def crops(self, indices: Iterable[int], step: Callable[[], None] = lambda: None) -> dict[int, list[Crop]]:
        """Make the crops of the surfaces with these indices, and call `step` after each surface.

        A surface that no camera can see has no crops.
        """
        indices = list(indices)
        in_photos = self._in_photos(indices)
        read = functools.lru_cache(maxsize=16)(Photo.pixels)  # the pixels of one photograph occupy about 8 MB
        out = {}
        for index in indices:
            crops = (self._crop(index, view, read, wide) for view, wide in self._selected(in_photos[index] or self._around(index)))
            out[index] = [crop for crop in crops if crop is not None]
            step()
        return out

    def _selected(self, views: list[_View]) -> list[tuple[_View, bool]]:
        """Select the views of one surface that become crops, each with a flag that is True for the crop with the wide margin."""
        selected = _spread(views, self.count)
        if self.count == 1 or not selected:
            return [(view, False) for view in selected]
        if len(selected) < self.count:
            selected = [*selected, selected[0]]
        return [(view, k == len(selected) - 1) for k, view in enumerate(selected)]

    def _in_photos(self, indices: Sequence[int]) -> dict[int, list[_View]]:
        """Return for each surface the photographs that show it, with a score computed at a picture width of SMALL_PIXELS."""
        views: dict[int, list[_View]] = {index: [] for index in indices}
        for photo in self.photos:
            pixels = photo.pixels()
            height, width = pixels.shape[:2]
            full = Camera(photo.pose, photo.intrinsics, width, height)
            small = _scaled(full)
            seen = self._drawing.seen(small)
            labels = self._drawing.surfaces(seen)
            sharpness = _sharpness(pixels, small.height, small.width)
            present, counts = np.unique(labels[labels >= 0], return_counts=True)
            for index, count in zip(present, counts, strict=True):
                if index in views and count >= MIN_PIXELS:
                    mask = labels == index
                    squareness = float(np.abs(self._drawing.facing(small, seen, mask)).mean())
                    score = np.sqrt(count / mask.size) * (0.3 + 0.7 * squareness) * (0.5 + 0.5 * float(sharpness[mask].mean()))
                    views[index].append(
                        _View(full, float(score), self._direction(int(index), photo.pose[:3, 3]), float(mask.mean()), photo)
                    )
        return views

    def _centre(self, index: int) -> np.ndarray:
        """Return the point that a camera looks at: the middle of the surface, or the nearest triangle if none is near the middle."""
        part = self._drawing.of(index)
        centres = self._drawing.vertices[self._drawing.faces[part]].mean(axis=1)
        middle = np.average(centres, axis=0, weights=np.maximum(self._drawing.area[part], 1e-12))
        away = np.linalg.norm(centres - middle, axis=1)
        area = self._drawing.area[part]
        empty = away.min() > max(0.1, 2 * float(np.sqrt(area[away.argmin()])))
        return centres[away.argmin()] if empty else middle

    def _direction(self, index: int, eye: np.ndarray) -> np.ndarray:
        away = eye - self._centre(index)
        return away / max(float(np.linalg.norm(away)), 1e-9)

    def _around(self, index: int) -> list[_View]:
        """Return rendered views of a surface from several distances and angles, with a score computed on small pictures."""
        part = self._drawing.of(index)
        centre = self._centre(index)
        corners = self._drawing.vertices[self._drawing.faces[part]].reshape(-1, 3)
        extent = float(np.linalg.norm(np.ptp(corners, axis=0)))
        normal = self._drawing.area[part] @ self._drawing.normal[part] / max(self._drawing.area[part].sum(), 1e-12)
        flat = float(np.linalg.norm(normal)) > 0.5
        views = []
        for direction in _directions(normal if flat else None, steep=extent > LARGE_M):
            free = self._free(index, centre, direction)
            for distance in np.unique(np.clip(extent * np.array([0.25, 0.6, 1.2, 2.4]), 0.35, max(0.35, min(6.0, free)))):
                camera = Camera.looking(centre + distance * direction, centre, FIELD_DEG, RANKING_PIXELS)
                seen = self._coarse.seen(camera)
                mask = self._coarse.surfaces(seen) == index
                share = float(mask.mean())
                if share == 0:
                    continue
                # If the camera sees triangles from behind, it is outside the room or inside an object.
                backs = float((self._coarse.facing(camera, seen, seen.face >= 0) > 0).mean())
                squareness = float(np.abs(self._coarse.facing(camera, seen, mask)).mean())
                surroundings = float((seen.face >= 0).mean())
                size = np.sqrt(min(share, 0.3)) * (1 - 0.9 * max(0.0, share - 0.35))
                score = size * (0.3 + 0.7 * squareness) * surroundings * (1 - 0.8 * backs)
                views.append(_View(Camera.looking(camera.pose[:3, 3], centre, FIELD_DEG, SIZE), float(score), direction, share))
        clear = [view for view in views if view.share >= MIN_SHARE]
        return clear or views

    def _free(self, index: int, centre: np.ndarray, direction: np.ndarray) -> float:
        """Return how far (in metres) a camera may move from the surface along `direction` before another surface hides it."""
        camera = Camera.looking(centre, centre + direction, 2.0, 1)
        seen = self._coarse.seen(camera)
        return 0.9 * float(seen.depth[0, 0]) if self._coarse.surfaces(seen)[0, 0] != index else np.inf

    def _crop(self, index: int, view: _View, read: Callable[[Photo], np.ndarray], wide: bool) -> Crop | None:
        """Crop the rectangle around the surface as JPEG, with the surface's outline. Return None if the view does not show the surface."""
        whole = view.camera.widened(WIDE_FIELD_DEG) if wide and view.photo is None else view.camera
        small = _scaled(whole)
        mask = self._drawing.surfaces(self._drawing.seen(small)) == index
        if not mask.any():
            return None
        left, top, right, bottom = _rectangle(mask, small, whole, WIDE_MARGIN if wide else MARGIN)
        scale = SIZE / max(right - left, bottom - top)
        camera = whole.part(left, top, right, bottom, max(1, round((right - left) * scale)), max(1, round((bottom - top) * scale)))
        seen = self._drawing.seen(camera)
        mask = self._drawing.surfaces(seen) == index
        if view.photo is None:
            shown = seen if self._scan is self._drawing else self._scan.seen(camera)
            pixels, origin = self._scan.picture(camera, shown), "mesh"
        else:
            pixels, origin = _cut(read(view.photo), (left, top, right, bottom), camera), "photo"
        return Crop(jpeg(outlined(pixels, mask), QUALITY), origin, float(mask.mean()))


def _directions(normal: np.ndarray | None, steep: bool) -> np.ndarray:
    """Return unit vectors (N, 3) from a surface towards the camera: at 15, 40 and 60 degrees from the normal of a flat surface."""
    if normal is None:
        tilt, count = np.radians([60.0, 80.0]), 8
        axis = np.array([0.0, 0.0, 1.0])
    else:
        tilt, count = np.radians([15.0, 40.0, 60.0, *([75.0] if steep else [])]), 6
        axis = normal / np.linalg.norm(normal)
    first = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    azimuth = 2 * np.pi * (np.arange(count) + 0.5) / count
    around = np.cos(azimuth)[:, None] * first + np.sin(azimuth)[:, None] * second
    return np.concatenate([np.cos(t) * axis + np.sin(t) * around for t in tilt])


def _spread(views: list[_View], count: int) -> list[_View]:
    """Return the `count` views with the best scores whose directions differ from each other by at least MIN_ANGLE_DEG."""
    selected: list[_View] = []
    for view in sorted(views, key=lambda v: -v.score):
        if len(selected) == count:
            break
        if all(view.direction @ other.direction < np.cos(np.radians(MIN_ANGLE_DEG)) for other in selected):
            selected.append(view)
    return selected


def _scaled(camera: Camera) -> Camera:
    """Return the camera with a picture of SMALL_PIXELS width and the same field of view."""
    height = max(1, round(SMALL_PIXELS * camera.height / camera.width))
    return camera.part(-0.5, -0.5, camera.width - 0.5, camera.height - 0.5, SMALL_PIXELS, height)


def _sharpness(pixels: np.ndarray, height: int, width: int) -> np.ndarray:
    """Return the local sharpness of a photograph, (height, width), 0 to 1: its mean absolute difference from a blurred copy of it."""
    from scipy.ndimage import uniform_filter

    grey = pixels.astype(np.float32).mean(axis=2)
    local = uniform_filter(np.abs(grey - uniform_filter(grey, 5)), 31)
    rows = np.linspace(0, len(grey) - 1, height).round().astype(int)
    columns = np.linspace(0, len(grey[0]) - 1, width).round().astype(int)
    return np.clip(local[np.ix_(rows, columns)] / 8.0, 0, 1)


def outlined(pixels: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Draw the edge of the region `mask` (h, w) on the picture (h, w, 3), also where the region touches the border of the picture."""
    from scipy.ndimage import binary_dilation, binary_erosion, binary_opening

    cleaned = binary_opening(mask, iterations=1)
    if np.count_nonzero(cleaned) > 0.7 * np.count_nonzero(mask):
        mask = np.asarray(cleaned)  # without the isolated specks of a ragged mesh; skipped if these specks are 30 % of the mask or more
    edge = mask & np.logical_not(binary_erosion(mask, iterations=2))
    halo = np.logical_and(binary_dilation(edge, iterations=1), np.logical_not(edge))
    out = pixels.copy()
    out[halo] = HALO
    out[edge] = OUTLINE
    return out


def _rectangle(mask: np.ndarray, small: Camera, camera: Camera, margin_of_size: float) -> tuple[float, float, float, float]:
    """Return a rectangle (left, top, right, bottom) around the surface, in pixels of `camera`, at most twice as long as wide."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    per_pixel = camera.width / small.width
    low = np.array([columns[0], rows[0]]) * per_pixel - 0.5
    high = (np.array([columns[-1], rows[-1]]) + 1) * per_pixel - 0.5
    size = high - low
    margin = np.maximum(margin_of_size * size, 0.12 * size.max() + 0.03 * camera.width)
    middle, half = (low + high) / 2, size / 2 + margin
    half = np.maximum(half, half.max() / 2)
    edge = np.array([camera.width - 0.5, camera.height - 0.5])
    low, high = np.maximum(middle - half, -0.5), np.minimum(middle + half, edge)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _cut(pixels: np.ndarray, rectangle: tuple[float, float, float, float], camera: Camera) -> np.ndarray:
    """Cut a rectangle (left, top, right, bottom) from a photograph and scale it to the picture size of `camera`."""
    from PIL import Image

    left, top, right, bottom = (edge + 0.5 for edge in rectangle)
    size = (camera.width, camera.height)
    return np.asarray(Image.fromarray(pixels).resize(size, Image.Resampling.LANCZOS, box=(left, top, right, bottom)))

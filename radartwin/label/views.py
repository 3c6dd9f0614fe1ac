"""How a surface is shown to whoever is asked about it: up to K crops with the surface outlined, its surroundings around it.

Where photographs show it, crops of photographs; otherwise pictures of the mesh from places chosen around it. In both what hides what is
tested against the scene itself, and views are ranked by how much of the surface they show, how squarely, how sharply; each further one
must add another direction, and the last one is wide. The same scene gives the same bytes.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from radartwin.label.crops import SIZE, Crop, jpeg, outlined, resized, window
from radartwin.label.photos import Photo
from radartwin.label.raster import Camera, Drawing, Triangles
from radartwin.scene.scene import Scene

SCOUT = 64  # pixels of the pictures that rank places
FIELD_DEG, WIDE_FIELD_DEG = 60.0, 90.0
MARGIN, WIDE_MARGIN = 0.35, 1.5  # of the surface's own size, kept around it on every side; the last view is the wide one
LEAST_PIXELS = 24  # of the surface in a photograph scaled to a width of 256; fewer show nothing
LEAST_SHARE = 0.01  # of a picture of the mesh, likewise, unless nothing better is found
LARGE_M = 2.5
MANY_FACES, CELL_M = 50_000, 0.08  # finer meshes are looked about in with cells of this size: pictures of 64 pixels show no more
OTHER_WAY_DEG = 20.0  # between the directions of two views of one surface


@dataclass(frozen=True, eq=False)
class _View:
    camera: Camera
    score: float
    direction: np.ndarray  # from the surface to the camera
    share: float
    photo: Photo | None = None


@dataclass(eq=False)
class Views:
    """All surfaces of a scene, ready to be shown.

    Attributes:
        count: crops of each surface at most.
    """

    scene: Scene
    photos: Sequence[Photo] = ()
    count: int = 3
    _drawing: Drawing = field(init=False, repr=False)
    _coarse: Triangles = field(init=False, repr=False)  # for looking about

    def __post_init__(self) -> None:
        self._drawing = Drawing(self.scene)
        self._coarse = self._drawing if len(self._drawing.faces) < MANY_FACES else self._drawing.coarser(CELL_M)

    def of(self, wanted: Iterable[int], step: Callable[[], None] = lambda: None) -> dict[int, list[Crop]]:
        """Crops of the surfaces with these indices; a surface that nothing shows has none.

        Args:
            step: called after each surface.
        """
        wanted = list(wanted)
        found = self._in_photos(wanted)
        read = functools.lru_cache(maxsize=16)(Photo.pixels)  # some 8 MB each
        out = {}
        for index in wanted:
            crops = (self._crop(index, view, read, wide) for view, wide in self._chosen(found[index] or self._around(index)))
            out[index] = [crop for crop in crops if crop is not None]
            step()
        return out

    def _chosen(self, views: list[_View]) -> list[tuple[_View, bool]]:
        """The views to be shown, each with whether it is shown wide: close ones, and the last or best one wide."""
        chosen = _spread(views, self.count)
        if self.count == 1 or not chosen:
            return [(view, False) for view in chosen]
        if len(chosen) < self.count:
            chosen = [*chosen, chosen[0]]
        return [(view, k == len(chosen) - 1) for k, view in enumerate(chosen)]

    def _in_photos(self, wanted: Sequence[int]) -> dict[int, list[_View]]:
        """Views of each surface in the photographs, scored on a picture of 256 pixels' width."""
        views: dict[int, list[_View]] = {index: [] for index in wanted}
        for photo in self.photos:
            pixels = photo.pixels()
            height, width = pixels.shape[:2]
            full = Camera(photo.pose, photo.intrinsics, width, height)
            small = full.part(-0.5, -0.5, width - 0.5, height - 0.5, 256, max(1, round(256 * height / width)))
            seen = self._drawing.seen(small)
            labels = self._drawing.surfaces(seen)
            sharpness = _sharpness(pixels, small.height, small.width)
            present, counts = np.unique(labels[labels >= 0], return_counts=True)
            for index, count in zip(present, counts, strict=True):
                if index in views and count >= LEAST_PIXELS:
                    mask = labels == index
                    squareness = float(np.abs(self._drawing.facing(small, seen, mask)).mean())
                    score = np.sqrt(count / mask.size) * (0.3 + 0.7 * squareness) * (0.5 + 0.5 * float(sharpness[mask].mean()))
                    views[index].append(
                        _View(full, float(score), self._direction(int(index), photo.pose[:3, 3]), float(mask.mean()), photo)
                    )
        return views

    def _centre(self, index: int) -> np.ndarray:
        """Where to look: the middle of the surface, or its triangle nearest to that if it is scattered about an empty middle."""
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
        """Places around a surface from which the mesh shows it, near and far, square and oblique, scored on small pictures."""
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
                camera = Camera.looking(centre + distance * direction, centre, FIELD_DEG, SCOUT)
                seen = self._coarse.seen(camera)
                mask = self._coarse.surfaces(seen) == index
                share = float(mask.mean())
                if share == 0:
                    continue
                # Triangles seen from behind: the eye is outside the room, or inside a thing.
                backs = float((self._coarse.facing(camera, seen, seen.face >= 0) > 0).mean())
                squareness = float(np.abs(self._coarse.facing(camera, seen, mask)).mean())
                surroundings = float((seen.face >= 0).mean())
                size = np.sqrt(min(share, 0.3)) * (1 - 0.9 * max(0.0, share - 0.35))
                score = size * (0.3 + 0.7 * squareness) * surroundings * (1 - 0.8 * backs)
                views.append(_View(Camera.looking(camera.pose[:3, 3], centre, FIELD_DEG, SIZE), float(score), direction, share))
        clear = [view for view in views if view.share >= LEAST_SHARE]
        return clear or views

    def _free(self, index: int, centre: np.ndarray, direction: np.ndarray) -> float:
        """How far an eye may go from the surface before something else is between, metres."""
        camera = Camera.looking(centre, centre + direction, 2.0, 1)
        seen = self._coarse.seen(camera)
        return 0.9 * float(seen.depth[0, 0]) if self._coarse.surfaces(seen)[0, 0] != index else np.inf

    def _crop(self, index: int, view: _View, read: Callable[[Photo], np.ndarray], wide: bool) -> Crop | None:
        """The rectangle around the surface with its outline drawn, as JPEG."""
        whole = view.camera.widened(WIDE_FIELD_DEG) if wide and view.photo is None else view.camera
        scout = _scaled(whole, 256)
        mask = self._drawing.surfaces(self._drawing.seen(scout)) == index
        if not mask.any():
            return None
        left, top, right, bottom = window(mask, scout, whole, WIDE_MARGIN if wide else MARGIN)
        scale = SIZE / max(right - left, bottom - top)
        camera = whole.part(left, top, right, bottom, max(1, round((right - left) * scale)), max(1, round((bottom - top) * scale)))
        seen = self._drawing.seen(camera)
        mask = self._drawing.surfaces(seen) == index
        if view.photo is None:
            pixels = self._drawing.picture(camera, seen)
        else:
            pixels = resized(read(view.photo), (left, top, right, bottom), camera)
        return Crop(jpeg(outlined(pixels, mask)), "mesh" if view.photo is None else "photo", float(mask.mean()))


def _directions(normal: np.ndarray | None, steep: bool) -> np.ndarray:
    """Unit vectors (N, 3) towards the eye: about the normal at 15, 40 and 60 degrees, or all around for what is not flat.

    Straight on would show a surface without its surroundings; a large one, which fills every picture, is also seen along it (`steep`).
    """
    if normal is None:
        tilt, count = np.radians([60.0, 80.0]), 8
        axis = np.array([0.0, 0.0, 1.0])
    else:
        tilt, count = np.radians([15.0, 40.0, 60.0, *([75.0] if steep else [])]), 6
        axis = normal / np.linalg.norm(normal)
    first = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    turn = 2 * np.pi * (np.arange(count) + 0.5) / count
    around = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    return np.concatenate([np.cos(t) * axis + np.sin(t) * around for t in tilt])


def _spread(views: list[_View], count: int) -> list[_View]:
    """The best views, each from another direction than those before it."""
    kept: list[_View] = []
    for view in sorted(views, key=lambda v: -v.score):
        if len(kept) == count:
            break
        if all(view.direction @ other.direction < np.cos(np.radians(OTHER_WAY_DEG)) for other in kept):
            kept.append(view)
    return kept


def _scaled(camera: Camera, width: int) -> Camera:
    height = max(1, round(width * camera.height / camera.width))
    return camera.part(-0.5, -0.5, camera.width - 0.5, camera.height - 0.5, width, height)


def _sharpness(pixels: np.ndarray, height: int, width: int) -> np.ndarray:
    """Share of fine detail at each place, (height, width) in 0 to 1: what the photograph has beyond its own blurred copy."""
    from scipy.ndimage import uniform_filter

    grey = pixels.astype(np.float32).mean(axis=2)
    local = uniform_filter(np.abs(grey - uniform_filter(grey, 5)), 31)
    rows = np.linspace(0, len(grey) - 1, height).round().astype(int)
    columns = np.linspace(0, len(grey[0]) - 1, width).round().astype(int)
    return np.clip(local[np.ix_(rows, columns)] / 8.0, 0, 1)

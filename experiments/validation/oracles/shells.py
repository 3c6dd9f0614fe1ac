"""Image sources of a furnished rectangular room: every wall has its own materials, and the furniture is an obstacle.

The straight path to each image of the six planes (`box.images`) is folded back into the room. Where it crosses a plane, the triangle there
reflects; without one, the path leaves through an opening. Segments are tested against every other triangle. Reflection comes from `stack`,
the roughness loss from W. Ament, Proc. IRE 41 (1953) 142, and orders of planes in a corner are weighted by `box.orders`. The amplitude is
correct only if lines around the path, at the edge of the first Fresnel zone, hit the same walls and no obstacle.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from experiments.validation.oracles import box, stack
from experiments.validation.oracles.case import SPEED_OF_LIGHT
from radartwin.materials import Layered, layered
from radartwin.scene.scene import Scene

IN_PLANE_M = 1e-6
CLEAR = 1e-6  # fraction of a leg's length at either end in which obstacles are ignored
AROUND = 12  # number of lines around a path, at the edge of its first Fresnel zone
BETWEEN = np.array([0.04, 0.13, 0.27, 0.42, 0.58, 0.73, 0.87, 0.96])  # fractions of a path's length at which a line around the path bends
ON_EDGE = 1e-7


@dataclass(frozen=True)
class Image:
    """A path of an image source, from the sensor to the walls and back to the sensor."""

    length_m: float  # length of the whole path
    departure: np.ndarray  # (3,) unit vector from the sensor towards the first hit, world frame
    arrival: np.ndarray  # (3,) unit vector from the sensor towards the last hit, world frame
    bounces: int  # number of reflections
    amplitude: complex  # received amplitude between isotropic antennas, without the phase exp(+j k L)
    clear: bool  # whether the path's first Fresnel zone hits the same surfaces and no obstacle


class Room:
    """The triangles of a scene, divided into the triangles in the six planes of the room's box and the triangles of obstacles."""

    def __init__(self, scene: Scene, frequency_hz: float) -> None:
        self._frequency_hz = frequency_hz
        self.low, high = scene.bounds
        self.size_m = high - self.low
        self._materials = [(s.material, s.roughness_m) for s in scene]
        corners = np.concatenate([np.asarray(s.mesh.triangles) for s in scene]) - self.low
        surface = np.concatenate([np.full(len(s.mesh.faces), i) for i, s in enumerate(scene)])
        self._planes: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = {}
        loose = np.ones(len(corners), bool)
        for axis in range(3):
            for side in (0, 1):
                there = np.abs(corners[:, :, axis] - side * self.size_m[axis]).max(axis=1) < IN_PLANE_M
                self._planes[axis, side] = np.delete(corners[there], axis, axis=2), surface[there]
                loose &= ~there
        self._loose = corners[loose]

    def images(self, sensor_m: np.ndarray, axis: np.ndarray, bounces: int) -> Iterator[Image]:
        """Yield every image path of up to `bounces` reflections for antennas along `axis` (3,) at `sensor_m` (3,), world frame."""
        sensor = sensor_m - self.low
        for index, place, walls in box.images(self.size_m, sensor, bounces):
            line = place - sensor
            length = float(np.linalg.norm(line))
            direction, order = line / length, int(np.abs(index).sum())
            surfaces, points = self._met_along(sensor, line, walls, np.zeros(3))
            if surfaces is None or _hidden(points, self._loose):
                continue
            reflections = [partial(_reflected, *self._materials[surface], self._frequency_hz) for surface in surfaces]
            amplitude = sum(
                (
                    share * box.carried([walls[w][0] for w in wall_order], direction, axis, [reflections[w] for w in wall_order])
                    for wall_order, share in box.orders(direction, walls, sensor)
                ),
                0j,
            )
            arrival = -direction * (-1.0) ** index
            zone = self._zone(direction, length)
            near = self._near(points, float(np.linalg.norm(zone[0])))
            lines = (self._met_along(sensor, line, walls, aside) for aside in zone)
            clear = all(met == surfaces and not _hidden(beside, near) for met, beside in lines)
            yield Image(length, direction, arrival, order, amplitude * SPEED_OF_LIGHT / (4 * np.pi * self._frequency_hz * length), clear)

    def _zone(self, direction: np.ndarray, length_m: float) -> np.ndarray:
        """Return vectors (AROUND, 3) from a path to the edge of its first Fresnel zone where this is widest."""
        first = box.across(np.eye(3)[np.argmin(np.abs(direction))], direction)
        angle = 2 * np.pi * (np.arange(AROUND) + 0.37) / AROUND
        ring = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * np.cross(direction, first)
        return ring * np.sqrt(SPEED_OF_LIGHT / self._frequency_hz * length_m) / 2

    def _near(self, points: np.ndarray, radius_m: float) -> np.ndarray:
        """Return the obstacle triangles within the radius `radius_m` of the straight segments between the points."""
        centre = self._loose.mean(axis=1)
        reach = np.linalg.norm(self._loose - centre[:, None], axis=2).max(axis=1, initial=0.0) + radius_m
        near = np.zeros(len(centre), bool)
        for start, stop in itertools.pairwise(points):
            leg = stop - start
            share = np.clip((centre - start) @ leg / max(leg @ leg, 1e-12), 0, 1)
            near |= np.linalg.norm(start + share[:, None] * leg - centre, axis=1) < reach
        return self._loose[near]

    def _met_along(
        self, sensor: np.ndarray, line: np.ndarray, walls: Sequence[tuple[int, float]], aside: np.ndarray
    ) -> tuple[list[int] | None, np.ndarray]:
        """Return the surface at each wall of the line to an image (None: an opening), shifted by `aside`, and its folded points."""
        surfaces, reached = [], []
        for across, coordinate in walls:
            share = (coordinate - sensor[across]) / line[across]
            point = self._beside(sensor, line, share, aside)
            point += (coordinate - point[across]) / line[across] * line  # where the shifted line meets the plane
            point = self._folded(point)
            side = round(coordinate / self.size_m[across]) % 2
            point[across] = side * self.size_m[across]
            surface = self._met(across, side, np.delete(point, across))
            if surface is None:
                return None, np.zeros((0, 3))
            surfaces.append(surface)
            reached.append((share, point))
        if aside.any():
            reached += [(share, self._folded(self._beside(sensor, line, share, aside))) for share in BETWEEN]
        points = [point for _, point in sorted(reached, key=lambda pair: pair[0])]
        return surfaces, np.array([sensor, *points, sensor])

    @staticmethod
    def _beside(sensor: np.ndarray, line: np.ndarray, share: float, aside: np.ndarray) -> np.ndarray:
        """Return the unfolded point (3,) at the fraction `share` of the line, shifted by the width of the Fresnel zone at this point."""
        return sensor + share * line + 2 * np.sqrt(share * (1 - share)) * aside

    def _folded(self, point: np.ndarray) -> np.ndarray:
        turned = np.mod(point, 2 * self.size_m)
        return np.where(turned > self.size_m, 2 * self.size_m - turned, turned)

    def _met(self, across: int, side: int, point: np.ndarray) -> int | None:
        """Return the index of the surface whose triangle contains a point (2,) of a plane; None if no triangle contains the point."""
        triangles, surface = self._planes[across, side]
        first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        away = point - triangles[:, 0]
        area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        b = (away[:, 0] * second[:, 1] - away[:, 1] * second[:, 0]) / area
        c = (first[:, 0] * away[:, 1] - first[:, 1] * away[:, 0]) / area
        inside = np.flatnonzero((b >= -ON_EDGE) & (c >= -ON_EDGE) & (b + c <= 1 + ON_EDGE))
        return int(surface[inside[0]]) if inside.size else None


def _hidden(points: np.ndarray, triangles: np.ndarray) -> bool:
    """Return whether a triangle cuts a segment between successive points. Ref: Moeller, Trumbore, J. Graphics Tools 2 (1997) 21."""
    if not len(triangles):
        return False
    corner = triangles[:, 0]
    first, second = triangles[:, 1] - corner, triangles[:, 2] - corner
    for start, stop in itertools.pairwise(points):
        ray = stop - start
        across = np.cross(ray, second)
        determinant = np.einsum("ti,ti->t", first, across)
        cut = np.abs(determinant) > 1e-15
        scale = 1 / np.where(cut, determinant, 1.0)
        b = np.einsum("ti,ti->t", start - corner, across) * scale
        turned = np.cross(start - corner, first)
        c, share = turned @ ray * scale, np.einsum("ti,ti->t", second, turned) * scale
        if (cut & (b >= 0) & (c >= 0) & (b + c <= 1) & (share > CLEAR) & (share < 1 - CLEAR)).any():
            return True
    return False


@lru_cache(maxsize=4096)
def _reflected(material: str | Layered, roughness_m: float, frequency_hz: float, cosine: float) -> tuple[complex, complex]:
    layers, cosine = layered(material), round(cosine, 12)
    te, tm = stack.stack(layers.layers, layers.backing, float(np.arccos(cosine)), frequency_hz)
    rough = float(np.exp(-2 * (2 * np.pi * frequency_hz / SPEED_OF_LIGHT * roughness_m * cosine) ** 2))
    return te * rough, tm * rough

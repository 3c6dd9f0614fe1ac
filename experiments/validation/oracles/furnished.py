"""Furnished metal rooms in two dimensions, drawn from seeds, and their full-wave fields.

Every room has walls (one, a corner, a corridor, an alcove, or none) and furniture (cabinets, posts, screens, shelves); the radar at the
origin looks along x. `python -m experiments.validation.oracles.furnished` solves the rooms of fullwave_2d/rooms again (64 frequencies, 5
nodes per wavelength, half a minute to a minute on one core each) and writes the files in the format of shared/reference/fullwave_2d.
"""

import argparse
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from experiments.validation.oracles import moments_2d
from experiments.validation.oracles.fullwave import EVERY
from radartwin.io.files import write_atomically
from radartwin.radar.chirp import Radar

FIELDS = Path(__file__).parent / "fullwave_2d"
ROOMS = FIELDS / "rooms"
SEEDS = range(1, 31)
NEAREST_M, FARTHEST_M = 0.25, 1.25  # all strips are between these distances from the radar
CLEARANCE_M = 0.03  # smallest distance between two surfaces
TURN_DEG = 4.0  # smallest angle between facing faces, so that multiple echoes between them end before the unambiguous range of 2.79 m
NODES = (1_100, 2_500)  # smallest and largest number of nodes of a room
FURNITURE = 4  # largest number of pieces of furniture

Strips = np.ndarray  # (S, 2, 2): start and end of each strip in metres


def chain(*points: tuple[float, float]) -> Strips:
    """Return the strips between consecutive points."""
    line = np.array(points)
    return np.stack([line[:-1], line[1:]], axis=1)


def placed(strips: Strips, turn_rad: float, x_m: float, y_m: float) -> Strips:
    """Return strips that are turned about the origin and then shifted."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    return strips @ np.array([[c, s], [-s, c]]) + [x_m, y_m]


def box(depth_m: float, width_m: float) -> Strips:
    """Return a closed box around the origin."""
    a, b = depth_m / 2, width_m / 2
    return chain((-a, -b), (a, -b), (a, b), (-a, b), (-a, -b))


def _shelf(rng: np.random.Generator) -> Strips:
    """Return a shelf that opens towards -x. Its boards are not parallel, so that no long series of echoes arises between them."""
    width, depth, spread = rng.uniform(0.1, 0.18), rng.uniform(0.05, 0.08), np.radians(rng.uniform(6, 10))
    outwards = depth * np.tan(spread)
    back = chain((0, -width / 2), (0, 0), (0, width / 2))
    boards = [chain((0, y), (-depth, y + np.sign(y) * outwards)) for y in (-width / 2, 0.0, width / 2)]
    return np.concatenate([back, *(boards if rng.random() < 0.5 else boards[::2])])


PIECES: Mapping[str, Callable[[np.random.Generator], Strips]] = {
    "cabinet": lambda rng: box(rng.uniform(0.06, 0.14), rng.uniform(0.06, 0.16)),
    "post": lambda rng: box(rng.uniform(0.015, 0.04), rng.uniform(0.015, 0.04)),
    "screen": lambda rng: chain((0, -(half := rng.uniform(0.04, 0.12))), (0, half)),
    "shelf": _shelf,
}


def _tilt(rng: np.random.Generator, degrees: float) -> float:
    return np.radians(rng.uniform(-degrees, degrees))


def _wall(rng: np.random.Generator) -> dict[str, Strips]:
    return {"front": placed(chain((0, rng.uniform(-0.5, -0.25)), (0, rng.uniform(0.25, 0.5))), _tilt(rng, 12), rng.uniform(0.6, 1.0), 0)}


def _corner(rng: np.random.Generator) -> dict[str, Strips]:
    x, y, side = rng.uniform(0.65, 0.9), rng.uniform(0.35, 0.55), rng.choice([-1, 1])
    both = placed(chain((x, -side * rng.uniform(0.0, 0.3)), (x, side * y), (x - rng.uniform(0.4, 0.7), side * y)), _tilt(rng, 10), 0, 0)
    return {"front": both[:1], "side": both[1:]}


def _corridor(rng: np.random.Generator) -> dict[str, Strips]:
    def side(y: float) -> Strips:
        x = rng.uniform(0.0, 0.25)
        return placed(chain((0, 0), (rng.uniform(0.4, 0.6), 0)), _tilt(rng, 8), x, y)

    return {"left": side(rng.uniform(0.28, 0.4)), "right": side(-rng.uniform(0.28, 0.4))}


def _alcove(rng: np.random.Generator) -> dict[str, Strips]:
    half, depth, spread = rng.uniform(0.1, 0.15), rng.uniform(0.08, 0.18), np.radians(rng.uniform(5, 9))
    inner, left, right = half - depth * np.tan(spread), rng.uniform(0.1, 0.25), rng.uniform(0.1, 0.25)
    line = chain((0, -half - right), (0, -half), (depth, -inner), (depth, inner), (0, half), (0, half + left))
    return {"front": placed(line, _tilt(rng, 12), rng.uniform(0.6, 0.9), rng.uniform(-0.1, 0.1))}


KINDS: tuple[tuple[str, Callable[[np.random.Generator], dict[str, Strips]]], ...] = (
    ("wall", _wall), ("corner", _corner), ("corridor", _corridor), ("alcove", _alcove), ("free", lambda rng: {}),
)  # fmt: skip


def name(seed: int) -> str:
    """Return the name of the room of a seed, such as corner_02."""
    return f"{KINDS[(seed - 1) % len(KINDS)][0]}_{seed:02d}"


def room(seed: int) -> dict[str, Strips]:
    """Return the strips of each surface of the room of a seed, rounded to 0.01 mm."""
    rng = np.random.default_rng(seed)
    make = KINDS[(seed - 1) % len(KINDS)][1]
    highest = float(frequencies()[-1])
    while True:
        surfaces = {part: np.round(strips, 5) for part, strips in make(rng).items()}
        if not _allowed(surfaces):
            continue
        walls = shapely.union_all([_shape(strips) for strips in surfaces.values()]) if surfaces else shapely.Point()
        for number in range(rng.integers(2 if surfaces else 3, FURNITURE + 1)):
            for _ in range(100):
                kind = str(rng.choice(list(PIECES)))
                away, aside = rng.uniform(0.3, 1.0), _tilt(rng, 40)
                place = away * np.cos(aside), away * np.sin(aside)
                strips = np.round(placed(PIECES[kind](rng), aside + _tilt(rng, 45), *place), 5)
                if shapely.LineString([(0, 0), place]).disjoint(walls) and _allowed(more := {**surfaces, f"{kind}_{number + 1}": strips}):
                    surfaces = more
                    break
        if surfaces and NODES[0] <= len(moments_2d.nodes(surfaces.values(), highest)) <= NODES[1]:
            return surfaces


def _shape(strips: Strips) -> Any:
    """Return the lines of a surface, together with the inside if the surface is a closed body."""
    lines = shapely.MultiLineString([shapely.LineString(ends) for ends in strips])
    inside = shapely.polygonize([lines])
    return shapely.union_all([lines, *inside.geoms])


def _allowed(surfaces: dict[str, Strips]) -> bool:
    """Return whether all distances, but for walls that meet at an end, and all angles between facing faces are large enough."""
    shapes = [_shape(strips) for strips in surfaces.values()]
    radar = shapely.Point(0, 0)
    if any(shape.distance(radar) < NEAREST_M or shape.hausdorff_distance(radar) > FARTHEST_M for shape in shapes):
        return False
    near = [(a, b) for i, a in enumerate(shapes) for b in shapes[:i] if a.distance(b) < CLEARANCE_M]
    if not all(a.area == 0 and b.area == 0 and a.touches(b) for a, b in near):
        return False
    parts = [(number, ends) for number, strips in enumerate(surfaces.values()) for ends in strips]
    closed = [shape.area > 0 for shape in shapes]
    return not any(_ringing(a, b) for k, (i, a) in enumerate(parts) for j, b in parts[:k] if not (i == j and closed[i]))


def _ringing(a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether two strips (2, 2) are nearly parallel and face each other."""
    along, other = a[1] - a[0], b[1] - b[0]
    sine = abs(along[0] * other[1] - along[1] * other[0]) / (np.linalg.norm(along) * np.linalg.norm(other))
    if sine > np.sin(np.radians(TURN_DEG)):
        return False
    unit = along / np.linalg.norm(along)
    first, second = np.sort(a @ unit), np.sort(b @ unit)
    apart = abs((b[0] - a[0]) @ [-unit[1], unit[0]])
    return min(first[1], second[1]) > max(first[0], second[0]) + 1e-4 and apart > 1e-4


def radar() -> Radar:
    """Return the radar of the full-wave scenes."""
    return Radar.iwr1843(element="isotropic")


def frequencies() -> np.ndarray:
    """Return the 64 frequencies of the fields in Hz."""
    sensor = radar()
    return sensor.start_frequency_hz + sensor.slope_hz_per_s * EVERY * np.arange(sensor.num_samples // EVERY) / sensor.sample_rate_hz


def write(
    folder: Path, scenes: Mapping[str, Mapping[str, Strips]], selected: list[str], notes: Mapping[str, object], ends_m: np.ndarray
) -> None:
    """Write scenes.json with `notes`, and the solved fields of the selected scenes for transmitter and receiver at `ends_m` (2, 2)."""
    at = frequencies()
    folder.mkdir(parents=True, exist_ok=True)
    head = {"transmitter_m": ends_m[0].tolist(), "receiver_m": ends_m[1].tolist(), **notes}
    described = {scene_name: {part: strips.tolist() for part, strips in surfaces.items()} for scene_name, surfaces in scenes.items()}
    lines = ",\n".join(f"{json.dumps(scene_name)}: {json.dumps(surfaces)}" for scene_name, surfaces in described.items())
    write_atomically(folder / "scenes.json", json.dumps(head)[:-1] + ', "scenes": {\n' + lines + "\n}}\n")
    for scene_name in selected:
        started = time.perf_counter()
        nodes = moments_2d.nodes(scenes[scene_name].values(), at[-1])
        field = moments_2d.sweep(nodes, at, *ends_m)
        rows = [f"{f:.0f},{v.real:.6e},{v.imag:.6e}" for f, v in zip(at, field, strict=True)]
        write_atomically(folder / f"{scene_name}.csv", "\n".join(["frequency_hz,real,imag", *rows]) + "\n")
        print(f"{scene_name}: {len(nodes)} nodes, {time.perf_counter() - started:.0f} s", flush=True)


def main() -> None:
    """Solve the rooms named on the command line, or all rooms."""
    names = {name(seed): seed for seed in SEEDS}
    parser = argparse.ArgumentParser(description="Solve furnished metal rooms by the method of moments.")
    parser.add_argument("names", nargs="*", help="rooms to solve; all if none is named")
    selected = parser.parse_args().names or list(names)
    if unknown := set(selected) - set(names):
        parser.error(f"no room is named {', '.join(sorted(unknown))}; the rooms are {', '.join(names)}")
    sensor = radar()
    ends_m = np.round([sensor.tx_positions[0, :2], sensor.rx_positions[0, :2]], 8)
    notes = {"seed": names, "nodes_per_wavelength": moments_2d.PER_WAVELENGTH}
    write(ROOMS, {room_name: room(seed) for room_name, seed in names.items()}, selected, notes, ends_m)


if __name__ == "__main__":
    main()

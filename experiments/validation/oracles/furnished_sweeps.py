"""Metal scenes of increasing difficulty in two dimensions, and their full-wave fields, for the stability map.

The radar is a single point at the origin, which transmits and receives. The scenes and the fields are stored in fullwave_2d/sweeps. The
command `python -m experiments.validation.oracles.furnished_sweeps` solves the scenes again and writes the files.
"""

from collections.abc import Callable, Mapping

import numpy as np

from experiments.validation.oracles import moments_2d
from experiments.validation.oracles.furnished import FIELDS, Strips, box, chain, placed, write

FOLDER = FIELDS / "sweeps"


def _obstacle(side_mm: float) -> dict[str, Strips]:
    """Return a wall and a square box before the wall, on the path to the mirror point of the wall."""
    side_m = side_mm / 1e3
    wall = placed(chain((0.8, -0.3), (0.8, 0.3)), np.radians(5), 0, 0)
    return {"wall": wall, "box": placed(box(side_m, side_m), np.radians(20), 0.45, 0.03)}


def _opening(width_mm: float) -> dict[str, Strips]:
    """Return two panels side by side with an opening between them, and a wall behind the opening."""
    edge = width_mm / 2e3
    panels = {"left": chain((0.5, edge), (0.5, edge + 0.25)), "right": chain((0.5, -edge - 0.25), (0.5, -edge))}
    turned = {part: placed(strips, np.radians(4), 0, 0) for part, strips in panels.items()}
    return turned | {"back": placed(chain((0.8, -0.2), (0.8, 0.2)), np.radians(-3), 0, 0)}


def _tilt(angle_deg: float) -> dict[str, Strips]:
    """Return a panel of 15 cm at 0.6 m, turned from facing the radar."""
    return {"panel": placed(chain((0.0, -0.075), (0.0, 0.075)), np.radians(angle_deg), 0.6, 0)}


def _edge(distance_mm: float) -> dict[str, Strips]:
    """Return a panel of 30 cm at 0.6 m whose edge is `distance_mm` from the mirror point, which a negative distance puts beside it."""
    edge = distance_mm / 1e3
    return {"panel": chain((0.6, edge - 0.3), (0.6, edge))}


SWEEPS: Mapping[str, tuple[Callable[[float], dict[str, Strips]], tuple[float, ...]]] = {
    "obstacle": (_obstacle, (200, 100, 60, 30, 15, 8)),
    "opening": (_opening, (400, 200, 100, 50, 20, 8)),
    "panel": (_tilt, (0, 10, 20, 40, 60, 75, 85)),
    "edge": (_edge, (100, 30, 10, 0, -10, -30, -100)),
}


def name(sweep: str, value: float) -> str:
    """Return the name of the scene of one value of a sweep, such as obstacle_100."""
    return f"{sweep}_{value:g}"


def scenes() -> dict[str, dict[str, Strips]]:
    """Return the surfaces of all scenes, rounded to 0.01 mm."""
    return {
        name(sweep, value): {part: np.round(strips, 5) for part, strips in make(value).items()}
        for sweep, (make, values) in SWEEPS.items()
        for value in values
    }


if __name__ == "__main__":
    write(FOLDER, scenes(), list(scenes()), {"nodes_per_wavelength": moments_2d.PER_WAVELENGTH}, np.zeros((2, 2)))

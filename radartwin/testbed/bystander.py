"""Add a person who stands in the room during a recording, but is missing in the scan of the room.

The body is one closed surface of elliptical cross-sections with the permittivity of dry skin. Clothes are left out, because a millimetre of
cotton is transparent at 77 GHz. The person stands at a random free place, 1.5 to 4 m from the radar and 20 to 60 degrees beside the viewing
direction of the radar. Only the direct echo is modelled: the person neither shadows nor reflects other echoes. At 2 and 3 m, the mean radar
cross-section over all directions is -6.5 and -7.9 dBsm.

A person who stands still sways. The echo of each frame is shifted by a random displacement along the line of sight, with a standard
deviation of 4 mm and a correlation time of 1 s. D. Abrahamova and F. Hlavacka (Physiol. Res. 57 (2008) 957) measured a root-mean-square
sway of some millimetres for adults in quiet stance; the values of this module are order-of-magnitude estimates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import SceneError
from radartwin.radar.chirp import Radar
from radartwin.scene.collision import overlap_m
from radartwin.scene.objects import shapes, vessels
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import pose
from radartwin.testbed.motion_errors import about_z, wander

NAME = "person"
SWAY_M, SWAY_S = 0.004, 1.0
NEAR_M, FAR_M = 1.5, 4.0  # distance of the person from the radar
BESIDE_DEG = (20.0, 60.0)  # angle of the person from the viewing direction of the radar, to either side
FREE_M = 0.3  # radius of the free cylinder in which the person stands
APART_M = 0.6  # smallest distance of the person's axis from the radar's track and from the target
_TRIES = 500
_RING_M = 0.02
# Cross-sections of an adult of 1.75 m and 71 litres who faces +x: height, half depth along x, half width along y, exponent of the
# superellipse. The widths are rounded from ordinary body measures.
SECTIONS = (
    (0.00, 0.12, 0.12, 2.0), (0.10, 0.06, 0.11, 2.0), (0.45, 0.065, 0.13, 2.0), (0.85, 0.12, 0.17, 2.0), (1.05, 0.11, 0.15, 2.0),
    (1.28, 0.12, 0.19, 2.0), (1.42, 0.09, 0.20, 2.0), (1.50, 0.06, 0.07, 2.0), (1.58, 0.09, 0.07, 2.0), (1.68, 0.10, 0.08, 2.0),
    (1.75, 0.03, 0.03, 2.0),
)  # fmt: skip
_BLOCK = 64  # number of frames that are processed at once


def body() -> Surface:
    """Build the person at the origin, standing on z = 0 and facing +x."""
    return Surface(vessels.oval(SECTIONS, ring_m=_RING_M), "skin", NAME, 0.0, "object", {"fixture": True})


def place(room: Scene, sensor_poses: np.ndarray, target: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw a free place in a room and return the pose (4, 4) of the person, who faces any direction.

    Args:
        room: surfaces of the room, with a surface "floor".
        sensor_poses: (F, 4, 4) poses of the radar.
        target: (3,) position of the target.
    Raises:
        SceneError: no free place was found.
    """
    floor = next(s.mesh.bounds for s in room if s.name == "floor")
    others = [s for s in room if s.name not in ("floor", "ceiling")]
    start = sensor_poses[0]
    keep_off = np.vstack([sensor_poses[:, :2, 3], target[None, :2]])
    cylinder = shapes.cylinder(FREE_M, 1.75, 24)
    for _ in range(_TRIES):
        away, beside = rng.uniform(NEAR_M, FAR_M), np.radians(rng.uniform(*BESIDE_DEG)) * rng.choice([-1, 1])
        heading = rng.uniform(0, 2 * np.pi)
        at = start[:2, 3] + away * (np.cos(beside) * start[:2, 0] + np.sin(beside) * start[:2, 1])
        inside = (at > floor[0, :2] + FREE_M).all() and (at < floor[1, :2] - FREE_M).all()
        if not inside or np.linalg.norm(keep_off - at, axis=1).min() < APART_M:
            continue
        standing = cylinder.copy().apply_translation([*at, 0.05 + 1.75 / 2])
        if not any(overlap_m(standing, s.mesh) for s in others):
            return pose([*at, 0.005], about_z(heading))
    raise SceneError(f"no free place for a person within {FAR_M:g} m of the radar; set measured.gap.person=0 for this room")


def sway(times_s: NDArray[np.float64], strength: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw the displacement (F,) of the person towards the radar at each frame, in metres."""
    return strength * SWAY_M * wander(times_s, SWAY_S, rng)


@dataclass(frozen=True, eq=False)
class Echo:
    """The echo of a swaying person.

    Attributes:
        still: (1 or F, C or 1, T, R, N) samples of the person at rest, in amplitude units.
        towards_m: (F,) displacement towards the radar in each frame, in metres.
    """

    still: NDArray[np.complex64]
    towards_m: NDArray[np.float64]

    def add_to(self, iq: NDArray[np.complex64], radar: Radar) -> None:
        """Add the echo to samples iq (F, C, T, R, N), which is changed in place."""
        frequency = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz
        for first in range(0, len(iq), _BLOCK):
            block = slice(first, first + _BLOCK)
            phasor = np.exp(-4j * np.pi / SPEED_OF_LIGHT * self.towards_m[block, None] * frequency).astype(np.complex64)
            iq[block] += (self.still if len(self.still) == 1 else self.still[block]) * phasor[:, None, None, None]

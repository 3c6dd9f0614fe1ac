"""Validation cases of empty rectangular rooms with up to four bounces, compared with all 128 image sources."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

import radartwin as rt
from experiments.validation.oracles import stack, traced
from experiments.validation.oracles.box import Reflection, image_paths, image_sum
from experiments.validation.oracles.case import Case, Finding, worst
from radartwin.scene import objects

BOUNCES = 4
DYNAMIC_DB = 40.0
CONSTANT = 0.4  # reflection coefficient of walls whose reflection does not depend on the angle
ROOMS = {
    "court": ("squash court 9.75 x 6.4 x 5.64 m", (9.75, 6.4, 5.64), (3.1, 2.35, 1.2)),
    "office": ("office 5.1 x 4.2 x 2.7 m", (5.1, 4.2, 2.7), (1.23, 1.9, 1.05)),
    "corridor": ("corridor 12 x 2.1 x 2.5 m", (12.0, 2.1, 2.5), (4.3, 0.8, 1.1)),
}
WALLS = {"constant": "|reflection| 0.4", "concrete": "concrete", "glass": "glass half-space"}
TILT = np.array([[0.9, -0.1, 0.2], [0.15, 0.95, -0.25], [-0.2, 0.3, 0.92]])  # tilts the sensor, so that no image lies on the antenna's axis
# Four times the samples at four times the sample rate: the same frequency sweep, with an unambiguous range of 44 m.
RADAR = replace(traced.MONOSTATIC, num_samples=4 * traced.MONOSTATIC.num_samples, sample_rate_hz=4 * traced.MONOSTATIC.sample_rate_hz)


@dataclass(frozen=True)
class Compared:
    """Samples (N,) of a room, computed by exact image sources and by RadarTwin's tracer."""

    exact: np.ndarray
    simulated: np.ndarray

    def error(self) -> float:
        """Return the norm of the difference between the tracer's and the exact samples, divided by the norm of the exact samples."""
        return float(np.linalg.norm(self.simulated - self.exact) / np.linalg.norm(self.exact))

    def profiles(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (range in metres, exact range profile, tracer's range profile), in dB with a Hann window."""
        taper = np.hanning(len(self.exact))
        spectra = [20 * np.log10(np.abs(np.fft.fft(s * taper, 4 * len(s))) / taper.sum()) for s in (self.exact, self.simulated)]
        axis = RADAR.unambiguous_range_m * np.arange(4 * len(self.exact)) / (4 * len(self.exact))
        return axis, *spectra

    def profile_rms(self) -> float:
        """Return the rms difference in dB of the two range profiles over the range cells within 40 dB of the strongest cell."""
        _, exact, simulated = self.profiles()
        seen = exact > exact.max() - DYNAMIC_DB
        return float(np.sqrt(np.mean((simulated - exact)[seen] ** 2)))


def rotation() -> np.ndarray:
    """Return the rotation matrix of the sensor: the matrix TILT after it is made orthogonal."""
    u, _, v = np.linalg.svd(TILT)
    return u @ v


def wall_reflection(walls: str) -> Reflection:
    """Return the function of the cosine of incidence that gives the walls' (te, tm) reflection at the centre of the sweep."""
    eps = stack.permittivity("metal" if walls == "constant" else walls, RADAR.center_frequency_hz)
    scale = CONSTANT if walls == "constant" else 1.0

    def values(cosine: float) -> tuple[complex, complex]:
        te, tm = stack.fresnel(eps, cosine)
        return scale * complex(te), scale * complex(tm)

    return values


def room_scene(size_m: tuple[float, float, float], material: str) -> rt.Scene:
    """Return a rectangular room whose surfaces are half-spaces of one material, with a corner at the origin."""
    mesh = objects.box((0.0, 0.0, 0.0), size_m)
    mesh.invert()
    return rt.Scene([rt.Surface(mesh, rt.Layered([], backing=material), "walls", role="room")])


@cache
def compared(room: str, walls: str, method: str, rays: int) -> Compared:
    """Return the samples of a room by image sources and by the tracer; constant walls are metal times CONSTANT for each bounce."""
    _, size, sensor = ROOMS[room]
    pose = traced.pose(sensor, rotation())
    exact = image_sum(np.array(size), np.array(sensor), pose[:3, 2], wall_reflection(walls), BOUNCES, traced.frequencies(RADAR))
    scene = room_scene(size, "metal" if walls == "constant" else walls)
    parts = traced.trace(scene, RADAR, pose, traced.settings(method, max_bounces=BOUNCES, rays=rays))
    if walls == "constant":
        parts = [replace(part, amplitude=part.amplitude * CONSTANT ** part.bounces[:, None]) for part in parts]
    return Compared(exact, traced.sweep(parts, RADAR))


def _room(error: Callable[[Compared], float], method: str, rays: int, full: bool) -> Finding:
    cases = [(room, walls) for room in ROOMS for walls in WALLS] if full else [("court", "constant")]
    errors = [error(compared(room, walls, method, rays)) for room, walls in cases]
    return Finding(0.0, max(errors), max(errors), len(errors))


def _lossless(method: str, full: bool) -> Finding:
    """Compare, in a closed metal office, the total power of the paths of each number of bounces with the power of the image sources."""
    _, size, sensor = ROOMS["office"]
    pose = traced.pose(sensor, rotation())
    parts = traced.trace(room_scene(size, "metal"), RADAR, pose, traced.settings(method, max_bounces=BOUNCES, rays=1_200_000))
    frequency = traced.frequencies(RADAR)[:: 8 if full else 64]
    exact = np.zeros((BOUNCES + 1, len(frequency)), complex)
    for amplitude, length, bounces in image_paths(np.array(size), np.array(sensor), pose[:3, 2], wall_reflection("metal"), BOUNCES):
        exact[bounces] += amplitude / frequency / length * np.exp(2j * np.pi * frequency / stack.SPEED_OF_LIGHT * length)
    exact *= stack.SPEED_OF_LIGHT / (4 * np.pi)
    levels = []
    for order in range(1, BOUNCES + 1):
        order_paths = [part.where(part.bounces == order) for part in parts]
        simulated = np.array([traced.field(order_paths, f) for f in frequency])
        levels.append((float(10 * np.log10(np.sum(np.abs(exact[order]) ** 2))), float(10 * np.log10(np.sum(np.abs(simulated) ** 2)))))
    return worst(levels)


ORACLE = "all 128 image sources, vector reflection at each wall"
IN_WORDS = "court, office and corridor; |reflection| 0.4, concrete, glass; 4 bounces"
CASES = [
    case
    for method, words in traced.METHODS.items()
    for case in (
        Case(f"room-1.2m-{method}", "rooms", f"{IN_WORDS}: 1.2M rays, {words}", ORACLE, "complex error", 0.08, "",
             partial(_room, Compared.error, method, 1_200_000)),
        Case(f"room-2.9m-{method}", "rooms", f"{IN_WORDS}: 2.9M rays, {words}", ORACLE, "complex error", 0.03, "",
             partial(_room, Compared.error, method, 2_900_000), "full"),
        Case(f"room-profile-{method}", "rooms", f"{IN_WORDS}: range profile over 40 dB, 2.9M rays, {words}", ORACLE,
             "rms difference (dB)", 0.5, "dB", partial(_room, Compared.profile_rms, method, 2_900_000), "full"),
        Case(f"lossless-box-{method}", "energy", f"closed metal office: power of each order of bounces, {words}", ORACLE,
             "power of the worst order (dB)", 0.1, "dB", partial(_lossless, method), "full"),
    )
]  # fmt: skip

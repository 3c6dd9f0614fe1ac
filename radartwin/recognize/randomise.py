"""Draw the quantities that the user of a simulation cannot know, so that copies of a simulated turntable recording differ (domain
randomisation).

A classifier that is trained on equal copies of a recording trusts features that a slightly different set-up changes. Each quantity below is
drawn uniformly from a range. The range is half as large at strength 0.5, and strength 0 leaves the quantity unchanged. No range is taken
from the testbed (radartwin.testbed). Sources:
- wobble: +-0.5 degrees of tilt of the axis, and of the object on the disc, about each horizontal direction through the origin of the
  object's frame; order of magnitude.
- eccentricity: +-5 mm from the axis along x and y, for an object centred by eye; order of magnitude.
- start: any angle, because nobody marks the start of a revolution.
- speed: +-2 % of the rotation rate of a small motor; order of magnitude.
- distance: +-1 cm along x and y, for a tape that is read to half a centimetre at both ends; order of magnitude.
- level: +-3 dB of receiver gain, for echoes and noise; order of magnitude. The data sheet of the IWR1843 has typical values only.
- if_filter: corner frequencies of the two high-pass stages, drawn from the options of TI's mmWaveLink (radartwin.radar.if_filter). Any
  strength above 0 draws them. A radar whose description has an IF filter keeps it.
- channels: +-1 dB and +-9 degrees of each channel, which have the standard deviations of a measured AWR1843L calibration
  (radartwin.radar.hardware). The testbed's boards have the same standard deviations.
- noise: +-3 dB around the noise of the measured recordings; the data sheets of these radars give 14 to 16 dB of noise figure.
- wall: +-10 % of the thickness and of the real permittivity of the target's walls, and a factor of up to two on the loss of these walls, as
  rows of ITU-R P.2040-4 for one material differ (figures in radartwin.testbed.variation). The permittivity of the walls in the testbed has
  a standard deviation of 10 %, and their thickness one of 5 %.
- mesh: +-0.3 mm of the radius, of the height, and of deviations of the radius with two and three maxima around the object. The value of 0.3
  mm is the tolerance of class m of ISO 2768-1 for sizes of 30 to 120 mm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.features.processed import Processed, process
from radartwin.materials import Layered, layered, varied
from radartwin.radar.chirp import Radar
from radartwin.radar.if_filter import IfFilter
from radartwin.recognize.augment import noisy
from radartwin.scene.objects.vessels import deformed
from radartwin.scene.scene import Scene
from radartwin.scene.surface import Surface
from radartwin.simulation.simulate import simulate

WOBBLE_DEG, ECCENTRIC_M, RATE, DISTANCE_M = 0.5, 5e-3, 0.02, 0.01
LEVEL_DB, CHANNEL_DB, CHANNEL_DEG, NOISE_DB = 3.0, 1.0, 9.0, 3.0
CORNERS_HZ = ((175e3, 235e3, 350e3, 700e3), (350e3, 700e3, 1400e3, 2800e3))  # of the first and the second high-pass stage
WALL, LOSS = 0.10, 2.0
MESH_M = 0.3e-3


@dataclass(frozen=True)
class Randomisation:
    """Strengths of the randomisation of each quantity, as factors on its range; 0 leaves the quantity unchanged.

    The module's docstring gives range and source of each quantity. The configuration's `supervision.randomise` has the same field names.
    """

    wobble: float = 1.0
    eccentricity: float = 1.0
    start: float = 1.0
    speed: float = 1.0
    distance: float = 1.0
    level: float = 1.0
    if_filter: float = 1.0
    channels: float = 1.0
    noise: float = 1.0
    wall: float = 1.0
    mesh: float = 1.0

    @property
    def moves_target(self) -> bool:
        """Whether target or turntable are randomised, so that copies need simulations of their own."""
        return any((self.wobble, self.eccentricity, self.start, self.speed, self.distance, self.wall, self.mesh))


OFF = Randomisation(**{quantity.name: 0.0 for quantity in fields(Randomisation)})


def poses(nominal: NDArray[np.float64], strengths: Randomisation, seed: int | Sequence[int]) -> NDArray[np.float64]:
    """Draw the poses (F, 4, 4) of an object on a turntable from its nominal poses (F, 4, 4), which turn about the world's vertical axis.

    Equal seeds give the same draw at every strength, and its deviations are proportional to the strength.
    """
    rng = _generator(seed, b"poses")
    tilts = np.radians(WOBBLE_DEG) * strengths.wobble * rng.uniform(-1, 1, (2, 2))
    eccentric = ECCENTRIC_M * strengths.eccentricity * rng.uniform(-1, 1, 2)
    start = np.pi * strengths.start * rng.uniform(-1, 1)
    rate = RATE * strengths.speed * rng.uniform(-1, 1)
    offset = DISTANCE_M * strengths.distance * rng.uniform(-1, 1, 2)
    turned = np.unwrap(np.arctan2(nominal[:, 1, 0], nominal[:, 0, 0]))
    fixed, turning = (Rotation.from_rotvec([x, y, 0.0]).as_matrix() for x, y in tilts)
    spun = Rotation.from_rotvec((start + rate * (turned - turned[0]))[:, None] * [0.0, 0.0, 1.0]).as_matrix() @ nominal[:, :3, :3]
    out = nominal.copy()
    out[:, :3, :3] = fixed @ spun @ turning
    out[:, :3, 3] += (fixed @ spun @ np.append(eccentric, 0.0)[:, None])[..., 0]
    out[:, :2, 3] += offset
    return out


def target(surfaces: Sequence[Surface], strengths: Randomisation, seed: int | Sequence[int]) -> list[Surface]:
    """Draw walls and shape of an object from its nominal surfaces, in the object's own frame. All surfaces follow the same deformation."""
    walls, shape = _generator(seed, b"walls"), _generator(seed, b"mesh")
    thickness, real = 1 + WALL * strengths.wall * walls.uniform(-1, 1, 2)
    loss = LOSS ** (strengths.wall * walls.uniform(-1, 1))
    radius, higher, two, three = MESH_M * strengths.mesh * shape.uniform(-1, 1, 4)
    at = shape.uniform(0, 2 * np.pi, 2)
    points = np.concatenate([surface.mesh.vertices for surface in surfaces])
    base, top, reach = float(points[:, 2].min()), float(np.ptp(points[:, 2])), float(np.hypot(points[:, 0], points[:, 1]).max())

    def moved(xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = xyz.T
        r, azimuth = np.hypot(x, y), np.arctan2(y, x)
        scale = 1 + (radius + two * np.cos(2 * azimuth - at[0]) + three * np.cos(3 * azimuth - at[1])) / np.maximum(r, reach / 2)
        return np.stack([x * scale, y * scale, base + (z - base) * (1 + higher / max(top, reach))], axis=1)

    out = []
    for surface in surfaces:
        if strengths.wall:
            stack = layered(surface.material)
            layers = [(varied(name, real, loss), depth * float(thickness)) for name, depth in stack.layers]
            simple = isinstance(surface.material, str)
            backing = stack.backing if stack.layers else varied(stack.backing, real, loss)
            surface = surface.replaced(material=backing if simple and not layers else Layered(layers, backing=backing))
        if strengths.mesh:
            surface = surface.replaced(mesh=deformed(surface.mesh, moved), role=surface.kind)
        out.append(surface)
    return out


def copies(
    processed: Processed, echoes: Sequence[NDArray[np.complexfloating]], noise_power: float, count: int, strengths: Randomisation,
    seed: Sequence[int],
) -> Iterator[Processed]:  # fmt: skip
    """Yield `count` copies of a simulated revolution, each with a drawn receiver and drawn noise.

    Args:
        echoes: channels (F, A, B) of the nominal target alone, then of each drawn target, over which the copies are divided. Without
            echoes, all copies have the nominal target.
        noise_power: noise power per range bin, around which the noise of the copies is drawn.
    """
    targets = [exchanged(processed, echoes[0], echo) for echo in echoes[1:]] or [processed]
    for variant, drawn in enumerate(targets):
        for number in range(variant, count, len(targets)):
            copy_seed = [*seed, number]
            power = noise_power * noise_factor(strengths, copy_seed)
            yield received(noisy(drawn, power, np.random.default_rng(copy_seed)), strengths, copy_seed)


def echoes_alone(
    surfaces: Sequence[Surface], radar: Radar, sensor_poses: NDArray[np.float64], nominal: NDArray[np.float64], strengths: Randomisation,
    count: int, seed: Sequence[int], **options: Any,
) -> NDArray[np.complex64]:  # fmt: skip
    """Return the channels (1 + count, F, A, B) of the nominal target alone in free space, then of `count` drawn targets; see `alone`."""
    drawn = [(OFF, seed), *((strengths, [*seed, number]) for number in range(count))]
    return np.stack([alone(surfaces, radar, sensor_poses, nominal, *draw, **options) for draw in drawn])


def alone(
    surfaces: Sequence[Surface], radar: Radar, sensor_poses: NDArray[np.float64], nominal: NDArray[np.float64], strengths: Randomisation,
    seed: int | Sequence[int], **options: Any,
) -> NDArray[np.complex64]:  # fmt: skip
    """Simulate the drawn target on the drawn turntable alone in free space.

    Args:
        surfaces: nominal surfaces of the target in its own frame, all with the same name.
        sensor_poses: poses (F, 4, 4) or (1, 4, 4) of the sensor.
        nominal: nominal poses (F, 4, 4) of the target.
    Returns:
        Channels (F, A, B), as radartwin.features.processed defines them.
    """
    drawn = target(surfaces, strengths, seed)
    motion = {surfaces[0].name: poses(nominal, strengths, seed)}
    made = simulate(Scene(drawn), replace(radar, num_chirps=1), sensor_poses, motion=motion, **options)
    return process(made, doppler=False).channels


def exchanged(processed: Processed, nominal: NDArray[np.complexfloating], drawn: NDArray[np.complexfloating]) -> Processed:
    """Return a recording in which the direct echo of the drawn target replaces the direct echo of the nominal target.

    Echoes that also touch the room stay those of the nominal target.

    Args:
        processed: simulated recording of the nominal target.
        nominal, drawn: channels (F, A, B) of both targets alone in free space, on the range bins of `processed`.
    """
    return _with_channels(processed, (processed.channels + (drawn - nominal)).astype(np.complex64))


def received(processed: Processed, strengths: Randomisation, seed: int | Sequence[int]) -> Processed:
    """Draw level, IF filter and channel errors of the receiver, and return the recording that this receiver makes.

    The gain of the IF filter at the centre of a range bin acts on the whole bin.
    """
    rng = _generator(seed, b"receiver")
    gain = 10 ** (LEVEL_DB * strengths.level * rng.uniform(-1, 1) / 20)
    corners = tuple(float(rng.choice(stage)) for stage in CORNERS_HZ)
    count = processed.channels.shape[1]
    unequal_db = CHANNEL_DB * strengths.channels * rng.uniform(-1, 1, count)
    phase = np.radians(CHANNEL_DEG) * strengths.channels * rng.uniform(-1, 1, count)
    response = np.full((count, len(processed.range_m)), gain, np.complex128)
    response *= (10 ** (unequal_db / 20) * np.exp(1j * phase))[:, None]
    if strengths.if_filter and processed.radar.if_filter is None:  # else the simulation contains the known filter of this radar
        beat_hz = 2 * processed.range_m * processed.radar.slope_hz_per_s / SPEED_OF_LIGHT
        response *= np.abs(IfFilter(corners).gain(beat_hz, processed.radar.band_hz))
    return _with_channels(processed, (processed.channels * response).astype(np.complex64), np.mean(np.abs(response) ** 2, axis=0))


def noise_factor(strengths: Randomisation, seed: int | Sequence[int]) -> float:
    """Draw the factor by which the noise power of a copy differs from that of the measured recordings."""
    return float(10 ** (NOISE_DB * strengths.noise * _generator(seed, b"noise").uniform(-1, 1) / 10))


def _with_channels(processed: Processed, channels: NDArray[np.complex64], noise_gain: NDArray | float = 1.0) -> Processed:
    """Return a recording with other channels (F, A, B). The power of channels outside the azimuth row changes in the same ratio."""
    before, after = (np.mean(np.abs(signals) ** 2, axis=1) for signals in (processed.channels, channels))
    power = (processed.power * (after / np.maximum(before, np.finfo(np.float32).tiny))).astype(np.float32)
    noise = None if processed.noise is None else (processed.noise * noise_gain).astype(np.float32)
    return replace(processed, channels=channels, power=power, doppler=None, noise=noise)


def _generator(seed: int | Sequence[int], name: bytes) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence([*np.atleast_1d(seed).tolist(), *name]))

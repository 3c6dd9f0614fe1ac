"""Define constants and helper functions that several physics tests use."""

from typing import Any

import numpy as np
from scipy.signal import fftconvolve

import radartwin as rt
from experiments.validation.oracles import traced
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.scene import rooms
from radartwin.scene.trajectories import trajectory
from radartwin.simulation import geometry, variant
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.hits import Antennas, TraceOptions
from radartwin.simulation.paths import Paths

FREQUENCY = 77e9
WAVELENGTH = SPEED_OF_LIGHT / FREQUENCY
K = 2 * np.pi / WAVELENGTH
UP = np.array([[0.0, 0.0, 1.0]])


def db(power_ratio):
    return 10 * np.log10(power_ratio)


def coherent(hits, keep: Any = slice(None)):
    """Return the complex sum of the fields of ray hits at 77 GHz."""
    return (hits.amplitude[:, 0] * np.exp(1j * K * (hits.length_in_m + hits.length_out_m)))[keep].sum()


def tube_hits(meshes, table, start, end=None, *, width=WAVELENGTH / 4, cross=False, options=None):
    """Return the hits of ray tubes of a width on meshes from antennas at `start` (F, 3) to antennas at `end` (F, 3)."""
    variant.activate()
    built, axes = geometry.build(meshes), np.repeat(UP, len(start), axis=0)
    grid = tube_grid.towards(built.hull_points(), start, built.centre, width, built.grid_shift)
    assert grid is not None
    sender, receiver = (Antennas(places, axes, cross) for places in (start, start if end is None else end))
    return tubes.trace(built, table, grid, sender, receiver, options or TraceOptions(1))


def flat_room_paths(scene, poses, motion=None, **values):
    """Return the paths of a scene whose room consists of flat faces, for the single antenna of the oracles."""
    settings = TraceSettings(**{"room": "panels", "diffuse": False, **values})
    return MitsubaBackend(settings).paths(scene, traced.MONOSTATIC, poses, motion)


def between(parts, low_m, high_m, frame=0, frequency_hz=traced.MONOSTATIC.center_frequency_hz):
    """Return the field of the paths of a frame between two lengths."""
    parts = [part.frames(frame, frame + 1) if part.poses > 1 else part for part in parts]
    return traced.field([part.where((part.length_m > low_m) & (part.length_m < high_m)) for part in parts], frequency_hz)


def metal_wall(distance, half=3.0):
    """Return a square wall that faces the origin from a distance along x."""
    mesh = rooms.rectangle([distance, half, -half], -np.eye(3)[1], np.eye(3)[2], (2 * half, 2 * half))
    return rt.Surface(mesh, "metal", "wall", role="room")


def relative_error(ours, exact):
    """Return the norm of the difference between `ours` and `exact`, divided by the norm of `exact`."""
    return float(np.linalg.norm(ours - exact) / np.linalg.norm(exact))


def at(x, y=0.0, z=0.0):
    """Return the pose (4, 4) of a body at this point, with its axes along the world axes."""
    return trajectory.pose([x, y, z])


def point_echo(radar, where, speed_mps=0.0, frames=1, amplitude=1.0):
    """Return the signal of a point that moves along the line of sight, from its exact two-way paths to all antennas."""
    frame, chirp, tx = np.ogrid[:frames, : radar.num_chirps, : radar.num_tx]
    time = frame / radar.frame_rate_hz + (radar.num_tx * chirp + tx) * radar.chirp_interval
    target = where + (speed_mps * time)[..., None] * where / np.linalg.norm(where)
    to_tx = np.linalg.norm(target - radar.tx_positions, axis=-1)
    to_rx = np.linalg.norm(target[..., None, :] - radar.rx_positions, axis=-1)
    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz
    signal = amplitude * np.exp(2j * np.pi * frequency * (to_tx[..., None] + to_rx)[..., None] / SPEED_OF_LIGHT)
    return (signal.real + 0j if radar.real_sampling else signal).astype(np.complex64)


def echoes_ahead(*ranges_m):
    """Return the paths of resting targets of unit amplitude on boresight."""
    count, lengths, radar = len(ranges_m), np.array(ranges_m, float), rt.Radar.iwr1843()
    forward, middle = np.tile([1.0, 0.0, 0.0], (count, 1)), np.array([radar.center_frequency_hz])
    pose, once = np.zeros(count, int), np.ones(count, int)
    return Paths(1, pose, once, np.ones((count, 1), complex), middle, lengths, lengths, forward, forward, np.zeros(count))


def noisy(iq, deviation, seed=0):
    """Return samples with complex Gaussian noise."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(iq.shape) + 1j * rng.standard_normal(iq.shape)
    return (iq + deviation / np.sqrt(2) * noise).astype(np.complex64)


def two_ways(screen, y, z, place, wall, wavenumber):
    """Return the echo of a mirror at x = `wall` behind a black screen at x = `place`, relative to the free echo, by Kirchhoff quadrature.

    The quadrature runs over the screen and over its image: the field passes both. screen: (Y, Z) whether a cell of the grid of y (Y,) and
    z (Z,) is covered.
    """
    area, between, rest = (y[1] - y[0]) * (z[1] - z[0]), 2 * (wall - place), 2 * wall - place
    near, far = (np.sqrt(d * d + y[:, None] ** 2 + z**2) for d in (place, rest))
    factor = wavenumber / (2j * np.pi) * area
    source = screen * np.exp(1j * wavenumber * near) / near * 0.5 * (1 + place / near)
    once = factor * (source * np.exp(1j * wavenumber * far) / far).sum()
    aside = [np.arange(1 - len(axis), len(axis)) * (axis[1] - axis[0]) for axis in (y, z)]
    way = np.sqrt(between**2 + aside[0][:, None] ** 2 + aside[1] ** 2)
    second = fftconvolve(source, factor * np.exp(1j * wavenumber * way) / way, mode="full")[len(y) - 1 :, len(z) - 1 :][: len(y), : len(z)]
    twice = factor * (source * second).sum()
    return 1 - (2 * once - twice) * 2 * wall * np.exp(-2j * wavenumber * wall)


def picture(mesh, distance, step):
    """Return the projection of a mesh from the origin on the plane x = distance, as the first arguments of `two_ways`."""
    flat = mesh.triangles[..., 1:] * distance / mesh.triangles[..., :1]
    y, z = (np.arange(flat[..., i].min() - step, flat[..., i].max() + step, step) for i in range(2))
    screen = np.zeros((len(y), len(z)), bool)
    for corners in flat:
        a, b = corners[1:] - corners[0]
        size = a[0] * b[1] - a[1] * b[0]
        if abs(size) > 1e-12:
            (i, k), (j, n) = (np.searchsorted(axis, (side.min(), side.max())) for axis, side in zip((y, z), corners.T, strict=True))
            right, up = y[i:k, None] - corners[0, 0], z[j:n] - corners[0, 1]
            u, v = (right * b[1] - up * b[0]) / size, (up * a[0] - right * a[1]) / size
            screen[i:k, j:n] |= (u >= 0) & (v >= 0) & (u + v <= 1)
    return screen.astype(float), y, z


def assert_finite_and_passive(parts):
    """Check that all values are finite, and that no path is stronger than twice the echo of a mirror."""
    mirror = SPEED_OF_LIGHT / traced.MONOSTATIC.center_frequency_hz / (4 * np.pi)
    for part in parts:
        for value in (part.amplitude, part.length_m, part.departure, part.arrival, part.rate_mps):
            assert np.isfinite(value).all()
        assert (np.abs(part.amplitude).max(axis=1, initial=0) <= 2 * mirror / part.length_m).all()


def mie_backscatter(radius):
    """Return the cross-section of a metal sphere from the Mie series with a very large refractive index."""
    import miepython

    return miepython.efficiencies_mx(1e4 - 1e4j, 2 * np.pi * radius / WAVELENGTH)[2] * np.pi * radius**2


def geometric_optics_of_a_sphere(centre, radius, source, target, wavelength=WAVELENGTH):
    """Return (amplitude, path length, reflection point) of the wave that a metal sphere reflects. Source and target may be anywhere outside
    the sphere; the polarisation is ignored.

    The wave leaves the reflection point with the curvature 1/r + 2/(a cos t) in the plane of incidence and 1/r + 2 cos t/a at right angles
    to it. Here r is the distance from the source, a the radius of the sphere and t the angle of incidence. Ref: J. Keller, J. Opt. Soc. Am.
    52 (1962) 116, section on reflection.
    """
    out, back = source - centre, target - centre
    # the point of shortest way: by bisection on the great circle between the two directions
    u = out / np.linalg.norm(out)
    v = back - (back @ u) * u
    opening = np.arctan2(np.linalg.norm(v), back @ u)
    v = v / np.linalg.norm(v) if opening > 1e-9 else np.cross(u, np.eye(3)[np.argmin(np.abs(u))])

    def point(t):
        return centre + radius * (np.cos(t) * u + np.sin(t) * v)

    low, high = 0.0, opening
    for _ in range(100):
        third, other = (2 * low + high) / 3, (low + 2 * high) / 3
        a, b = (np.linalg.norm(point(t) - source) + np.linalg.norm(point(t) - target) for t in (third, other))
        low, high = (low, other) if a < b else (third, high)
    place = point((low + high) / 2)
    r1, r2 = np.linalg.norm(place - source), np.linalg.norm(place - target)
    cosine = (place - centre) @ (source - place) / (radius * r1)
    within, across = 1 / r1 + 2 / (radius * cosine), 1 / r1 + 2 * cosine / radius
    spread = 1 / np.sqrt((1 + r2 * within) * (1 + r2 * across))
    return wavelength / (4 * np.pi) * spread / r1, r1 + r2, place

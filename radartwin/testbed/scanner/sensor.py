"""Simulate the errors of a phone with LiDAR: depth noise, confidence, lost depth values and pose drift, with the source of each value.

Sources
    [Apple]  Apple newsroom, 18 March 2020: the LiDAR scanner reaches 5 m. ARDepthData documentation: depth is along the camera's axis,
             256 x 192; confidence is low on "surfaces that are highly reflective, or that have high light absorption".
    [L21]    Luetzenburg, Kroon, Bjork 2021, Scientific Reports 11:22221: 576 laser spots (24 x 24); +-1 cm on objects over 10 cm.
    [TY23]   Teo and Yang 2023, Developments in the Built Environment 14:100169 (iPad Pro): points lie within 1 mm of
             their best plane if the device is held still, and within 1 cm on average if it moves.
    [K22]    Kim et al. 2022, Sensors 22:9873: ARKit's relative pose error grows by about 0.02 m per second of walking (1 m/s).
    [L24]    Lin et al. 2024, Handheld mapping of specular surfaces using consumer-grade flash LiDAR, ICCP: through a pane the sensor
             measures the room behind the pane, and in a mirror it measures the mirrored room, so that both look like holes.
    [X25]    Xiang et al. 2025, Depth enhancement from a practical light-weight dToF sensor, arXiv:2504.01596: on specular surfaces, laser
             spots are lost or give wrong depths.
    [chair] Our measurement on the 24 real frames of shared/data/scans/arkit_lidar_chair_scan against the vendor's mesh (0.5 to 4 m). The
             measurement gives the fraction of pixels with high, medium and low confidence, the decrease of the confidence with range and at
             edges, the depth residual for each confidence, and the spatial smoothness. See the table in
             docs/decisions/005-virtual-scanner.md.

The depth map is a smooth interpolation of the 24 x 24 laser spots, guided by the colour picture [L21]. Depth errors of neighbouring pixels
are correlated (the uncorrelated part is 0.7 mm [chair]). Depth errors of different frames are independent.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy import ndimage

from radartwin.testbed.motion_errors import about_z
from radartwin.testbed.scanner.camera import Sight


@dataclasses.dataclass(frozen=True)
class Sensor:
    """Parameters of the simulated phone. The argument `strength` of `scan` multiplies the parameters marked with *.

    Attributes:
        size: width and height of the depth map in pixels [Apple].
        colour_size: width and height of the colour picture in pixels; the ratio is 4:3 as on the phone, but the resolution is lower.
        focal_px: focal length of the depth map in pixels: 193 for a width of 256 pixels, a field of view of 67 degrees [chair].
        range_m: largest depth that the sensor measures, in metres [Apple].
        spots: number of laser spots across and down the depth map [L21].
        noise_m, noise_per_m: * standard deviation of the depth at pixels with high confidence: noise_m + noise_per_m x depth, by default
            4 mm + 1 mm per metre. In [chair], 68 % of the pixels with high confidence lie within 7 to 9 mm of the vendor's mesh at 1 to
            3.5 m range, including the error of the mesh. The sources [L21] and [TY23] state a depth error of 1 cm.
        white_m: * standard deviation in metres of the part of the depth noise that is uncorrelated between pixels [chair].
        unsure: * factors on the depth noise at pixels with low, medium and high confidence. The 68 % quantiles of the depth residuals in
            [chair] are 20 to 110 mm (low), 12 to 43 mm (medium) and 8 mm (high).
        medium_signal, high_signal: value of reflectance x cosine / range^2 at which half of the pixels reach medium or high confidence.
            In [chair] half of the pixels have high confidence at 2.9 m, and half have low confidence at 3.4 m, on concrete in the shade
            with an assumed reflectance of 0.2 and cosine of 0.7.
        border: numbers of pixel columns at the left edge that have low confidence, and that have at most medium confidence, because no
            laser spots reach these columns [chair].
        signal_spread: standard deviation of the logarithm of the received laser signal over a depth map (speckle, colour) [chair].
        edge_jump: smallest relative depth step within three pixels that counts as an edge.
        flying: * fraction of edge pixels whose depth lies between the front and the back surface. In [chair], 19 % of edge pixels have
            high, 53 % medium and 27 % low confidence.
        metal_dropout: * fraction of laser spots lost on metal at more than metal_deg from its normal [X25]; the value is an assumption.
        pane_dropout: * fraction of laser spots lost at glass; all other laser spots measure the surface behind the glass [L24]; the value
            is an assumption.
        metal_signal: factor on the laser signal from bare metal, which reflects most light away from the phone [Apple, X25]; the value is
            an assumption.
        drift_m: * standard deviation in metres of the position error per axis after one metre of walking. The position error grows with the
            square root of the walked path. The source [K22] states a position error of 0.02 m for all three axes together.
        yaw_deg: * standard deviation in degrees of the heading error after one metre of walking. Roll and pitch do not drift, because the
            phone measures gravity. If the heading error alone caused the 0.02 m in [K22], its standard deviation would be 1.98 degrees
            (0.02 times the square root of 3, in radians). The default is about a twentieth of this value, an assumption, because the
            position also drifts.
        tilt_deg: * standard deviation in degrees of the roll and pitch error of each frame relative to gravity; the value is an assumption.
    """

    size: tuple[int, int] = (256, 192)
    colour_size: tuple[int, int] = (960, 720)
    focal_px: float = 193.0
    range_m: float = 5.0
    spots: tuple[int, int] = (24, 24)
    noise_m: float = 0.004
    noise_per_m: float = 0.001
    white_m: float = 0.0007
    unsure: tuple[float, float, float] = (8.0, 3.0, 1.0)
    medium_signal: float = 0.012
    high_signal: float = 0.017
    border: tuple[int, int] = (12, 17)
    signal_spread: float = 0.35
    edge_jump: float = 0.05
    flying: float = 0.5
    metal_dropout: float = 0.5
    metal_deg: float = 60.0
    pane_dropout: float = 0.3
    metal_signal: float = 0.5
    drift_m: float = 0.0115
    yaw_deg: float = 0.1
    tilt_deg: float = 0.05

    def intrinsics(self, size: tuple[int, int]) -> np.ndarray:
        """Return the camera intrinsics (3, 3) for a picture of `size` (width, height) pixels with the same field of view as the depth
        map.
        """
        scale = size[0] / self.size[0]
        return np.array([[self.focal_px * scale, 0, (size[0] - 1) / 2], [0, self.focal_px * scale, (size[1] - 1) / 2], [0, 0, 1]])


def measured(
    seen: Sight, reflectance: np.ndarray, metal: np.ndarray, sensor: Sensor, strength: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Simulate the depth sensor's measurement of one view.

    Args:
        seen: true depth and reflecting face at each pixel.
        reflectance: (h, w) near-infrared reflectance of the reflecting surface at each pixel, 0 to 1.
        metal: (h, w) bool, whether the reflecting surface is metal.
        strength: factor on the errors of the phone; 0 is an ideal sensor.
    Returns:
        Depth (h, w) float32 in metres; 0 at pixels where the sensor measures no depth.
        Confidence (h, w) uint8 of the depth: 0 low, 1 medium, 2 high.
        Mask (h, w) bool, True at pixels whose depth mixes the surfaces on both sides of an edge.
    """
    truth = np.where(np.isfinite(seen.depth), seen.depth, 0).astype(np.float64)
    shape = truth.shape
    back, front = ndimage.maximum_filter(truth, 3), ndimage.minimum_filter(np.where(truth > 0, truth, np.inf), 3)
    edge = (truth > 0) & (back - front > sensor.edge_jump * truth)

    signal = reflectance * seen.cosine / np.maximum(truth, 0.2) ** 2 * np.where(metal, sensor.metal_signal, 1.0)
    signal = signal * np.exp(sensor.signal_spread * _smooth(rng, shape, sensor.spots))
    confidence = (signal > sensor.medium_signal).astype(np.uint8) + (signal > sensor.high_signal)
    grade = rng.random(shape)
    confidence = np.where(edge, np.minimum(confidence, np.where(grade < 0.27, 0, np.where(grade < 0.8, 1, 2))), confidence).astype(np.uint8)

    low, medium = sensor.border
    confidence[:, :low] = 0
    confidence[:, low:medium] = np.minimum(confidence[:, low:medium], 1)

    sigma = strength * (sensor.noise_m + sensor.noise_per_m * truth) * np.array(sensor.unsure)[confidence]
    # The depth map is smooth, so the depth noise must not jump where the confidence changes.
    sigma = ndimage.uniform_filter(sigma, 5)
    depth = truth + sigma * _smooth(rng, shape, sensor.spots) + strength * sensor.white_m * rng.standard_normal(shape)

    flying = edge & (rng.random(shape) < min(strength * sensor.flying, 1.0)) & np.isfinite(front)
    mix = rng.random(shape)
    depth = np.where(flying, (1 - mix) * np.where(np.isfinite(front), front, 0) + mix * back, depth)

    slanted = metal & (seen.cosine < np.cos(np.radians(sensor.metal_deg)))
    chance = np.where(slanted, sensor.metal_dropout, 0.0)
    chance = np.where(seen.pane, np.maximum(chance, sensor.pane_dropout), chance)
    lost = _uniform(rng, shape, sensor.spots) < np.minimum(strength * chance, 1.0)
    gone = (truth <= 0) | lost | (depth > sensor.range_m) | (depth < 0.2)
    return np.where(gone, 0, depth).astype(np.float32), np.where(gone, 0, confidence).astype(np.uint8), flying & ~gone


def drifted(poses: np.ndarray, sensor: Sensor, strength: float, rng: np.random.Generator) -> np.ndarray:
    """Return the phone's estimates (N, 4, 4) of its poses. The first pose is exact; then position and heading drift as a random walk.

    The phone software ARKit corrects the drift when it recognises an earlier position. The model in this file does not correct the drift,
    so its pose errors after a long walk are larger.
    """
    step = np.sqrt(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1))
    heading = np.radians(strength * sensor.yaw_deg) * step * rng.standard_normal(len(step))
    shift = strength * sensor.drift_m * step[:, None] * rng.standard_normal((len(step), 3))
    tilt = np.radians(strength * sensor.tilt_deg) * rng.standard_normal((len(poses), 2))
    tilt[0] = 0
    estimated = np.empty_like(poses)
    estimated[0] = poses[0]
    walked = poses[0].copy()  # without the roll and pitch errors of single frames, which do not accumulate
    for i in range(1, len(poses)):
        relative = np.linalg.inv(poses[i - 1]) @ poses[i]
        walked = walked @ relative
        walked[:3, :3] = about_z(heading[i - 1]) @ walked[:3, :3]
        walked[:3, 3] += shift[i - 1]
        a, b = tilt[i]
        lean = np.array([[1, 0, b], [0, 1, -a], [-b, a, 1]])
        left, _, right = np.linalg.svd(lean @ walked[:3, :3])
        estimated[i] = walked
        estimated[i, :3, :3] = left @ right
    return estimated


def _smooth(rng: np.random.Generator, shape: tuple[int, ...], spots: tuple[int, int]) -> np.ndarray:
    """Draw a standard normal random field (h, w) that is interpolated between the laser spots and scaled to unit variance."""
    field = _between(rng.standard_normal((spots[1] + 2, spots[0] + 2)), shape, spots)
    return field / np.sqrt(_between(np.ones((spots[1] + 2, spots[0] + 2)), shape, spots, squared=True))


def _uniform(rng: np.random.Generator, shape: tuple[int, ...], spots: tuple[int, int]) -> np.ndarray:
    """Draw a random field (h, w) with a uniform distribution in 0 to 1 that is constant around each laser spot."""
    rows, columns = np.arange(shape[0]) * spots[1] // shape[0], np.arange(shape[1]) * spots[0] // shape[1]
    return rng.random((spots[1], spots[0]))[rows][:, columns]


def _between(values: np.ndarray, shape: tuple[int, ...], spots: tuple[int, int], squared: bool = False) -> np.ndarray:
    """Interpolate values at the laser spots bilinearly to the pixels (h, w) of the depth picture."""
    v, u = np.arange(shape[0]) * spots[1] / shape[0] + 0.5, np.arange(shape[1]) * spots[0] / shape[1] + 0.5
    i, j = v.astype(int), u.astype(int)
    q, p = (v - i)[:, None], (u - j)[None, :]
    power = 2 if squared else 1
    top = ((1 - p) ** power) * values[i][:, j] + (p**power) * values[i][:, j + 1]
    low = ((1 - p) ** power) * values[i + 1][:, j] + (p**power) * values[i + 1][:, j + 1]
    return ((1 - q) ** power) * top + (q**power) * low

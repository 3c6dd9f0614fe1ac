"""The origin of a detected peak is the plate that stands at the range and azimuth of the peak, which the test knows from the geometry."""

from __future__ import annotations

import numpy as np
import pytest

import radartwin as rt
from radartwin.radar.detection import detect
from radartwin.scene import objects
from radartwin.scene.trajectories.trajectory import look_at
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.origins import echo_origins
from radartwin.simulation.simulate import trace_paths

RADAR = rt.Radar.iwr1843()
PLACES = {"left": (2.0, 30.0), "middle": (1.2, 0.0), "right": (2.0, -30.0), "far": (3.0, 10.0)}  # range in m, azimuth in degrees
POSITION = np.array([0.5, -1.0, 1.0])


@pytest.fixture(scope="module")
def scene() -> rt.Scene:
    """Metal plates of different sizes whose normals point at the radar, so that each reflects one echo from its middle."""
    surfaces = []
    for number, (name, (range_m, azimuth_deg)) in enumerate(PLACES.items()):
        angle, half = np.radians(azimuth_deg), 0.04 + 0.01 * number
        middle = POSITION + range_m * np.array([np.cos(angle), np.sin(angle), 0.0])
        mesh = objects.box([0.0, -half, -half], [0.002, half, half])  # its face x = 0 looks along -x
        turn = look_at(middle, middle + (middle - POSITION))
        surfaces.append(rt.Surface(mesh.apply_transform(turn), "metal", name, role="object"))
    return rt.Scene(surfaces)


@pytest.fixture(scope="module")
def paths(scene: rt.Scene):
    pose = look_at(POSITION, POSITION + np.array([1.0, 0.0, 0.0]))
    return trace_paths(scene, RADAR, pose[None], None, TraceSettings())[0], pose


def test_each_detected_peak_is_named_after_the_plate_at_its_place(scene, paths) -> None:
    parts, pose = paths
    peaks = detect(rt.simulate(scene, RADAR, pose[None], noise=True).iq, RADAR)
    origins = echo_origins(scene, parts, RADAR, pose, peaks.range_m, peaks.azimuth_rad)
    found = {}
    for range_m, azimuth_rad, origin in zip(peaks.range_m, peaks.azimuth_rad, origins, strict=True):
        wanted = [n for n, (r, a) in PLACES.items() if abs(r - range_m) < RADAR.range_resolution_m and abs(a - np.degrees(azimuth_rad)) < 8]
        if wanted:  # half of the 15 degree beam of eight antennas; other peaks are echoes between two plates
            found[wanted[0]] = origin
            assert origin.surface == wanted[0]
    assert {"middle", "far"} <= set(found)
    # The nearest plates are at least 0.8 m away, so that only the sidelobes of other plates, 31 dB below a Hann window's peak, add power.
    assert found["middle"].level_db == pytest.approx(0.0, abs=0.3)


def test_azimuth_separates_two_plates_at_one_range(scene, paths) -> None:
    parts, pose = paths
    origins = echo_origins(scene, parts, RADAR, pose, [2.0, 2.0], np.radians([30.0, -30.0]))
    assert [origin.surface for origin in origins] == ["left", "right"]


def test_a_place_without_echoes_has_no_origin(scene, paths) -> None:
    parts, pose = paths
    (origin,) = echo_origins(scene, parts, RADAR, pose, 9.0, 0.0)
    assert origin.surface == ""
    assert origin.level_db == float("-inf")

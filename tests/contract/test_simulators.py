"""The contract of every simulator. Where a baseline simulator breaks a part of it, the test asserts its deviating result."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import radartwin as rt
from radartwin.config.compose import compose
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import ConfigError, InputError
from radartwin.scene import objects
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends.backend import SIMULATORS, backend
from radartwin.source_files import closure
from radartwin.store.digest import semantic, spec_digest

# The simulator warns of paths that Sionna cannot find; tests/contract/test_sionna.py tests the warnings.
pytestmark = pytest.mark.filterwarnings("ignore:sionna:UserWarning")
RADAR = rt.Radar.iwr1843(element="isotropic")
WAVELENGTH = SPEED_OF_LIGHT / RADAR.center_frequency_hz
HERE = np.eye(4)[None]
DRIVE = np.array([trajectory.pose([0.0, 0.01 * f, 0.0]) for f in range(9)])
CASES = {
    "mitsuba": {},
    "rfgenesis shipped": {"version": "shipped"},
    "rfgenesis corrected": {"version": "corrected"},
    "points": {},
    "points sphere": {"cross_section": "sphere"},
    "sionna": {},
    "sionna apart": {"separation_m": 0.03},
}
# Level error in dB of a 5 cm metal sphere at 2 m, relative to an RCS of pi r^2, as (expected error, tolerance). An exact simulator has 0.
SPHERE_ERROR_DB = {
    "mitsuba": (0.2, 0.5),  # at 2 m, the mirror point is 5 cm nearer than the sphere's centre, and the wavefronts curve with the sphere
    "rfgenesis shipped": (-21.9, 1.0),
    "rfgenesis corrected": (11.4, 1.0),
    "points": (0.0, 0.3),
    "points sphere": (0.0, 0.1),
    "sionna": (-np.inf, 0.0),  # no facet of the ball has a mirror point, so there is no path
    "sionna apart": (-np.inf, 0.0),
}
# Measured speed of a target at 0.2 m/s. RF-Genesis as shipped spaces chirps by 6.25 ms instead of 128 us, so the speed becomes 9.77 m/s,
# which Doppler folding turns into -5.11 m/s.
SPEED_READ = {"rfgenesis shipped": -5.11}


@pytest.fixture(params=CASES)
def case(request):
    return request.param


@pytest.fixture
def simulator(case):
    return backend(case.partition(" ")[0], **CASES[case])


@pytest.fixture(params=SIMULATORS)
def plain(request):
    """Return each simulator once, with its default settings."""
    return backend(request.param)


def at(x, y=0.0, z=0.0):
    return trajectory.pose([x, y, z])


def box(x=2.0, y=0.0, name="box", size=0.1):
    return rt.Surface(trimesh.creation.box((size, size, size)).apply_transform(at(x, y)), "metal", name)


def ball(radius=0.05):
    return rt.Scene([rt.Surface(objects.sphere(radius), "metal", "ball")])


def seen(case, azimuth):
    """Return a target that the simulator can see: a ball, or for Sionna, which sees only flat surfaces, a plate that faces the sensor."""
    if not case.startswith("sionna"):
        return ball()
    turned = trajectory.pose([0, 0, 0]) @ trimesh.transformations.rotation_matrix(azimuth, [0, 0, 1])
    return rt.Scene([rt.Surface(objects.plate(0.1, 0.1).apply_transform(turned), "metal", "ball")])


def profile(samples, points=2048):
    window = np.hanning(samples.shape[-1])
    return np.fft.fft(samples * window, points) / window.sum()


def range_of(spectrum):
    return float(np.abs(spectrum).argmax()) / len(spectrum) * RADAR.unambiguous_range_m


def test_contract_covers_every_simulator():
    assert {name.partition(" ")[0] for name in CASES} == set(SIMULATORS)
    assert {compose([f"simulator={name}"]).simulator.backend for name in SIMULATORS} == set(SIMULATORS)


def test_paths_have_the_documented_shapes(case, simulator):
    moving = np.array([at(1.5 + 0.01 * f) for f in range(3)])
    scene = rt.Scene([rt.Surface(objects.plate(4, 4).apply_transform(at(3.0)), "concrete", "wall"), *seen(case, 0.0).surfaces])
    parts = simulator.paths(scene, RADAR, np.repeat(HERE, 3, 0), {"ball": moving})
    assert parts
    for part in parts:
        count, nodes = len(part), len(part.frequencies_hz)
        assert part.poses in (1, 3)
        assert count
        assert part.amplitude.shape == (count, nodes)
        assert np.iscomplexobj(part.amplitude)
        for vectors in (part.departure, part.arrival):
            assert vectors.shape == (count, 3)
            assert np.allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-6)
        for values in (part.pose, part.bounces, part.length_in_m, part.length_out_m, part.rate_mps):
            assert values.shape == (count,)
        assert np.issubdtype(part.pose.dtype, np.integer)
        assert (np.diff(part.pose) >= 0).all()
        assert part.pose.min() >= 0
        assert part.pose.max() < part.poses
        assert (part.bounces >= 1).all()
        assert (part.length_in_m > 0).all()
        assert (part.length_out_m > 0).all()
        for values in (part.amplitude, part.length_m, part.rate_mps):
            assert values.dtype in (np.float64, np.complex128)
            assert np.isfinite(values).all()


def test_recording_states_its_simulator_and_has_one_complex_frame_per_pose(case, simulator):
    recording = rt.simulate(rt.Scene([box()]), RADAR, np.repeat(HERE, 3, 0), simulator=simulator)
    assert simulator.name == recording.provenance["simulator"] == case.partition(" ")[0]
    assert CASES[case].items() <= recording.provenance.items()
    assert (recording.iq.shape, recording.iq.dtype) == ((3, 16, 2, 4, 256), np.complex64)
    assert np.isfinite(recording.iq).all()
    assert np.abs(recording.iq).max() > 0
    assert np.array_equal(recording.iq[0], recording.iq[2])


def test_static_scene_is_traced_for_one_pose_and_an_empty_one_has_no_paths(simulator):
    scene = rt.Scene([box(), rt.Surface(objects.plate(4, 4).apply_transform(at(3.0)), "wood", "wall")])
    assert {part.poses for part in simulator.paths(scene, RADAR, np.repeat(HERE, 5, 0))} == {1}
    iq = rt.simulate(rt.Scene([]), RADAR, np.repeat(HERE, 2, 0), simulator=simulator).iq
    assert iq.shape == (2, 16, 2, 4, 256)
    assert not iq.any()


def test_target_appears_at_its_range_and_on_its_side(case, simulator):
    """A target at a positive range has a positive beat frequency, and a target left of the boresight has a positive azimuth."""
    azimuth = np.radians(20)
    pose = at(2 * np.cos(azimuth), 2 * np.sin(azimuth))
    iq = rt.simulate(seen(case, azimuth), RADAR, HERE, motion={"ball": pose[None]}, simulator=simulator).iq[0]
    spectrum = profile(iq[0, 0])
    assert range_of(spectrum[0]) == pytest.approx(2.0, abs=0.08)
    index = int(np.abs(spectrum[0]).argmax())
    turn = np.polyfit(RADAR.rx_positions[:, 1], np.unwrap(np.angle(spectrum[:, index])), 1)[0]
    assert np.degrees(np.arcsin(-turn * WAVELENGTH / (2 * np.pi))) == pytest.approx(20, abs=1.5)


def test_wall_appears_at_its_range(simulator):
    wall = rt.Scene([rt.Surface(objects.plate(0.4, 0.4).apply_transform(at(3.0)), "metal", "wall", role="room")])
    iq = rt.simulate(wall, RADAR, HERE, simulator=simulator).iq
    assert range_of(profile(iq[0, 0, 0, 0])) == pytest.approx(3.0, abs=0.05)


def test_sphere_has_its_level(case, simulator):
    radius, distance = 0.05, 2.0
    iq = rt.simulate(ball(radius), RADAR, HERE, motion={"ball": at(distance)[None]}, simulator=simulator).iq
    expected = np.pi * radius**2 * WAVELENGTH**2 / ((4 * np.pi) ** 3 * distance**4)
    error, within = SPHERE_ERROR_DB[case]
    if error == -np.inf:
        assert not iq.any()
        return
    level = 20 * np.log10(np.abs(profile(iq[0, 0, 0, 0])).max()) - 10 * np.log10(expected)
    assert level == pytest.approx(error, abs=within)


def test_receding_target_has_its_speed(case, simulator):
    poses = np.array([at(2 + 0.2 * f / RADAR.frame_rate_hz) for f in range(3)])
    plate = rt.Scene([rt.Surface(objects.plate(0.1, 0.1), "metal", "plate")])
    iq = rt.simulate(plate, RADAR, HERE, motion={"plate": poses}, simulator=simulator).iq[1, :, 0, 0]
    spectrum = profile(iq, 256)
    chirps = spectrum[:, np.abs(spectrum[0]).argmax()]
    turn = np.angle((chirps[1:] * chirps[:-1].conj()).sum())
    speed = turn * WAVELENGTH / (4 * np.pi * RADAR.loop_interval_s)
    assert speed == pytest.approx(SPEED_READ.get(case, 0.2), rel=0.01)


def test_seed_decides_the_noise_and_nothing_else(plain):
    scene = rt.Scene([box(), rt.Surface(objects.plate(4, 4).apply_transform(at(3.0)), "wood", "wall")])
    moving = {"box": np.array([at(0, 0.01 * f) for f in range(2)])}
    first, again, other, quiet, still = (
        rt.simulate(scene, RADAR, HERE, motion=moving, simulator=plain, noise=noise, seed=seed).iq.tobytes()
        for noise, seed in ((True, 1), (True, 1), (True, 2), (False, 1), (False, 2))
    )
    assert first == again != other
    assert quiet == still != first


def digests(names):
    """Return the digests of the noisy samples that simulators compute for a ball in front of a rough wall."""
    wall = rt.Surface(objects.plate(3, 3).apply_transform(at(3.0)), "concrete", "wall", role="room", roughness_m=3e-4)
    scene, motion = rt.Scene([*ball().surfaces, wall]), {"ball": at(2.0)[None]}
    signals = (rt.simulate(scene, RADAR, HERE, motion=motion, simulator=name, noise=True).iq for name in names)
    return [hashlib.sha256(iq.tobytes()).hexdigest() for iq in signals]


@pytest.mark.parametrize("names", [tuple(SIMULATORS)[:-1], pytest.param(tuple(SIMULATORS)[-1:], marks=pytest.mark.slow)], ids=" ".join)
def test_processes_give_equal_bytes(names):
    code = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); from test_simulators import digests; print(*digests({names}))"
    outside = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True).stdout
    assert digests(names) == outside.split()


def broken(kind: str) -> trimesh.Trimesh:
    """Return a mesh with the given kind of defect, about 1 m in front of the radar."""
    if kind == "zero-area faces":
        corners = [[1, -0.2, -0.2], [1, 0.2, -0.2], [1, 0.2, 0.2], [1, -0.2, 0.2], [1, 0.1, -0.2]]
        return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3], [0, 1, 4]], process=False)
    if kind == "nothing but zero-area faces":
        return trimesh.Trimesh([[1, 0, 0], [1, 0.1, 0], [1, 0.2, 0], [1, 0, 0.1]], [[0, 1, 2], [0, 0, 3]], process=False)
    if kind == "coplanar duplicates":
        plate = objects.plate(0.3, 0.3).apply_transform(at(1.0))
        return objects.joined([plate, plate.copy()])
    if kind == "1 cm from a wall":
        return objects.plate(4, 4).apply_transform(at(0.01))
    return objects.plate(0.3, 0.3).apply_transform(at(1.0, 0, 0.15))  # the radar sees the plate along its edge


@pytest.mark.parametrize(
    "kind", ["zero-area faces", "nothing but zero-area faces", "coplanar duplicates", "1 cm from a wall", "edge on the boresight"]
)
def test_broken_meshes_stay_finite(plain, kind):
    for role in ("object", "room"):
        iq = rt.simulate(rt.Scene([rt.Surface(broken(kind), "metal", "m", role=role)]), RADAR, HERE, simulator=plain).iq
        assert np.isfinite(iq).all()
        if kind == "1 cm from a wall" and role == "object" and plain.name == "points":
            assert np.abs(iq).max() > 1  # a far-field cross-section is invalid in the near field, and returns more than was sent
        else:
            assert np.abs(iq).max() < 1


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: backend("sonar"), "simulator 'sonar' is not known; choose one of mitsuba"),
        (lambda: backend("points", grid=3), "simulator points has no setting 'grid'; it has cross_section"),
        (lambda: backend("rfgenesis", version="mended"), "version 'mended' is not one of shipped"),
        (lambda: backend("rfgenesis", grid=0), "grid must be a whole number from 1"),
        (lambda: backend("rfgenesis", fov_deg=180.0), "fov_deg must lie between"),
        (lambda: backend("points", cross_section="cube"), "cross_section 'cube' is not one of table"),
        (lambda: backend("points", step_deg=0), "step_deg must be above 0"),
        (lambda: backend("sionna", max_bounces=0), "max_bounces must be a whole number from 1 to 32, not 0"),
        (lambda: backend("sionna", separation_m=-0.1), "separation_m must be from 0 to 1 m, not -0.1"),
        (lambda: backend("sionna", diffraction=1), "diffraction must be True or False"),
        (lambda: rt.simulate(rt.Scene([]), RADAR, HERE, simulator="points", max_bounces=2), "max_bounces is read by simulator mitsuba"),
        (lambda: rt.simulate(rt.Scene([]), RADAR, HERE, simulator=3), "simulator must be one of mitsuba, rfgenesis, points, sionna or a"),  # type: ignore[arg-type]
        (lambda: rt.simulate(rt.Scene([]), RADAR, HERE, simulator=backend("mitsuba", rays=0)), "rays must be"),
        (lambda: rt.simulate(rt.Scene([box()]), RADAR, DRIVE, simulator=backend("rfgenesis", grid=4096)), "over 50_000_000"),
    ],
)
def test_wrong_settings_are_refused(make, match):
    with pytest.raises(InputError, match=match):
        make()


@pytest.mark.parametrize(
    ("overrides", "match"),
    [
        (["simulator=points", "simulator.grid=64"], "simulator.grid is not read by simulator=points; choose simulator=rfgenesis"),
        (["simulator.backend=points"], "contradicts simulator=mitsuba; choose simulator=points"),
        (["simulator=rfgenesis", "simulator.version=fixed"], "simulator.version=fixed is not known; options: shipped, corrected"),
        (["simulator=rfgenesis", "simulator.grid=null"], "simulator.grid.*not Optional"),
        (["simulator=rfgenesis", "simulator.fov_deg=190"], "simulator.fov_deg=190 must be below 180"),
        (["simulator=points", "simulator.room=panels"], "simulator.room=panels is not known; options: images, void"),
        (["simulator=sionna", "simulator.separation_m=2"], "simulator.separation_m=2 must be from 0 to 1"),
        (["simulator.elements=some"], "simulator.elements=some is not known; options: exact, planar"),
        (["simulator=sonar"], "simulator=sonar is not an option of simulator"),
    ],
)
def test_wrong_configurations_are_refused(overrides, match):
    with pytest.raises(ConfigError, match=match):
        compose(overrides)


def test_configuration_sets_the_backend_settings():
    from radartwin.builders.simulator import simulator_options

    given = {
        ("simulator=rfgenesis", "simulator.version=corrected", "simulator.grid=64"): backend("rfgenesis", version="corrected", grid=64),
        ("simulator=points", "simulator.step_deg=2"): backend("points", step_deg=2.0),
        ("simulator=sionna", "simulator.separation_m=0.03", "simulator.variant=llvm"): backend("sionna", separation_m=0.03, variant="llvm"),
    }
    for overrides, expected in given.items():
        assert simulator_options(compose(list(overrides)).simulator)["simulator"] == expected
    built = simulator_options(compose(["simulator.max_bounces=2", "simulator.rays=1000"]).simulator)["simulator"]
    assert (built.name, built.settings.max_bounces, built.settings.rays) == ("mitsuba", 2, 1000)


def test_run_key_depends_on_the_simulator_and_its_settings():
    choices = (
        "simulator=rfgenesis", "simulator=rfgenesis simulator.version=corrected", "simulator=points", "simulator=sionna",
        "simulator=sionna simulator.diffraction=true", "", "simulator.room=panels",
    )  # fmt: skip
    assert len({spec_digest(semantic(compose(choice.split()))) for choice in choices}) == len(choices)


@pytest.mark.parametrize("stage", ["experiments.turntable.environment", "experiments.campaign.twin"])
def test_run_key_depends_on_the_source_of_every_simulator(stage):
    assert {type(backend(name)).__module__ for name in SIMULATORS} <= closure((stage,))

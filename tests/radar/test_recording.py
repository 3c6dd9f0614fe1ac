"""Tests of recordings on the disk: identical bytes, amplitude scale, and files that are damaged or do not belong together."""

import dataclasses
import json
import os
import threading

import numpy as np
import pytest
from made_files import edit_json, noise, refused

from radartwin.errors import MissingError, OutputError, RecordingError
from radartwin.io import files
from radartwin.radar.captures import band_edge_db, load_capture
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording, refuse_foreign

RADAR = dataclasses.replace(Radar.iwr1843(), num_samples=64, num_chirps=8)
SHAPE = (3, 8, 2, 4, 64)


IQ = noise(RADAR, frames=3).iq
POSES = np.tile(np.eye(4), (3, 1, 1))
POSES[:, 0, 3] = np.linspace(0, 1 / 3, 3)


def test_load_returns_counts_times_scale_and_save_writes_the_same_bytes_in_either_order(tmp_path):
    recording = Recording(IQ, RADAR, POSES, provenance={"scene": "lab"})
    assert recording.save(tmp_path / "a") == 0
    described = json.loads((tmp_path / "a.json").read_text())
    counts = np.frombuffer((tmp_path / "a.bin").read_bytes(), "<i2").reshape(-1, 2, 2)
    loaded = Recording.load(tmp_path / "a")
    # I0 I1 Q0 Q1, decoded here without the package.
    expected = (counts[:, 0] + 1j * counts[:, 1]).reshape(SHAPE) * described["scale"]
    np.testing.assert_allclose(loaded.iq, expected, rtol=1e-6)
    assert Radar.from_dict(described["radar"]) == RADAR
    assert loaded.radar == RADAR
    assert loaded.provenance == {"scene": "lab"}
    np.testing.assert_array_equal(loaded.sensor_poses, POSES)
    loaded.save(str(tmp_path / "sub" / "b"))
    assert (tmp_path / "sub" / "b.bin").read_bytes() == (tmp_path / "a.bin").read_bytes()
    assert (tmp_path / "sub" / "b.json").read_bytes() == (tmp_path / "a.json").read_bytes()
    loaded.save(tmp_path / "run.0.5m", iq_swapped=True)
    assert sorted(p.name for p in tmp_path.glob("run*")) == ["run.0.5m.bin", "run.0.5m.json"]
    np.testing.assert_array_equal(np.frombuffer((tmp_path / "run.0.5m.bin").read_bytes(), "<i2").reshape(-1, 2, 2), counts[:, ::-1])
    for name in ("run.0.5m", "run.0.5m.bin", "run.0.5m.json"):
        again = Recording.load(tmp_path / name)
        assert again.iq_swapped
        np.testing.assert_array_equal(again.iq, loaded.iq)


@pytest.mark.parametrize("real", [False, True])
def test_the_peak_is_near_half_of_full_scale_unless_a_scale_is_given(tmp_path, real):
    iq = IQ.real + 0j if real else IQ
    recording = Recording(iq, dataclasses.replace(RADAR, real_sampling=real))
    recording.save(tmp_path / "a")
    counts = np.frombuffer((tmp_path / "a.bin").read_bytes(), "<i2")
    assert counts.size == np.prod(SHAPE) * (1 if real else 2)
    assert 0.45 * 32767 < np.abs(counts).max() < 0.55 * 32767
    assert np.abs(Recording.load(tmp_path / "a").iq - recording.iq).max() <= recording.scale
    rounded = np.rint(np.stack([iq.real, iq.imag]).astype(np.float32) / 1e-9)
    clipped = int(np.count_nonzero((rounded > 32767) | (rounded < -32768)))
    assert Recording(iq, recording.radar, scale=1e-9).save(tmp_path / "b") == clipped > 0
    assert Recording.load(tmp_path / "b").saturated == clipped
    assert json.loads((tmp_path / "b.json").read_text())["scale"] == 1e-9


@pytest.mark.parametrize(
    ("iq", "poses", "message"),
    [
        (np.zeros((0, 8, 2, 4, 64)), None, "zero frames"),
        (np.zeros((3, 8, 2, 4, 63)), None, "iq must be"),
        (np.zeros((8, 2, 4, 64)), None, "iq must be"),
        (np.zeros(SHAPE), np.eye(4), "sensor_poses"),
        (np.zeros(SHAPE), np.zeros((2, 4, 4)), "sensor_poses"),
    ],
)
def test_samples_or_poses_of_another_shape_are_refused(iq, poses, message):
    refused([message], Recording, iq, RADAR, poses, error=RecordingError)


DAMAGE = [
    (lambda s: os.truncate(s.with_suffix(".bin"), 1000), RecordingError, ("a.bin", "truncated")),
    ({"radar": dataclasses.replace(RADAR, num_samples=100).to_dict()}, RecordingError, ("a.bin", "another radar")),
    (lambda s: s.with_suffix(".bin").write_bytes(b""), RecordingError, ("a.bin", "zero frames")),
    (lambda s: s.with_suffix(".json").unlink(), MissingError, ("a.json",)),
    (lambda s: s.with_suffix(".bin").unlink(), MissingError, ("a.bin",)),
    (lambda s: s.with_suffix(".json").write_text("{"), RecordingError, ("a.json: line 1",)),
    (lambda s: s.with_suffix(".json").write_text("[]"), RecordingError, ("a.json",)),
    (lambda s: s.with_suffix(".json").write_bytes(b"\xff\xfe\x00"), RecordingError, ("a.json",)),
]
VALUES = [
    ({"sensor_poses": np.full((1, 4, 4), np.nan).tolist()}, ("sensor_poses", "frame 0", "rigid")),
    ({"sensor_poses": [np.eye(4).tolist(), (2 * np.eye(4)).tolist(), np.eye(4).tolist()]}, ("sensor_poses", "frame 1", "rigid")),
    ({"sensor_poses": [np.diag([1.0, 1.0, -1.0, 1.0]).tolist()]}, ("sensor_poses", "rigid")),
    ({"sensor_poses": "x"}, ("sensor_poses",)),
    ({"sensor_poses": [[1, 2]]}, ("sensor_poses",)),
    ({"format": "radartwin recording 9"}, ("format", "recording 9")),
    ({"iq_swapped": "false"}, ("iq_swapped",)),
    ({"scale": 1e300}, ("scale",)),
    ({"scale": "1"}, ("scale",)),
    ({"radar": ...}, ("radar",)),
    ({"radar": 5}, ("radar", "mapping")),
    ({"frames": 2}, ("3 frames", "a.json says 2")),
    ({"provenance": 5}, ("a.json",)),
    ({"saturated": float("inf")}, ("a.json",)),
]


@pytest.mark.parametrize(
    ("damage", "error", "words"), [*DAMAGE, *((changes, RecordingError, ("a.json", *words)) for changes, words in VALUES)]
)
@pytest.mark.filterwarnings("error")
def test_damaged_recording_is_refused_by_one_line_that_names_its_file(tmp_path, damage, error, words):
    stem = tmp_path / "a"
    Recording(IQ, RADAR, POSES).save(stem)
    edit_json(stem.with_suffix(".json"), **damage) if isinstance(damage, dict) else damage(stem)
    for load in (Recording.load, load_capture):
        refused(words, load, stem, error=error)


def test_unwritable_folder_is_named_and_no_file_remains(tmp_path):
    (tmp_path / "file").write_text("not a folder")
    refused(["file"], Recording(IQ, RADAR).save, tmp_path / "file" / "a", error=OutputError)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_failed_save_leaves_the_older_recording_unchanged(tmp_path):
    Recording(IQ, RADAR).save(tmp_path / "a")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    broken = IQ.copy()
    broken[2, 7, 1, 3, 63] = np.nan
    refused(["NaN"], Recording(broken, RADAR, scale=1e-9).save, tmp_path / "a", error=RecordingError)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_files_of_two_processes_that_save_one_recording_are_not_mixed(tmp_path):
    Recording(np.ones(SHAPE, np.complex64), RADAR, scale=1.0).save(tmp_path / "a")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    saving = threading.Thread(target=Recording(np.full(SHAPE, 2, np.complex64), RADAR, scale=2.0).save, args=[tmp_path / "a"])
    with files.lock(tmp_path / ".a.bin.lock"):  # as another process that replaces the files
        saving.start()
        saving.join(1.0)
        assert saving.is_alive()
        assert before.items() <= {p.name: p.read_bytes() for p in tmp_path.iterdir()}.items()
    saving.join()
    assert Recording.load(tmp_path / "a").scale == 2.0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.bin", "a.json"]


def test_unsigned_cube_is_read_as_signed_counts(tmp_path):
    rng = np.random.default_rng(3)
    counts = rng.integers(-500, 500, size=(2, *SHAPE[1:]))
    cube = (counts[0] % 65536) + 1j * (counts[1] % 65536)
    np.save(tmp_path / "cube.npy", cube.reshape(8, 8, 64))
    loaded = load_capture(tmp_path / "cube.npy", RADAR)
    np.testing.assert_array_equal(loaded.iq[0], counts[0] + 1j * counts[1])


CUBES = [  # without arrays, the file is text
    ({"iq": np.zeros((8, 8, 60), complex)}, RADAR, "does not fit radar"),
    ({"iq": np.ones((3, 2, 8, 4, 64), complex)}, RADAR, "does not fit radar"),  # tx before chirp
    ({"iq": np.ones((3, 4, 16, 64), complex)}, RADAR, "does not fit radar"),  # rx before chirp
    ({"iq": np.zeros((0, 8, 2, 4, 64), complex)}, RADAR, "zero frames"),
    ({"cube": np.zeros((2, 2), complex)}, RADAR, "it has no array iq"),
    ({"iq": np.zeros((2, 2))}, RADAR, "expected complex samples, or int16"),
    ({"iq": np.ones(SHAPE, np.complex64), "poses": np.eye(3)}, RADAR, "sensor_poses must be"),
    ({}, None, "does not name its radar; give it as radar"),
    ({}, RADAR, "cube.npy is not a readable"),
]


@pytest.mark.parametrize(("arrays", "radar", "words"), CUBES)
def test_cube_that_is_no_recording_of_the_radar_is_refused(tmp_path, arrays, radar, words):
    path = tmp_path / ("cube.npz" if arrays else "cube.npy")
    np.savez(path, **arrays) if arrays else path.write_text("no array")
    refused([words], load_capture, path, radar, error=RecordingError)


@pytest.mark.parametrize("value", [np.nan, 1e300j])
def test_first_frame_with_a_sample_that_is_not_finite_is_named(tmp_path, inside, value):
    iq = np.ones(SHAPE, complex)
    iq[1:, 0, 1, 2, 3] = value
    np.save(tmp_path / "cube.npy", iq)
    (tmp_path / "radar.json").write_text(json.dumps(RADAR.to_dict()))
    for words in (["process", "cube.npy"], ["export", "cube.npy", "--mcap", "a.mcap"]):
        done = inside(*words, "--radar", "radar.json")
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == "radartwin: cube.npy: frame 1 holds NaN or infinite samples; record or simulate it again\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cube.npy", "radar.json"]


def test_order_of_i_and_q_follows_from_the_receive_filter(tmp_path):
    radar = dataclasses.replace(Radar.iwr1843(), num_chirps=64)
    rng = np.random.default_rng(5)
    shape = (1, 64, 2, 4, 256)
    spectrum = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    spectrum[..., 231:] *= 0.3  # weak noise above 0.9 fs
    spectrum[:, :, :, :, 200] += 40.0  # an echo in the upper half of the spectrum, which must not affect the detection of exchanged I and Q
    samples = np.fft.ifft(spectrum, axis=-1) * 2000
    assert band_edge_db(samples[0]) > 5
    for swapped in (False, True):
        counts = np.stack([samples.imag, samples.real] if swapped else [samples.real, samples.imag])
        np.save(tmp_path / "cube.npy", np.rint(counts[0]) + 1j * np.rint(counts[1]))
        loaded = load_capture(tmp_path / "cube.npy", radar)
        assert loaded.iq_swapped is swapped
        np.testing.assert_allclose(loaded.iq, np.rint(samples.real) + 1j * np.rint(samples.imag))


def test_files_of_other_programs_are_refused_and_own_recordings_are_not(tmp_path):
    refuse_foreign(tmp_path / "new")
    Recording(IQ, RADAR, POSES).save(tmp_path / "own")
    refuse_foreign(tmp_path / "own")
    (tmp_path / "capture.bin").write_bytes(b"samples")
    for text in ("", "{}", "[1]", '{"format": "another"}', '{"format": 1}'):
        (tmp_path / "capture.json").write_text(text)
        words = ["capture.bin or capture.json exists and is no recording of RadarTwin"]
        refused(words, refuse_foreign, tmp_path / "capture.bin", error=OutputError)

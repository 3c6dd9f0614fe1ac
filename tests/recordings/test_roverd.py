"""Import traces of the roverd format, in which RadarML publishes I/Q-1M, and cubes with poses.

The traces are written by hand from the published description, with a waveform like that of the data set but fewer samples.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from made_files import edit_json

from radartwin.radar import roverd
from radartwin.recordings.recording_set import RecordingSet

CHIRPS, TX, RX, SAMPLES, FRAMES = 8, 3, 4, 64, 6
WAVEFORM = {
    "device": "AWR1843", "port": "/dev/ttyACM0", "frequency": 77.0, "idle_time": 200.0, "adc_start_time": 5.7, "ramp_end_time": 59.0,
    "tx_start_time": 1.0, "freq_slope": 67.012, "adc_samples": SAMPLES, "sample_rate": 5000, "frame_length": CHIRPS, "frame_period": 50.0,
}  # fmt: skip
FRAME_BYTES = CHIRPS * TX * RX * SAMPLES * 4
ABOUT = ["object=none", "room=baker", "motion=other", "licence=CC-BY-4.0", "who=RadarML", "sensor=AWR1843BOOST", "when=2025"]
START_S = 1.7e9


def echoes() -> np.ndarray:
    """Return whole counts [frame, chirp, tx, rx, sample] of an echo at 2 m with noise."""
    rng = np.random.default_rng(0)
    distance, slope, rate = 2.0, 67.012e12, 5e6
    beat = np.exp(2j * np.pi * slope * 2 * distance / 299_792_458.0 * np.arange(SAMPLES) / rate)
    noise = rng.normal(size=(2, FRAMES, CHIRPS, TX, RX, SAMPLES))
    return np.rint((800 * beat + noise[0]).real) + 1j * np.rint((800 * beat + noise[0]).imag + noise[1])


def write_trace(trace: Path, iq: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Write a trace, and return the values of its channel iq (F, chirp, tx, rx, 2 * sample)."""
    raw = np.empty((*iq.shape[:-1], 2 * SAMPLES), "<i2")
    for lane in (0, 1):  # Q0 Q1 I0 I1
        raw[..., lane::4], raw[..., lane + 2 :: 4] = np.imag(iq)[..., lane::2], np.real(iq)[..., lane::2]
    (trace / "radar").mkdir(parents=True)
    (trace / "lidar").mkdir()
    (trace / "lidar" / "rng").write_bytes(b"not a radar")
    raw.tofile(trace / "radar" / "iq")
    (START_S + 0.05 * np.arange(len(iq))).tofile(trace / "radar" / "ts")
    channels = {"iq": {"format": "raw", "type": "i2", "shape": [CHIRPS, TX, RX, 2 * SAMPLES], "desc": "Raw I/Q stream."}}
    (trace / "radar" / "meta.json").write_text(json.dumps(channels))
    (trace / "config.yaml").write_text(yaml.safe_dump({"radar": {"type": "radar", "args": {"radar": WAVEFORM, "capture": {}}}}))
    if mask is not None:
        count = int(mask.sum())
        pos, rot = np.outer(np.arange(count), [0.1, 0, 0]), np.tile(np.eye(3), (count, 1, 1))
        (trace / "_radar").mkdir()
        np.savez(trace / "_radar" / "pose.npz", mask=mask, t=START_S + 0.05 * np.flatnonzero(mask), pos=pos, vel=pos, acc=pos, rot=rot)
    return raw


def test_imported_trace_has_the_samples_radar_and_poses_of_the_trace(tmp_path: Path, inside) -> None:
    iq = echoes()
    mask = np.array([False, True, True, True, True, False])
    raw = write_trace(tmp_path / "data" / "baker.1.fwd", iq, mask)
    done = inside("import", "data", "--out", "set", *ABOUT)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "set: 1 recording added, 1 in all\n"
    assert "2 of 6 frames have no pose" in done.stderr
    (row, recording) = next(RecordingSet.load(tmp_path / "set").recordings())
    assert row.recording == "baker.1.fwd"
    assert row.extra == {"started": "2023-11-14T22:13:20+00:00", "lost_packets": "0"}
    assert (tmp_path / "set/recordings/baker.1.fwd.bin").read_bytes() == raw[1:5].tobytes()
    np.testing.assert_array_equal(recording.iq, iq[1:5])
    np.testing.assert_allclose(np.asarray(recording.sensor_poses)[:, 0, 3], [0, 0.1, 0.2, 0.3])
    radar = recording.radar
    assert (radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples) == (CHIRPS, TX, RX, SAMPLES)
    assert radar.start_frequency_hz == pytest.approx(77e9 + 67.012e12 * 5.7e-6)
    assert (radar.chirp_interval, radar.frame_rate_hz) == (pytest.approx(259e-6), pytest.approx(20.0))
    assert inside("doctor", "--data", "set").returncode == 0
    assert inside("process", "set/recordings/baker.1.fwd").returncode == 0
    peaks = (tmp_path / "outputs/processed/baker.1.fwd/peaks.csv").read_text().splitlines()
    assert float(peaks[1].split(",")[0]) == pytest.approx(2.0, abs=radar.range_resolution_m / 2)


def test_chosen_frames_are_imported(tmp_path: Path, inside) -> None:
    iq = echoes()
    write_trace(tmp_path / "walk", iq)
    assert inside("import", "walk", "--out", "set", "--frames", "2:4", *ABOUT).returncode == 0
    row, recording = next(RecordingSet.load(tmp_path / "set").recordings())
    np.testing.assert_array_equal(recording.iq, iq[2:4])
    assert row.recording == "walk"
    assert recording.sensor_poses is None
    for words in ("4:2", "x:2", "3"):
        assert inside("import", "walk", "--out", "other", "--frames", words, *ABOUT).returncode == 2
    done = inside("import", "walk", "--out", "other", "--frames", "9:", *ABOUT)
    assert done.returncode == 2
    assert "it has 6 frames, none of which is chosen; choose others with --frames" in done.stderr


def test_older_type_names_lost_frames_and_gaps_are_accepted(tmp_path: Path, inside) -> None:
    iq = np.tile(echoes(), (30, 1, 1, 1, 1))[:170]
    iq[3] = 0
    write_trace(tmp_path / "trace", iq)
    meta = tmp_path / "trace/radar/meta.json"
    meta.write_text(meta.read_text().replace('"i2"', '"i16"'))
    times = START_S + 0.05 * np.arange(len(iq))
    times[100:] += 1
    times.tofile(tmp_path / "trace/radar/ts")
    done = inside("import", "trace", "--out", "set", *ABOUT)
    assert "1 of 170 frames hold lost packets, which are zeros" in done.stderr
    assert "frames are missing at 1 places" in done.stderr
    assert inside("doctor", "--data", "set").returncode == 0


def remove_pose(trace: Path) -> None:
    stored = dict(np.load(trace / "_radar/pose.npz"))
    np.savez(trace / "_radar/pose.npz", **stored | {"mask": stored["mask"][:-1]})


RAW = {"format": "raw", "type": "i2", "shape": [CHIRPS, TX, RX, 2 * SAMPLES]}


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda t: (t / "radar/meta.json").unlink(), "meta.json: no such file"),
        (lambda t: edit_json(t / "radar/meta.json", iq=None), "no channel iq"),
        (lambda t: edit_json(t / "radar/meta.json", iq={**RAW, "type": "i4"}), "no channel iq of format raw and type i2"),
        (lambda t: edit_json(t / "radar/meta.json", iq={**RAW, "shape": [CHIRPS, TX, RX, SAMPLES]}), "iq has shape [8, 3, 4, 64], not"),
        (lambda t: (t / "radar/iq").write_bytes((t / "radar/iq").read_bytes()[:-5]), f"after 5 frames, {FRAME_BYTES - 5} are left over"),
        (lambda t: (t / "radar/iq").write_bytes(b""), "it is empty, zero frames"),
        (lambda t: (t / "radar/ts").unlink(), "ts: no such file"),
        (lambda t: (t / "radar/ts").write_bytes((t / "radar/ts").read_bytes()[:-8]), "ts holds 5 times"),
        (lambda t: (t / "config.yaml").unlink(), "config.yaml: no such file"),
        (lambda t: (t / "config.yaml").write_text("radar: {args: 3}"), "config.yaml"),
        (lambda t: (t / "config.yaml").write_text("radar: {args: {radar: {device: AWR1843}}}"), "radar.args.radar has no 'freq_slope'"),
        (lambda t: (t / "config.yaml").write_text("radar: {args: {radar: {device: X9}}}"), "no 'X9', or it is no known device"),
        (remove_pose, "mask has 5 values"),
        (lambda t: (t / "_radar/pose.npz").write_bytes(b"PK"), "pose.npz"),
    ],
)
def test_damaged_trace_is_refused_in_one_line(tmp_path: Path, inside, damage, words: str) -> None:
    trace = tmp_path / "trace"
    write_trace(trace, echoes(), np.ones(FRAMES, bool))
    damage(trace)
    done = inside("import", "trace", "--out", "set", *ABOUT)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert words in done.stderr
    assert not (tmp_path / "set").exists()


def test_incomplete_end_can_be_dropped(tmp_path: Path, inside) -> None:
    write_trace(tmp_path / "trace", echoes())
    channel = tmp_path / "trace/radar/iq"
    channel.write_bytes(channel.read_bytes()[:-5])
    done = inside("import", "trace", "--out", "set", "--cut", *ABOUT)
    assert done.returncode == 0, done.stderr
    assert "the last frame is incomplete and dropped" in done.stderr
    assert next(RecordingSet.load(tmp_path / "set").recordings())[1].num_frames == FRAMES - 1


def test_given_radar_reads_a_trace_and_cubes_with_poses(tmp_path: Path, inside) -> None:
    """The cubes are complex samples in .npy with a CSV of poses, and int16 I and Q in .npz with poses."""
    iq = echoes()
    write_trace(tmp_path / "trace", iq)
    (tmp_path / "radar.yaml").write_text(yaml.safe_dump(json.loads(json.dumps(roverd.radar_of(tmp_path / "trace").to_dict()))))
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 0, 3] = 0.01 * np.arange(FRAMES)
    np.save(tmp_path / "complex.npy", iq.astype(np.complex64))
    np.savez(tmp_path / "pairs.npz", iq=np.stack([np.real(iq), np.imag(iq)], axis=-1).astype(np.int16), poses=poses)
    lines = [f"{0.05 * n},{0.01 * n},0,0,0,0,0,1" for n in range(FRAMES)]
    (tmp_path / "poses.csv").write_text("\n".join(["t,x,y,z,qx,qy,qz,qw", *lines]))
    common = ("--out", "set", "--radar", "radar.yaml", "--frames", "1:5")
    (tmp_path / "trace/config.yaml").unlink()  # the given radar replaces the configuration
    assert inside("import", "trace", *common, *ABOUT, "repetition=2").returncode == 0
    assert inside("import", "complex.npy", *common, *ABOUT, "trajectory=poses.csv").returncode == 0
    assert inside("import", "pairs.npz", *common, *ABOUT, "repetition=1").returncode == 0
    assert inside("doctor", "--data", "set").returncode == 0
    recordings = [recording for _, recording in RecordingSet.load(tmp_path / "set").recordings()]
    assert [recording.sensor_poses is None for recording in recordings] == [True, False, False]  # the trace has none
    for recording in recordings:
        np.testing.assert_array_equal(recording.iq, iq[1:5])
    for recording in recordings[1:]:
        np.testing.assert_allclose(np.asarray(recording.sensor_poses), poses[1:5], atol=1e-12)

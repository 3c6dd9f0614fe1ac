"""Import mmWave Studio captures with their logs, in several parts or cut short, and import folders of captures with a mapping file."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path

import numpy as np
import pytest
from made_files import log_text, noise, refused, studio_json

from radartwin.errors import InputError, MissingError, RecordingError, UserError
from radartwin.radar import dca1000
from radartwin.radar.captures import load_capture
from radartwin.radar.chirp import Radar
from radartwin.radar.studio_log import PACKET_BYTES, find_log
from radartwin.recordings.examine import examine
from radartwin.recordings.importers import find_captures, import_captures, key_values, read_capture
from radartwin.recordings.mapping import CaptureMap, Entry, read_mapping
from radartwin.recordings.recording_set import RecordingSet

# A frame has 65536 bytes, which are 45.01 packets, so packets cross frame boundaries as in real captures.
RADAR = dataclasses.replace(Radar.iwr1843(), num_samples=128, num_chirps=16)
FRAME = dca1000.frame_bytes(RADAR)
BOARD = "board: IWR1843BOOST, assumed"
CARD = {"licence": "MIT", "sensor": "IWR1843BOOST", "who": "A. Researcher", "when": "2026-03-01"}
MUG = {"object": "mug", "distance_m": "1.5", "room": "lab", "motion": "turntable"}


def counts(frames: int, seed: int = 0) -> bytes:
    rng = np.random.default_rng(seed)
    return np.rint(300 * rng.normal(size=frames * FRAME // 2)).astype("<i2").tobytes()


def packets(frames: int) -> int:
    return -(-frames * FRAME // PACKET_BYTES)


def capture(folder: Path, name: str = "adc_data", frames: int = 4, seed: int = 0, log: bool = True) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.bin").write_bytes(counts(frames, seed))
    (folder / "radar.mmwave.json").write_text(studio_json(frames))
    if log:
        (folder / f"{name}_LogFile.csv").write_text(log_text(packets(frames)))
    return folder / f"{name}.bin"


def test_imported_capture_keeps_its_bytes_and_the_values_of_its_log(tmp_path: Path) -> None:
    source, notes = capture(tmp_path / "raw"), []
    made, added = import_captures(source, tmp_path / "set", {**CARD, **MUG, "operator": "ann"}, say=notes.append)
    assert notes == [BOARD]
    assert (tmp_path / "set" / "recordings" / "adc_data.bin").read_bytes() == source.read_bytes()
    assert added == made.rows
    assert added[0].extra == {"started": "2026-03-02T09:05:07", "lost_packets": "0", "operator": "ann"}
    assert made.card.units == "counts"
    assert made.card.name == "set"
    recording = made.read(added[0])
    assert dataclasses.replace(recording.radar, name="iwr1843") == RADAR
    assert recording.provenance["log"]["received"] == packets(4)
    assert recording.provenance["frames"] == {"configured": 4, "logged": 4}
    report = examine(tmp_path / "set")
    assert (report.problems, report.notes) == ([], [])


def test_lost_packets_are_reported_and_stored(tmp_path: Path) -> None:
    source = capture(tmp_path / "raw", frames=300)
    data = bytearray(source.read_bytes())
    lost = (7 * FRAME // PACKET_BYTES + 2, 200 * FRAME // PACKET_BYTES + 40)
    for packet in lost:
        data[packet * PACKET_BYTES : (packet + 1) * PACKET_BYTES] = bytes(PACKET_BYTES)
    source.write_bytes(data)
    source.with_name("adc_data_LogFile.csv").write_text(log_text(packets(300) - 2, lost=2))
    notes: list[str] = []
    _, added = import_captures(source, tmp_path / "set", {**CARD, **MUG}, say=notes.append)
    assert notes == [
        f"adc_data: 2 of {packets(300)} packets were lost ({2 * PACKET_BYTES} bytes of zeros)",
        "adc_data: 2 packets were out of sequence",
        BOARD,
        "adc_data: 2 of 300 frames hold lost packets, which are zeros: frame 7, 200",
    ]
    assert added[0].extra["lost_packets"] == "2"
    report = examine(tmp_path / "set")
    assert report.problems == []
    assert "2 of 300 frames have lost samples" in str(report.notes[0])


def test_missing_frames_and_a_missing_log_are_reported_and_the_only_log_is_used(tmp_path: Path) -> None:
    source = capture(tmp_path / "raw", frames=4)
    source.write_bytes(source.read_bytes()[: 3 * FRAME])
    recording, _, notes = read_capture(source)
    assert recording.num_frames == 3
    assert notes == ["frames are missing: the capture holds 3 frames, 4 configured, 4 logged", BOARD]
    _, columns, notes = read_capture(capture(tmp_path, log=False))
    assert columns == {}
    assert ["no LogFile.csv" in note for note in notes] == [True, False]
    first, second = capture(tmp_path / "two", "one"), capture(tmp_path / "two", "two")
    assert find_log(first) == first.with_name("one_LogFile.csv")
    second.with_name("two_LogFile.csv").unlink()
    assert find_log(second) is None
    first.unlink()
    assert find_log(second) == first.with_name("one_LogFile.csv")  # the only capture and the only log


def test_incomplete_last_frame_is_refused_or_dropped_on_request(tmp_path: Path) -> None:
    source = capture(tmp_path / "raw")
    source.write_bytes(source.read_bytes()[:-1000])
    words = ("frames of 65536 bytes ", ": after 3 frames, 64536 are left over; ", "radar description", "--cut")
    refused(words, import_captures, source, tmp_path / "set", {**CARD, **MUG}, error=RecordingError)
    assert not (tmp_path / "set").exists()
    notes: list[str] = []
    made, added = import_captures(source, tmp_path / "set", {**CARD, **MUG}, cut=True, say=notes.append)
    assert made.read(added[0]).num_frames == 3
    assert "incomplete and dropped (64536 of 65536 bytes)" in "; ".join(notes)
    source.write_bytes(b"")
    refused(["it is empty, zero frames"], read_capture, source, cut=True, error=RecordingError)


def test_parts_of_a_capture_become_one_recording(tmp_path: Path) -> None:
    whole = counts(24)
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw" / "radar.mmwave.json").write_text(studio_json(24))
    (tmp_path / "raw" / "mug_Raw_LogFile.csv").write_text(log_text(packets(24)))
    cuts = [len(whole) * n // 11 // 4 * 4 for n in range(12)]  # not at frame boundaries; eleven parts test the numeric order of 9 and 10
    for n in range(11):
        (tmp_path / "raw" / f"mug_Raw_{n}.bin").write_bytes(whole[cuts[n] : cuts[n + 1]])
    assert find_captures(tmp_path / "raw") == [tmp_path / "raw" / "mug_Raw_0.bin"]
    assert find_captures(tmp_path / "raw" / "mug_Raw_3.bin") == [tmp_path / "raw" / "mug_Raw_0.bin"]
    notes: list[str] = []
    _, added = import_captures(tmp_path / "raw", tmp_path / "set", {**CARD, **MUG}, say=notes.append)
    assert notes == [BOARD]
    assert added[0].recording == "mug"
    assert (tmp_path / "set" / "recordings" / "mug.bin").read_bytes() == whole
    for n in (0, 3):
        loaded = load_capture(tmp_path / "raw" / f"mug_Raw_{n}.bin")
        np.testing.assert_array_equal(loaded.iq, RecordingSet.load(tmp_path / "set").read(added[0]).iq)
    (tmp_path / "raw" / "mug_Raw_4.bin").unlink()
    words = ("mug_Raw_4.bin is missing", "up to 10")
    refused(words, import_captures, tmp_path / "raw", tmp_path / "again", {**CARD, **MUG}, error=MissingError)
    refused(words, load_capture, tmp_path / "raw" / "mug_Raw_0.bin", error=MissingError)
    np.save(tmp_path / "raw" / "cube_Raw_0.npy", np.ones(3))
    assert find_captures(tmp_path / "raw" / "cube_Raw_0.npy") == [tmp_path / "raw" / "cube_Raw_0.npy"]


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """Write captures of two objects at two distances with two runs each, in folders with these names, and a mapping file that is not yet
    filled in.
    """
    for i, (thing, distance, run) in enumerate((o, d, n) for o in ("mug", "can") for d in ("0.5", "1") for n in (1, 2)):
        capture(tmp_path / "raw" / f"{thing}_{distance}m", f"run{run}", seed=i)
    (tmp_path / "map.yaml").write_text(
        "card: {licence: MIT, sensor: IWR1843BOOST, who: A. Researcher, when: 2026-03-01}\n"
        "captures:\n"
        '  - {file: "**", room: lab, motion: turntable, split: train}\n'
        '  - {file: "{object}_{distance_m}m/run{repetition}"}\n'
        "  - {file: can_1m/run2.bin, split: test}\n"
    )
    return tmp_path


def test_mapping_assigns_conditions_to_the_captures_of_a_campaign(campaign: Path) -> None:
    made, added = import_captures(campaign / "raw", campaign / "set", mapping=read_mapping(campaign / "map.yaml"))
    assert len(added) == 8
    assert [row.recording for row in made.select(object="can", distance_m=1)] == ["can_1m_run1", "can_1m_run2"]
    assert [row.recording for row in made.select(split="test")] == ["can_1m_run2"]
    assert made.card.when == "2026-03-01"
    stored = made.folder / "recordings" / f"{made.select(object='mug', distance_m=0.5, repetition=2)[0].recording}.bin"
    assert stored.read_bytes() == (campaign / "raw/mug_0.5m/run2.bin").read_bytes()
    assert examine(made.folder).problems == []


def test_interrupted_import_continues(campaign: Path) -> None:
    mapping = read_mapping(campaign / "map.yaml")
    broken = campaign / "raw/mug_0.5m/run1.bin"
    data = broken.read_bytes()
    broken.write_bytes(data[:-1])
    refused(["mug_0.5m/run1.bin"], import_captures, campaign / "raw", campaign / "set", mapping=mapping, error=RecordingError)
    assert len(RecordingSet.load(campaign / "set")) == 4
    broken.write_bytes(data)
    notes: list[str] = []
    made, added = import_captures(campaign / "raw", campaign / "set", mapping=mapping, say=notes.append)
    assert (len(added), len(made)) == (4, 8)
    assert notes == [f"4 of 8 captures are already in {campaign / 'set'}", BOARD]
    assert import_captures(campaign / "raw", campaign / "set", mapping=mapping)[1] == []


def test_second_capture_of_the_same_name_is_refused_unless_its_conditions_are_equal(tmp_path: Path, inside) -> None:
    def words(folder: str, *more: str) -> list[str]:
        conditions = {**CARD, **MUG, "distance_m": "2.5" if folder == "b" else "1.5"}
        return ["import", f"{folder}/adc_data.bin", "--out", "set", *(f"{key}={value}" for key, value in conditions.items()), *more]

    for seed, folder in enumerate("ab"):
        capture(tmp_path / folder, seed=seed)
    assert inside(*words("a")).returncode == 0
    assert inside(*words("a")).stdout == "set: 0 recordings added, 1 in all\n"
    done = inside(*words("b"))
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "radartwin: b/adc_data.bin: set holds another recording adc_data (mug, 1.5 m, lab, turntable, repetition 0); add recording=NAME "
        "to the command or to a mapping file\n"
    )
    assert inside(*words("b", "recording=later")).returncode == 0
    assert [row.distance_m for row in RecordingSet.load(tmp_path / "set")] == [1.5, 2.5]


def test_mapping_skips_captures_without_an_entry(campaign: Path) -> None:
    (campaign / "map.yaml").write_text(
        "captures:\n- {file: can_1m/run1, object: can, distance_m: 1, room: lab, motion: depth, trajectory: drive.txt}\n"
        "- {file: mug_1m/run*, object: mug, distance_m: 1, room: lab, motion: lateral}\n"
    )
    (campaign / "raw" / "drive.txt").write_text("0 0 0 0 0 0 0 1\n5 1 0 0 0 0 0 1\n")
    notes: list[str] = []
    made, added = import_captures(campaign / "raw", campaign / "set", CARD, read_mapping(campaign / "map.yaml"), say=notes.append)
    assert [(row.recording, row.repetition) for row in added] == [("can_1m_run1", 0), ("mug_1m_run1", 0), ("mug_1m_run2", 1)]
    assert "5 of 8 captures match no entry" in notes[0]
    poses = np.asarray(made.read(added[0]).sensor_poses)
    np.testing.assert_allclose(poses[:, 0, 3], [0, 0.02, 0.04, 0.06], atol=1e-12)
    assert examine(made.folder).problems == []


MISTAKES = {
    "an entry without a capture": ([Entry("bottle*", MUG)], "no capture matches 'bottle\\*' of the mapping; there are can_0.5m/run1.bin"),
    "a column twice in a pattern": ([Entry("{object}_{object}m/run1", MUG)], "object"),
    "two captures with the same conditions": ([Entry("**", {**MUG, "repetition": "0"})], "same object, distance, room, motion"),
    "a distance that is not a number": ([Entry("{object}_{distance_m}/run{repetition}", {**MUG, "distance_m": "near"})], "'near'"),
    "a trajectory outside the folder": ([Entry("**", {**MUG, "trajectory": "../outside.txt"})], "'../outside.txt' outside this folder"),
    "a trajectory that is no track": ([Entry("**", {**MUG, "trajectory": "can_1m/run1.bin"})], r"can_1m/run1\.bin"),
    "a missing trajectory": ([Entry("**", {**MUG, "trajectory": "drive.txt"})], "raw/drive.txt: no such file"),
    "an entry without columns": ([Entry("**", {})], "column object is missing; column room is missing; column motion is missing"),
}


@pytest.mark.parametrize(("entries", "words"), MISTAKES.values(), ids=MISTAKES)
def test_invalid_mapping_is_refused_before_a_capture_is_read(campaign: Path, entries: list[Entry], words: str) -> None:
    with pytest.raises(UserError, match=words):
        import_captures(campaign / "raw", campaign / "set", CARD, CaptureMap(entries=entries))
    assert not (campaign / "set").exists()


def test_recordings_keep_their_poses_and_scale(tmp_path: Path) -> None:
    recording = dataclasses.replace(noise(RADAR), sensor_poses=np.eye(4)[None], provenance={"kind": "simulated"})
    recording.save(tmp_path / "raw" / "own")
    made, added = import_captures(tmp_path / "raw", tmp_path / "set", {**CARD, **MUG, "units": "amplitude"})
    again = made.read(added[0])
    assert again.provenance == {"kind": "simulated"}
    assert again.scale == 2e-9
    np.testing.assert_array_equal(again.sensor_poses, np.eye(4)[None])
    assert examine(made.folder).problems == []


def test_cube_of_amplitudes_is_scaled_and_cube_of_counts_is_kept(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cube = 1e-6 * (rng.normal(size=(3, 16, 8, 128)) + 1j * rng.normal(size=(3, 16, 8, 128)))
    np.save(tmp_path / "cube.npy", cube)
    cube_to_set = functools.partial(import_captures, tmp_path / "cube.npy", tmp_path / "set", radar=RADAR)
    refused(["its samples are amplitudes, but the card has units=counts"], cube_to_set, {**CARD, **MUG}, error=RecordingError)
    assert not (tmp_path / "set").exists()
    made, added = cube_to_set({**CARD, **MUG, "units": "amplitude"})
    np.testing.assert_allclose(made.read(added[0]).iq.reshape(cube.shape), cube, atol=1e-9)
    assert examine(made.folder).problems == []
    np.save(tmp_path / "cube.npy", np.rint(1e9 * cube))
    other = {**MUG, "recording": "b", "repetition": 1}
    refused(["counts of an ADC, but the card has units=amplitude"], cube_to_set, other, error=RecordingError)
    made, added = import_captures(tmp_path / "cube.npy", tmp_path / "counts", {**CARD, **MUG}, radar=RADAR)
    np.testing.assert_array_equal(made.read(added[0]).iq.reshape(cube.shape), np.rint(1e9 * cube))


def test_missing_captures_wrong_cards_and_malformed_values_are_refused(tmp_path: Path) -> None:
    refused(["no such capture"], import_captures, tmp_path / "nowhere.bin", tmp_path / "set", error=MissingError)
    refused(["no .bin and no .npy"], find_captures, tmp_path, error=MissingError)
    assert key_values(["object=mug", "notes=a=b"]) == {"object": "mug", "notes": "a=b"}
    for words, message in ((["mug"], "'mug' is not"), (["=mug"], "'=mug' is not"), (["object=mug", "object=can"], "twice, as mug and can")):
        refused([message], key_values, words, error=InputError)
    source, absent = capture(tmp_path / "raw"), ("licence is missing", "sensor is missing", "when is missing")
    refused(absent, import_captures, source, tmp_path / "set", {**MUG, "who": "A. Researcher"}, error=InputError)
    assert not (tmp_path / "set").exists()
    for _ in range(2):
        import_captures(source, tmp_path / "set", {**CARD, **MUG})
    other = {**MUG, "licence": "private"}
    refused(["card.yaml has licence=MIT, not private"], import_captures, source, tmp_path / "set", other, error=InputError)

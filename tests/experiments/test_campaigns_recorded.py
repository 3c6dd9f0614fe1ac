"""A recording set that was exported from the simulated testbed gives the same bytes as the testbed itself, and its own motion and rates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from experiments.campaign import frame
from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import Case, Motion, course, log
from experiments.campaign.export_set import export
from experiments.turntable import environment
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.errors import InputError, UserError
from radartwin.features.envelope import frames_per_revolution
from radartwin.io.progress import Progress
from radartwin.radar.recording import Recording
from radartwin.recordings.examine import examine
from radartwin.recordings.index import Row
from radartwin.recordings.recording_set import RecordingSet
from radartwin.simulation.backends.track_paths import straight
from radartwin.store.products import Store

TINY = [
    "jobs=1", "experiment=environment", "materials=void", "experiment.distances_m=[1.0]", "measured.gap.solver=0", "measured.gap.clutter=0",
    "profile.campaign.turntable_objects=[corner_reflector]", "profile.campaign.reflector_distances_m=[1.0]",
    "profile.campaign.frames_per_turn=14", "profile.campaign.turns=1", "profile.campaign.reflector_repeats=2",
    "profile.campaign.draws=1", "profile.campaign.rail_repeats=1", "profile.campaign.rover_rooms=[]",
]  # fmt: skip


def configured(folder: Path, *more: str) -> Config:
    return compose([*TINY, f"output={folder}", *more])


def campaign_of(config: Config) -> Campaign:
    return Campaign(config, Store(Path(config.output) / "cache"), Progress(quiet=True))


def frame_of(config: Config) -> frame.Frame:
    """Return the frame of the table `environment`, which the store keeps."""
    return environment.read(config, environment.sources(campaign_of(config)), partial(frame.stored, progress=Progress(quiet=True)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an output folder with a tiny virtual measurement campaign and the recording set exported from it."""
    made = tmp_path_factory.mktemp("campaign")
    export(campaign_of(configured(made)), made / "set")
    return made


def recorded(folder: Path, *more: str) -> Config:
    return configured(folder, "measured=recordings", f"measured.folder={folder / 'set'}", *more)


def test_an_exported_campaign_is_a_valid_set_without_the_truth(folder: Path) -> None:
    report = examine(folder / "set")
    assert [str(problem) for problem in report.problems] == []
    assert sorted((row.motion, row.repetition) for row in report.rows) == [
        ("diagonal", 0),
        ("radial", 0),
        *(("turntable", r) for r in (0, 1)),
    ]
    assert report.card is not None
    assert "not a measurement of reality" in report.card.notes
    turning = next(row for row in report.rows if row.motion == "turntable")
    assert turning.value("period_s") == "25"
    described = (folder / "set" / "recordings" / f"{turning.recording}.json").read_text()
    assert "seed" in described  # seed of the receiver noise
    assert not [word for word in ("material", "gap", "placement") if word in described]


def test_both_providers_give_the_same_processed_bytes(folder: Path) -> None:
    testbed, recordings = campaign_of(configured(folder)), campaign_of(recorded(folder))
    cases = testbed.cases("measured")
    assert sorted(recordings.cases("measured")) == sorted(cases)
    for case in cases:
        made, other = (each.process("measured", case).path for each in (testbed, recordings))
        assert made != other
        assert (made / "processed.npz").read_bytes() == (other / "processed.npz").read_bytes(), case.name
        first, second = testbed.log(case), recordings.log(case)
        assert first.frame_rate_hz == second.frame_rate_hz
        assert np.allclose(first.distance_m, second.distance_m, atol=1e-9)
        assert np.allclose(first.target_poses, second.target_poses, atol=1e-9)
        assert (first.angle_rad is None) == (second.angle_rad is None)


def test_an_interrupted_export_continues_with_the_same_result(folder: Path, tmp_path: Path) -> None:
    campaign = campaign_of(configured(folder))
    whole = RecordingSet.load(folder / "set")
    half = RecordingSet.create(tmp_path / "set", whole.card)
    first = next(row for row in whole if row.recording == campaign.cases("measured")[0].name)
    half.add(Recording.load(whole.path(first)), first)
    again = export(campaign, tmp_path / "set")
    assert [row.recording for row in again] == [row.recording for row in whole]
    for row in whole:
        for suffix in (".bin", ".json"):
            again_file, other = (recordings.path(row).with_name(row.recording + suffix) for recordings in (again, whole))
            assert again_file.read_bytes() == other.read_bytes()


def test_recordings_that_the_twin_cannot_simulate_are_left_out_and_counted(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = RecordingSet.load(folder / "set")
    row = whole.rows[0]
    recording = whole.read(row)
    strange = RecordingSet.create(tmp_path / "set", whole.card)
    strange.add(recording, replace(row, recording="vase", object="vase"))
    strange.add(recording, replace(row, recording="cellar", room="cellar"))
    strange.add(recording, replace(row, recording="empty", object="none", motion="static", distance_m=None))
    with pytest.raises(InputError, match="no recording of a known object"):
        campaign_of(configured(folder, "measured=recordings", f"measured.folder={tmp_path / 'set'}"))
    strange.add(recording, row)
    campaign = Campaign(
        configured(folder, "measured=recordings", f"measured.folder={tmp_path / 'set'}"), Store(tmp_path / "cache"), Progress()
    )
    assert [case.name for case in campaign.cases("measured")] == [row.recording]
    assert campaign.cases("twin") == [replace(case, repetition=0) for case in campaign.cases("measured")]
    printed = capsys.readouterr().err
    for words in ("1 recording of object vase", "1 recording of room cellar", "1 recording of motion static"):
        assert words in printed


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["radar.num_chirps=8"], "num_chirps 16 instead of 8"),
        (["experiment.distances_m=[3.0]"], "no turning corner_reflector at 3 m; it has 1"),
    ],
)
def test_a_set_that_does_not_fit_the_configuration_gives_a_one_line_error(folder: Path, more: list[str], words: str) -> None:
    config = recorded(folder, *more)
    with pytest.raises(UserError, match=words) as caught:
        environment.score(config, frame_of(config))
    assert "\n" not in str(caught.value)


def test_a_recording_set_is_not_exported_again(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="recording set already"):
        export(campaign_of(recorded(folder)), tmp_path / "copy")
    assert not (tmp_path / "copy").exists()


@pytest.mark.parametrize("motion", ["depth", "lateral"])
def test_a_recorded_trajectory_may_be_in_any_world_frame(motion: Motion) -> None:
    """The drive moves to the nominal start (lateral) or nearest distance (depth). It slips by 5 cm after the tenth frame."""
    case = Case("mug", "squash_court", motion, 1.0)
    nominal = course(case, 10.0, 49)
    elsewhere = np.eye(4)
    elsewhere[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    elsewhere[:3, 3] = [5.0, -3.0, 0.2]
    slipped = nominal.sensor_poses.copy()
    slipped[10:, :3, 3] += 0.05 * (nominal.sensor_poses[1, :3, 3] - nominal.sensor_poses[0, :3, 3]) / 0.02
    logged = course(case, 10.0, 49, driven=elsewhere @ slipped)
    moved = logged.sensor_poses[:, :3, 3] - nominal.sensor_poses[:, :3, 3]
    if motion == "depth":
        assert np.allclose(moved[:10], [-0.05, 0, 0])
        assert np.allclose(moved[10:], 0)
        assert logged.distance_m.min() == pytest.approx(1.0)
    else:
        assert np.allclose(moved[:10], 0)
        assert np.allclose(moved[10:], [0, 0.06, 0])


def test_a_depth_drive_goes_to_the_smallest_distance_and_back() -> None:
    """The range over time is a triangle. A recording of every third frame contains the smallest distance and the start pose twice."""
    case = Case("mug", "squash_court", "depth", 1.0)
    for every, frames in ((1, 49), (3, 17)):
        nominal = log(case, replace(compose(TINY).profile.campaign, rover_every=every), measured=True)
        away = nominal.distance_m
        assert nominal.frames == frames
        assert (away[0], away[frames // 2], away[-1]) == pytest.approx((1.48, 1.0, 1.48))
        assert np.allclose(away, away[::-1])
        assert np.allclose(np.abs(np.diff(away)), 0.02 * every)
    one_way = course(case, 10.0, 25).sensor_poses
    backwards = course(case, 10.0, 25, driven=one_way[::-1])  # a recorded drive that moves away from the target
    assert backwards.distance_m == pytest.approx(1.0 + 0.02 * np.arange(25))


def remade(folder: Path, tmp_path: Path, rate_hz: float, rows_of: Callable[[Row], list[tuple[Row, int]]]) -> Campaign:
    """Return the campaign of a set of chosen recordings of the first set, with other frame counts and another frame rate."""
    whole = RecordingSet.load(folder / "set")
    other = RecordingSet.create(tmp_path / "set", whole.card)
    for row in whole:
        recording = whole.read(row)
        for new, frames in rows_of(row):
            radar = replace(recording.radar, frame_rate_hz=rate_hz)
            iq = np.resize(recording.iq, (frames, *recording.iq.shape[1:]))
            other.add(Recording(iq, radar, recording.sensor_poses[:1] if recording.sensor_poses is not None else None), new)
    return campaign_of(configured(tmp_path, "measured=recordings", f"measured.folder={tmp_path / 'set'}"))


def test_the_twin_has_the_recorded_motion_and_frame_rate(folder: Path, tmp_path: Path) -> None:
    """If the recording set has 20 Hz, few frames and a turntable period of 0.4 s, the simulation has the same frames as the recording."""

    def chosen(row: Row) -> list[tuple[Row, int]]:
        return [(replace(row, extra={"period_s": "0.4"}), 10)] if row.repetition == 0 and row.motion != "diagonal" else []

    campaign = remade(folder, tmp_path, 20.0, chosen)
    assert len(campaign.cases("twin")) == 2
    for condition in campaign.cases("twin"):
        twin, measured = campaign.log(condition, "twin"), campaign.log(condition)
        assert twin.frame_rate_hz == measured.frame_rate_hz == 20.0
        turns = condition.motion == "turntable"
        assert (twin.frames, measured.frames) == (8 if turns else 10, 10)  # one revolution of the turntable
        if turns:
            assert measured.angle_rad is not None
            assert np.allclose(np.diff(measured.angle_rad), 2 * np.pi / 8)
        else:
            # speed of the rail in m/s over the frame rate of the recording in Hz
            assert np.allclose(twin.distance_m, 1.0 + 0.2 / 20 * np.arange(10))
        made = campaign.recording("void", condition)
        assert (made.num_frames, made.radar.frame_rate_hz) == (twin.frames, 20.0)
    nominal = campaign_of(configured(folder, "materials=void")).clean("void", campaign.cases("twin")[0])
    assert nominal.key != campaign.clean("void", campaign.cases("twin")[0]).key


def test_the_longest_repetition_is_simulated(folder: Path, tmp_path: Path) -> None:
    def chosen(row: Row) -> list[tuple[Row, int]]:
        if row.motion != "radial":
            return []
        return [(replace(row, recording=f"run{k}", repetition=k), frames) for k, frames in ((1, 4), (2, 9), (5, 9))]

    campaign = remade(folder, tmp_path, 10.0, chosen)
    (condition,) = campaign.cases("twin")
    assert condition.repetition == 0
    assert campaign.log(condition, "twin").frames == 9
    for case in campaign.cases("measured"):
        assert campaign.log(case, "twin").frames == 9
        assert campaign.clean("void", case).key == campaign.clean("void", condition).key
    with pytest.raises(InputError, match="no recording of lab-radial-mug-1m-0"):
        campaign.log(Case("mug", "lab", "radial", 1.0), "twin")


def turning(folder: Path, tmp_path: Path, rate_hz: float, period_s: str) -> Campaign:
    """Return the campaign of a recording set with one turntable recording of five frames and the given turntable period."""

    def chosen(row: Row) -> list[tuple[Row, int]]:
        return [(replace(row, extra={"period_s": period_s}), 5)] if (row.motion, row.repetition) == ("turntable", 0) else []

    return remade(folder, tmp_path, rate_hz, chosen)


@pytest.mark.parametrize("period_s", ["25,0", "0", "nan"])
def test_an_invalid_period_gives_a_one_line_error(folder: Path, tmp_path: Path, period_s: str) -> None:
    campaign = turning(folder, tmp_path, 10.0, period_s)
    with pytest.raises(InputError, match=r"period_s is .*one revolution"):
        campaign.log(campaign.cases("measured")[0])


@pytest.mark.parametrize(("motion", "start_m", "end_m"), [("depth", 1.48, 1.48), ("radial", 1.0, 1.6)])
def test_motion_rests_at_its_end(motion: Motion, start_m: float, end_m: float) -> None:
    away = course(Case("mug", "lab" if motion == "radial" else "squash_court", motion, 1.0), 10.0, 200).distance_m
    assert away[0] == pytest.approx(start_m, abs=1e-9)
    assert away[-1] == away[-50] == pytest.approx(end_m, abs=1e-6)


def test_only_straight_drives_share_a_track() -> None:
    line = course(Case("mug", "squash_court", "lateral", 1.0), 10.0, 50).sensor_poses
    there_and_back = course(Case("mug", "squash_court", "depth", 1.0), 10.0, 49).sensor_poses
    assert all(straight(poses) for poses in (line, line[:1], there_and_back, there_and_back[30:], there_and_back[::-1]))
    weaving, turning = line.copy(), line.copy()
    weaving[:, 0, 3] += 0.1 * np.sin(np.arange(50) / 5)
    turning[:, :3, :3] = Rotation.from_rotvec(np.linspace(0, 0.3, 50)[:, None] * [0, 0, 1]).as_matrix() @ line[:, :3, :3]
    swaying = line.copy()
    swaying[:, 0, 3] += 0.005 * np.sin(np.arange(50) / 5)
    assert straight(swaying)
    assert not any(straight(poses) for poses in (weaving, turning))


@pytest.mark.parametrize(("rate_hz", "period_s", "frames"), [(10.0, "10.25", 103), (10.0, "25", 250), (20.0, "0.5", 10)])
def test_the_twins_revolution_fits_the_features(folder: Path, tmp_path: Path, rate_hz: float, period_s: str, frames: int) -> None:
    campaign = turning(folder, tmp_path, rate_hz, period_s)
    angle = campaign.log(campaign.cases("twin")[0], "twin").angle_rad
    assert angle is not None
    assert len(angle) == frames_per_revolution(angle)
    assert len(angle) == pytest.approx(frames, abs=1)

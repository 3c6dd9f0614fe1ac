"""Export the recordings of the virtual measurements (testbed) as a recording set on disk: samples, index rows and logged poses.

The set does not contain the true scene; measured=recordings measured.folder=SET uses it as the measurements of the study. A second call
continues an interrupted export.
"""

from collections.abc import Sequence
from pathlib import Path

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import TURN_S, Case
from experiments.campaign.recorded import TURN
from experiments.interface import Config, Progress, Store
from radartwin.config.compose import compose
from radartwin.config.study import RecordingsConfig
from radartwin.constants import __version__
from radartwin.errors import InputError
from radartwin.io import files
from radartwin.io.one_line import plural
from radartwin.recordings.card import Card
from radartwin.recordings.index import Row
from radartwin.recordings.recording_set import RecordingSet


def export(campaign: Campaign, folder: str | Path) -> RecordingSet:
    """Write every measured recording of the campaign that the recording set does not hold yet.

    Raises InputError if the recordings already come from a recording set, and OutputError or RecordingError if the folder cannot be written
    or holds a different recording set.
    """
    measured = campaign.config.measured
    if isinstance(measured, RecordingsConfig):
        raise InputError(f"measured={measured.provider} is a recording set already; copy the folder {measured.folder} instead")
    files.check_folder(Path(folder))
    target = RecordingSet.create(folder, card(campaign.config))
    for case in campaign.progress.over(campaign.cases("measured"), "recordings written"):
        if case.name in target:
            _check(target, case, campaign)
        else:
            recording = campaign.recording("measured", case)
            recording.sensor_poses = campaign.log(case).sensor_poses
            target.add(recording, row(case))
    return target


def _check(target: RecordingSet, case: Case, campaign: Campaign) -> None:
    """Raise InputError if a recording that the folder already holds was exported with a different profile."""
    (radar, frames, _), log = target.course(next(row for row in target if row.recording == case.name)), campaign.log(case)
    if (frames, radar.frame_rate_hz) != (log.frames, log.frame_rate_hz):
        raise InputError(
            f"{target.folder}: {case.name} has {frames} frames at {radar.frame_rate_hz:g} Hz; profile={campaign.config.profile.name} makes "
            f"{log.frames} at {log.frame_rate_hz:g} Hz; export to another folder"
        )


def card(config: Config) -> Card:
    """Build the card (description file) of a recording set that holds virtual measurements."""
    gaps = ", ".join(f"{name} {strength:g}" for name, strength in vars(config.measured.gap).items() if name != "geometry")
    return Card(
        "radartwin testbed", "CC0-1.0", "amplitude", f"virtual {config.radar.name}", f"radartwin {__version__}",
        f"virtual, seed {config.seed}", f"a virtual measurement campaign, not a measurement of reality; gaps: {gaps}",
    )  # fmt: skip


def row(case: Case) -> Row:
    """Build the row of a recording set's index that describes one case."""
    extra = {TURN: f"{TURN_S:g}"} if case.motion == "turntable" else {}
    return Row(case.name, case.object, case.distance_m, case.room, case.motion, case.repetition, extra=extra)


def export_verb(overrides: Sequence[str], config_dirs: Sequence[Path], out: Path) -> int:
    """Run the command `radartwin export` and return its exit status."""
    config, progress = compose(overrides, config_dirs), Progress()
    campaign = Campaign(config, Store(Path(config.output) / "cache", progress.say), progress, config.measured.draw or 0)
    before = len(RecordingSet.load(out)) if (out / "card.yaml").is_file() else 0
    target = export(campaign, out)
    print(f"{out}: {plural(len(target) - before, 'recording')} added, {len(target)} in all")
    return 0

"""Configuration of the study."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from pathlib import Path

from radartwin.config.checks import no_password, one_of, path_field, positive
from radartwin.config.scene import ROOMS
from radartwin.errors import ConfigError
from radartwin.features.names import families


@dataclass
class GapConfig:
    """Strength of each way in which the testbed's truth is not the twin: 1 as committed, 0 off, 2 doubled.

    What each is at strength 1, with its source, is told by the module that makes it.
    """

    geometry: float = 1.0  # of the twin's scan (radartwin/reconstruct/scanner); 0 is the room itself
    materials: float = 1.0  # thickness and permittivity of layers (radartwin/testbed/variation.py)
    roughness: float = 1.0  # heights of surfaces (radartwin/testbed/variation.py)
    contents: float = 1.0  # liquids and how full their vessels are (radartwin/testbed/variation.py)
    clutter: float = 1.0  # small things and fixtures (radartwin/testbed/fixtures.py); below 1 some are missing
    hardware: float = 1.0  # the radar (radartwin/radar/hardware.py)
    trajectory: float = 1.0  # rover, turntable, times of frames (radartwin/testbed/motion_errors.py)
    placement: float = 1.0  # of the target (radartwin/testbed/motion_errors.py)
    solver: float = 1.0  # on or off: finer, one bounce more (radartwin/testbed/testbed.py)

    def __post_init__(self) -> None:
        for gap in fields(self):
            if not 0 <= getattr(self, gap.name) < math.inf:
                raise ConfigError(f"measured.gap.{gap.name}={getattr(self, gap.name)} must be zero (off) or above, and finite")


def _recording_set(folder: Path) -> None:
    from radartwin.recordings.card import CARD

    if not folder.is_dir():
        raise ConfigError(f"measured.folder={folder} is no folder; give a recording set, made with radartwin import")
    if not (folder / CARD).is_file():
        raise ConfigError(f"measured.folder={folder} is no recording set, it has no {CARD}; make one with radartwin import")


@dataclass
class MeasuredConfig:
    """What the twin is scored against."""

    provider: str = "testbed"  # testbed | recordings
    folder: str | None = path_field()  # recordings: a recording set (docs/recording-sets.md)
    gap: GapConfig = field(default_factory=GapConfig)

    def __post_init__(self) -> None:
        one_of("measured.provider", self.provider, ("testbed", "recordings"))
        if self.provider == "recordings" and not self.folder:
            raise ConfigError("measured=recordings needs the recording set: add measured.folder=FOLDER")
        if self.provider != "recordings" and self.folder:
            raise ConfigError("measured.folder is only read by measured=recordings; add measured=recordings")
        if self.folder:
            _recording_set(Path(self.folder))


@dataclass
class FeaturesConfig:
    """What is read from a recording: the set that its motion exposes (radartwin/features/names.py), less what a claim leaves out."""

    name: str = "raw"  # rotation | depth | lateral | raw
    without: list[str] = field(default_factory=list)  # families left out, such as brightness where a claim is about shape

    def __post_init__(self) -> None:
        families(self.name, self.without)


@dataclass
class EncoderConfig:
    """The contrastive encoder; what each setting is, and where its default comes from: radartwin/recognize/encoder.py."""

    hidden: int = 128
    temperature: float = 0.07
    epochs: int = 100  # at most
    patience: int = 10
    batch: int = 512
    learning_rate: float = 3e-3
    weight_decay: float = 1e-4
    symmetric: bool = False  # InfoNCE from text to radar too
    paired: float = 0.0  # few_shot: weight of the term between simulated and measured rows of the same case

    def __post_init__(self) -> None:
        for name in ("hidden", "temperature", "epochs", "patience", "batch", "learning_rate"):
            positive(f"supervision.encoder.{name}", getattr(self, name))
        for name in ("weight_decay", "paired"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ConfigError(f"supervision.encoder.{name}={getattr(self, name)} must be zero or above, and finite")


@dataclass
class SupervisionConfig:
    """What is known of the measured domain: nothing, one unlabelled reflector recording, or some labelled ones; and how is learned."""

    mode: str = "label_free"  # label_free | calibrated | few_shot
    shots: int = 0  # few_shot: labelled recordings per class
    seeds: int = 5  # trainings that are averaged
    copies: int = 30  # with noise, of each simulated recording
    trees: int = 100  # of a forest
    encoder: EncoderConfig = field(default_factory=EncoderConfig)

    def __post_init__(self) -> None:
        one_of("supervision.mode", self.mode, ("label_free", "calibrated", "few_shot"))
        if self.mode == "few_shot" and self.shots < 1:
            raise ConfigError(f"supervision=few_shot needs supervision.shots of at least 1, not {self.shots}")
        if self.mode != "few_shot" and self.shots != 0:
            raise ConfigError(f"supervision.shots={self.shots} contradicts supervision.mode={self.mode}; use supervision=few_shot")
        if self.mode != "few_shot" and self.encoder.paired:
            unread = f"supervision.encoder.paired={self.encoder.paired:g} needs labelled measured recordings"
            raise ConfigError(f"{unread}; use supervision=few_shot, or leave it out")
        for name in ("seeds", "copies", "trees"):
            positive(f"supervision.{name}", getattr(self, name))


@dataclass
class CampaignConfig:
    """The recordings that the tables share. Empty lists of objects: all of the catalogue (turntable), all of the rover's set (rover)."""

    turntable_objects: list[str] = field(default_factory=list)
    turntable_distances_m: list[float] = field(default_factory=lambda: [1.0])
    reflector_distances_m: list[float] = field(default_factory=lambda: [0.5, 1.0, 1.5, 2.0])  # of the corner reflector on the turntable
    frames_per_turn: int = 36
    turns: int = 2  # of a measured recording; the twin turns once
    reflector_repeats: int = 3  # measured recordings of the reflector on the turntable, each put there anew
    rail_objects: list[str] = field(default_factory=lambda: ["corner_reflector"])
    rail_repeats: int = 2
    rover_objects: list[str] = field(
        default_factory=lambda: ["corner_reflector", "can_211_400", "drink_can_355", "mug", "mustard", "mouthwash"]
    )
    rover_rooms: list[str] = field(default_factory=lambda: ["squash_court"])
    rover_distances_m: list[float] = field(default_factory=lambda: [1.0])
    rover_repeats: int = 1
    rover_every: int = 3  # of the frames of a drive, which one is recorded

    def __post_init__(self) -> None:
        for name in ("frames_per_turn", "turns", "reflector_repeats", "rail_repeats", "rover_repeats", "rover_every"):
            positive(f"profile.campaign.{name}", getattr(self, name))
        for name in ("turntable_distances_m", "reflector_distances_m", "rover_distances_m"):
            positive(f"profile.campaign.{name}", *getattr(self, name))
        for room in self.rover_rooms:
            one_of("profile.campaign.rover_rooms", room, ROOMS)


@dataclass
class ProfileConfig:
    """How much is computed: `quick` shows every claim on two cores in minutes, `paper` is what results/ holds."""

    name: str = "quick"
    repeats: int = 3  # places in each room that the backends are compared from
    resamples: int = 1000  # bootstrap
    scan_rooms: list[str] = field(default_factory=lambda: ["lab"])  # scanned by the virtual phone
    scan_strengths: list[float] = field(default_factory=lambda: [1.0])  # of its errors
    campaign: CampaignConfig = field(default_factory=CampaignConfig)

    def __post_init__(self) -> None:
        for name in ("repeats", "resamples"):
            positive(f"profile.{name}", getattr(self, name))
        positive("profile.scan_strengths", *self.scan_strengths)


@dataclass
class TrackingConfig:
    """Where runs are recorded. `uri` names a server; without it, SQLite in the output folder."""

    backend: str = "mlflow"  # mlflow | off
    uri: str | None = None
    parent_run_id: str | None = None  # set by a sweep for its jobs

    def __post_init__(self) -> None:
        one_of("tracking.backend", self.backend, ("mlflow", "off"))
        if self.backend == "off" and self.uri:
            raise ConfigError(f"tracking=off contradicts tracking.uri={self.uri}; use tracking=mlflow")
        if not (self.uri or "").startswith("sqlite:"):
            no_password("tracking.uri", self.uri, "set MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD instead")


@dataclass
class ExperimentConfig:
    """Which table to compute. `module` is only needed by an experiment outside the experiments/ folder."""

    name: str | None = None
    module: str | None = None
    distances_m: list[float] = field(default_factory=list)
    pairs: list[str] = field(default_factory=list)  # of recordings that the gallery shows: OBJECT/ROOM/MOTION/DISTANCE_M

    def __post_init__(self) -> None:
        positive("experiment.distances_m", *self.distances_m)

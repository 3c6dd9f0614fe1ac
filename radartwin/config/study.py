"""Configuration of the study: what is measured, which features are read, how a model learns, and how much is computed."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from radartwin.config.checks import check_fields, check_selector, choice, not_negative, path_name, positive, url
from radartwin.config.scene import ROOMS
from radartwin.errors import ConfigError
from radartwin.features.families import families


@dataclass
class GapConfig:
    """Strength of each difference between the testbed and the twin: 1 as published, 0 off, 2 doubled.

    The named module states the size of the difference at strength 1 and its source.
    """

    geometry: float = not_negative(1.0)  # errors of the twin's scan (radartwin/reconstruct/scanner)
    materials: float = not_negative(1.0)  # thickness and permittivity of layers (radartwin/testbed/variation.py)
    roughness: float = not_negative(1.0)  # heights of surfaces (radartwin/testbed/variation.py)
    contents: float = not_negative(1.0)  # liquids and fill levels of vessels (radartwin/testbed/variation.py)
    clutter: float = not_negative(1.0)  # small objects and fixtures (radartwin/testbed/fixtures.py); fewer below 1
    hardware: float = not_negative(1.0)  # the radar (radartwin/radar/hardware.py)
    trajectory: float = not_negative(1.0)  # rover, turntable, times of frames (radartwin/testbed/motion_errors.py)
    placement: float = not_negative(1.0)  # of the target (radartwin/testbed/motion_errors.py)
    solver: float = not_negative(1.0)  # above 0: finer rays and one more bounce (radartwin/testbed/testbed.py)

    def __post_init__(self) -> None:
        check_fields(self, "measured.gap")


@dataclass
class MeasuredConfig:
    """The measured domain, which the twin is compared with: here the virtual testbed."""

    provider: str = "testbed"
    gap: GapConfig = field(default_factory=GapConfig)

    def __post_init__(self) -> None:
        check_selector("measured.provider", self.provider, type(self).provider)


@dataclass
class RecordingsConfig(MeasuredConfig):
    """Real recordings. Of the gaps only `geometry`, the errors of the twin's scan, has an effect."""

    provider: str = "recordings"
    folder: str = path_name("")  # a recording set (docs/recording-sets.md)

    def __post_init__(self) -> None:
        from radartwin.recordings.card import CARD

        super().__post_init__()
        if not self.folder:
            raise ConfigError("measured=recordings needs the recording set: add measured.folder=FOLDER")
        if not Path(self.folder).is_dir():
            raise ConfigError(f"measured.folder={self.folder} is no folder; give a recording set, made with radartwin import")
        if not (Path(self.folder) / CARD).is_file():
            raise ConfigError(f"measured.folder={self.folder} is no recording set, it has no {CARD}; make one with radartwin import")


@dataclass
class FeaturesConfig:
    """The features of a recording: a set (radartwin/features/families.py), minus some of its families."""

    name: str = "raw"  # rotation | depth | lateral | raw
    without: list[str] = field(default_factory=list)  # families to leave out, such as brightness

    def __post_init__(self) -> None:
        families(self.name, self.without)


@dataclass
class EncoderConfig:
    """The contrastive encoder. radartwin/recognize/encoder.py describes each setting and the source of its default."""

    hidden: int = positive(128)
    temperature: float = positive(0.07)
    epochs: int = positive(100)  # at most
    patience: int = positive(10)
    batch: int = positive(512)
    learning_rate: float = positive(3e-3)
    weight_decay: float = not_negative(1e-4)
    symmetric: bool = False  # InfoNCE from text to radar too
    paired: float = not_negative(0.0)  # few_shot: weight of the loss between simulated and measured rows of the same case

    def __post_init__(self) -> None:
        check_fields(self, "supervision.encoder")


@dataclass
class SupervisionConfig:
    """The measured recordings that training may use, and the training itself."""

    mode: str = choice("label_free", "calibrated", "few_shot")  # none | one unlabelled reflector recording | labelled recordings
    shots: int = 0  # few_shot: labelled recordings per class
    seeds: int = positive(5)  # trainings to average
    copies: int = positive(30)  # noisy copies of each simulated recording
    trees: int = positive(100)  # of a forest
    encoder: EncoderConfig = field(default_factory=EncoderConfig)

    def __post_init__(self) -> None:
        check_fields(self, "supervision")
        if self.mode == "few_shot":
            if self.shots < 1:
                raise ConfigError(f"supervision=few_shot needs supervision.shots of at least 1, not {self.shots}")
            return
        if self.shots != 0:
            raise ConfigError(f"supervision.shots={self.shots} contradicts supervision.mode={self.mode}; use supervision=few_shot")
        if self.encoder.paired:
            paired = f"supervision.encoder.paired={self.encoder.paired:g}"
            raise ConfigError(f"{paired} needs labelled measured recordings; use supervision=few_shot, or leave it out")


@dataclass
class CampaignConfig:
    """The recordings that the tables share. An empty list of objects stands for the whole catalogue, or for the rover's set."""

    turntable_objects: list[str] = field(default_factory=list)
    turntable_distances_m: list[float] = positive([1.0])
    reflector_distances_m: list[float] = positive([0.5, 1.0, 1.5, 2.0])  # of the corner reflector on the turntable
    frames_per_turn: int = positive(36)
    turns: int = positive(2)  # of a measured recording; the twin simulates one turn
    reflector_repeats: int = positive(3)  # measured recordings of the reflector on the turntable, each placed anew
    rail_objects: list[str] = field(default_factory=lambda: ["corner_reflector"])
    rail_repeats: int = positive(2)
    rover_objects: list[str] = field(
        default_factory=lambda: ["corner_reflector", "can_211_400", "drink_can_355", "mug", "mustard", "mouthwash"]
    )
    rover_rooms: list[str] = field(default_factory=lambda: ["squash_court"])
    rover_distances_m: list[float] = positive([1.0])
    rover_repeats: int = positive(1)
    rover_every: int = positive(3)  # every n-th frame of a drive is recorded

    def __post_init__(self) -> None:
        check_fields(self, "profile.campaign")
        for room in self.rover_rooms:
            if room not in ROOMS:
                raise ConfigError(f"profile.campaign.rover_rooms={room} is not known; options: {', '.join(ROOMS)}")


@dataclass
class ProfileConfig:
    """The amount of computation: `quick` shows every claim on two cores in minutes, `paper` makes the committed tables in docs/results."""

    name: str = "quick"
    repeats: int = positive(3)  # radar positions in each room for the comparison of simulators
    resamples: int = positive(1000)  # of the bootstrap
    scan_rooms: list[str] = field(default_factory=lambda: ["lab"])  # rooms that the virtual phone scans
    scan_strengths: list[float] = positive([1.0])  # of its errors
    campaign: CampaignConfig = field(default_factory=CampaignConfig)

    def __post_init__(self) -> None:
        check_fields(self, "profile")


@dataclass
class TrackingConfig:
    """The store of runs: the MLflow server `uri`, or SQLite in the output folder."""

    backend: str = choice("mlflow", "off")
    uri: str | None = url("set MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD instead")
    parent_run_id: str | None = None  # a sweep sets it for its jobs

    def __post_init__(self) -> None:
        check_fields(self, "tracking")
        if self.backend == "off" and self.uri:
            raise ConfigError(f"tracking=off contradicts tracking.uri={self.uri}; use tracking=mlflow")


@dataclass
class ExperimentConfig:
    """The table to compute."""

    name: str | None = None
    module: str | None = None  # of an experiment outside the folder experiments/
    distances_m: list[float] = positive([])
    pairs: list[str] = field(default_factory=list)  # recordings that the gallery shows: OBJECT/ROOM/MOTION/DISTANCE_M

    def __post_init__(self) -> None:
        check_fields(self, "experiment")

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
    """Strength of each gap, a deliberate difference between testbed and twin: 1 is the published size, 0 is off, 2 is doubled.

    The module named in the comment states the size of the difference at strength 1 and the source of this size.
    """

    geometry: float = not_negative(1.0)  # scan errors in the twin's geometry (radartwin/reconstruct/scanner)
    materials: float = not_negative(1.0)  # thickness and permittivity of layers (radartwin/testbed/variation.py)
    roughness: float = not_negative(1.0)  # heights of surfaces (radartwin/testbed/variation.py)
    contents: float = not_negative(1.0)  # liquids and fill levels of vessels (radartwin/testbed/variation.py)
    clutter: float = not_negative(1.0)  # small objects and fixtures (radartwin/testbed/fixtures.py); fewer below 1
    hardware: float = not_negative(1.0)  # errors of the radar hardware (radartwin/radar/hardware.py)
    trajectory: float = not_negative(1.0)  # errors of rover motion, turntable and frame times (radartwin/testbed/motion_errors.py)
    placement: float = not_negative(1.0)  # errors of the target's position (radartwin/testbed/motion_errors.py)
    solver: float = not_negative(1.0)  # above 0: finer rays and one more bounce (radartwin/testbed/testbed.py)

    def __post_init__(self) -> None:
        check_fields(self, "measured.gap")


@dataclass
class MeasuredConfig:
    """The measured recordings that the twin is compared with. This option takes them from the virtual testbed."""

    provider: str = "testbed"
    gap: GapConfig = field(default_factory=GapConfig)

    def __post_init__(self) -> None:
        check_selector("measured.provider", self.provider, type(self).provider)


@dataclass
class RecordingsConfig(MeasuredConfig):
    """Real recordings as the measured recordings. Of the fields of GapConfig, only `geometry` then has an effect."""

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
    """The features of a recording: a feature set (radartwin/features/families.py), optionally without some of its feature families."""

    name: str = "raw"  # rotation | depth | lateral | raw
    without: list[str] = field(default_factory=list)  # families to leave out, such as brightness

    def __post_init__(self) -> None:
        families(self.name, self.without)


@dataclass
class EncoderConfig:
    """The contrastive encoder. radartwin/recognize/encoder.py describes each setting and the source of its default."""

    hidden: int = positive(128)
    temperature: float = positive(0.07)
    epochs: int = positive(100)  # maximum number of epochs
    patience: int = positive(10)
    batch: int = positive(512)
    learning_rate: float = positive(3e-3)
    weight_decay: float = not_negative(1e-4)
    symmetric: bool = False  # whether to add the InfoNCE loss from text to radar
    paired: float = not_negative(0.0)  # few_shot: weight of the loss between simulated and measured rows of the same case

    def __post_init__(self) -> None:
        check_fields(self, "supervision.encoder")


@dataclass
class SupervisionConfig:
    """The measured recordings that training may use, and the training settings."""

    mode: str = choice("label_free", "calibrated", "few_shot")  # none | one unlabelled reflector recording | labelled recordings
    shots: int = 0  # few_shot: labelled recordings per class
    seeds: int = positive(5)  # number of trainings whose results are averaged
    copies: int = positive(30)  # noisy copies of each simulated recording
    trees: int = positive(100)  # trees of a random forest
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
    """The recordings that the tables share. An empty list of objects means the whole catalogue, or the objects of the rover study."""

    turntable_objects: list[str] = field(default_factory=list)
    turntable_distances_m: list[float] = positive([1.0])
    reflector_distances_m: list[float] = positive([0.5, 1.0, 1.5, 2.0])  # from the radar to the corner reflector on the turntable
    frames_per_turn: int = positive(36)
    turns: int = positive(2)  # revolutions of a measured recording; the twin simulates one revolution
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
    """The amount of computation. `quick` shows every claim on two cores in minutes; `paper` makes the committed tables in docs/results."""

    name: str = "quick"
    repeats: int = positive(3)  # radar positions in each room for the comparison of simulators
    resamples: int = positive(1000)  # number of bootstrap samples
    scan_rooms: list[str] = field(default_factory=lambda: ["lab"])  # rooms that the virtual phone scans
    scan_strengths: list[float] = positive([1.0])  # strengths of the phone's scan errors
    campaign: CampaignConfig = field(default_factory=CampaignConfig)

    def __post_init__(self) -> None:
        check_fields(self, "profile")


@dataclass
class TrackingConfig:
    """Where runs are tracked: on the MLflow server `uri`, or in SQLite in the output folder."""

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
    module: str | None = None  # module name of an experiment outside the folder experiments/
    distances_m: list[float] = positive([])
    pairs: list[str] = field(default_factory=list)  # recordings that the gallery shows: OBJECT/ROOM/MOTION/DISTANCE_M

    def __post_init__(self) -> None:
        check_fields(self, "experiment")

"""Configuration of the study: the measured recordings, the signal features, the classifiers' training, and the amount of computation."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from radartwin.config.checked_fields import Checked, choice, not_negative, number, path_name, positive, url
from radartwin.config.scene import ROOMS
from radartwin.errors import ConfigError
from radartwin.features.sets import families

_STUDY = "radartwin/config/study.py"
MOST_STRENGTH = 4.0  # twice the largest strength of any table; nothing beyond it was tested


def strength(source: str, default: float = 1.0, most: float = MOST_STRENGTH) -> Any:
    """Define the strength of a gap or of a randomisation, from 0 to `most`. `source` gives the size at strength 1."""
    setting = number(default, lambda value: 0 <= value <= most, f"from 0 to {most:g}")
    return field(default=setting.default, metadata={**setting.metadata, "source": source})


@dataclass
class _Strengths(Checked):
    """Base of the settings whose fields are strengths. A field without a source raises ConfigError."""

    def __post_init__(self) -> None:
        for name, source in self.sources().items():
            if not source:
                raise ConfigError(f"{self.KEY}.{name} has no source; state it in {_STUDY} before any table is scored")
        super().__post_init__()

    def sources(self) -> dict[str, str]:
        """Return the source of the size of each field at strength 1."""
        return {entry.name: entry.metadata.get("source", "") for entry in fields(self)}


@dataclass
class GapConfig(_Strengths):
    """Strength of each error that the virtual measurements have and the simulation under test does not have (docs/concepts.md).

    Strength 0 switches the error off. At strength 1, it has the size that its source gives, and at strength 2 twice this size.
    """

    KEY = "measured.gap"
    geometry: float = strength("phone LiDAR: Luetzenburg 2021, Teo 2023, Kim 2022, and 24 frames of a real scan")
    materials: float = strength("EN 520; spread between rows of ITU-R P.2040-4")
    roughness: float = strength("spread of published heights; EN 572-2 and EN 14411 for glass and glaze")
    contents: float = strength("uncertainty of the recipes of liquids; empty height of bottles: order of magnitude")
    object_shape: float = strength("cans: tolerances of Can Manufacturers Institute and Hudson Technologies; others: order of magnitude")
    object_material: float = strength("spread between rows of ITU-R P.2040-4; thickness of walls: order of magnitude")
    person: float = strength("sway: Abrahamova 2008, order of magnitude; body measures")
    clutter: float = strength("ordinary equipment: order of magnitude; drift: thermal expansion")
    antenna: float = strength("side lobes: Wang 2018; back lobe and ripple: diffraction at an edge, order of magnitude")
    hardware: float = strength("data sheets AWR1243, IWR1443 and AWR2944P; two public captures")
    trajectory: float = strength("odometry: Borenstein 1996; turntable and rail: order of magnitude")
    placement: float = strength("a tape read to half a centimetre: order of magnitude")
    solver: float = strength("four times the tubes and one more bounce: order of magnitude")
    unscanned_echoes: float = strength("clutter from fixtures without a model, named by the paper: order of magnitude", 0.0, 5.0)


@dataclass
class MeasuredConfig(Checked):
    """The measured recordings that simulations are compared with, here those of the virtual measurement campaign (testbed)."""

    KEY, SELECTOR = "measured", "provider"
    provider: str = "testbed"
    gap: GapConfig = field(default_factory=GapConfig)
    draw: int | None = not_negative(None)  # number of one draw of the virtual campaign, from 0; null stands for all draws of the profile


@dataclass
class RecordingsConfig(MeasuredConfig):
    """The option that takes real recordings as the measured recordings. Of the fields of GapConfig, only `geometry` then has an effect."""

    provider: str = "recordings"
    folder: str = path_name("measured=recordings needs the recording set: add measured.folder=FOLDER")  # docs/recording-sets.md

    def __post_init__(self) -> None:
        from radartwin.recordings.card import CARD

        super().__post_init__()
        if self.draw is not None:
            raise ConfigError(f"measured.draw={self.draw}: real recordings have no draws; leave measured.draw out")
        if not Path(self.folder).is_dir():
            raise ConfigError(f"measured.folder={self.folder} is no folder; give a recording set, made with radartwin import")
        if not (Path(self.folder) / CARD).is_file():
            raise ConfigError(f"measured.folder={self.folder} is no recording set, it has no {CARD}; make one with radartwin import")


@dataclass
class FeaturesConfig:
    """The signal features that are computed from a recording: a named group of features, optionally without some feature families."""

    name: str = "raw"  # named group of features (radartwin/features/sets.py): rotation | depth | lateral | raw
    without: list[str] = field(default_factory=list)  # names of feature families to leave out, such as brightness
    code: str = ""  # digest of the source code of a plug-in's feature set, which is part of run keys

    def __post_init__(self) -> None:
        families(self.name, self.without)


@dataclass
class EncoderConfig(Checked):
    """Settings of the contrastive encoder. radartwin/recognize/encoder.py describes each setting and the source of its default value."""

    KEY = "supervision.encoder"
    hidden: int = positive(128)
    temperature: float = positive(0.07)
    epochs: int = positive(100)  # maximum number of training epochs
    patience: int = positive(10)
    batch: int = positive(512)
    learning_rate: float = positive(3e-3)
    weight_decay: float = not_negative(1e-4)
    paired: float = not_negative(0.0)  # few_shot: loss weight for matching simulated and measured rows of one object and condition


@dataclass
class RandomiseConfig(_Strengths):
    """Strength of the randomisation of each quantity in the copies of simulated turntable recordings (radartwin/recognize/randomise.py)."""

    KEY = "supervision.randomise"
    wobble: float = strength("half a degree of tilt: order of magnitude")
    eccentricity: float = strength("an object centred by eye to 5 mm: order of magnitude")
    start: float = strength("no mark of the start angle: any angle")
    speed: float = strength("2 % of a small motor's rate: order of magnitude")
    distance: float = strength("a tape read to half a centimetre at both ends: order of magnitude")
    level: float = strength("3 dB of transmitter, feed lines and receiver: order of magnitude")
    if_filter: float = strength("options of the high-pass stages in TI mmWaveLink")
    channels: float = strength("spread of a measured AWR1843L calibration")
    noise: float = strength("noise figures of TI data sheets: 14 to 16 dB")
    wall: float = strength("spread between rows of ITU-R P.2040-4; thickness of walls: order of magnitude")
    mesh: float = strength("ISO 2768-1, class m")


@dataclass
class SupervisionConfig(Checked):
    """The measured recordings that the training of a classifier may use, and the settings of the training."""

    KEY = "supervision"
    mode: str = choice("label_free", "calibrated", "few_shot")  # measured data in training: none | one reflector | some labelled recordings
    shots: int = 0  # number of labelled measured recordings per class that training uses in mode few_shot
    seeds: int = positive(5)  # number of trainings with different random seeds whose results are averaged
    copies: int = positive(30)  # number of noisy copies of each simulated recording in the training data
    trees: int = positive(100)  # number of trees in a random forest
    variants: int = positive(6)  # number of drawn turntables and targets per simulated recording, over which the copies are divided
    randomise: RandomiseConfig = field(default_factory=RandomiseConfig)
    encoder: EncoderConfig = field(default_factory=EncoderConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
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
class CampaignConfig(Checked):
    """The recordings that the result tables share. An empty list of objects means the whole catalogue, or all of the rover study."""

    KEY = "profile.campaign"
    turntable_objects: list[str] = field(default_factory=list)
    turntable_room: str = "lab"  # room of the turntable; "void" has none, and no scan
    turntable_distances_m: list[float] = positive([1.0])
    reflector_distances_m: list[float] = positive([0.5, 1.0, 1.5, 2.0])  # from the radar to the corner reflector on the turntable
    frames_per_turn: int = positive(24)  # the rotation features need 13 frames, but 13 frames rank the objects differently from 24
    draws: int = positive(3)  # number of draws of turntable and rail (objects, room, radar and courses are drawn anew for each)
    rover_draws: int = positive(1)  # number of draws of the rover's drives
    first_draw: int = not_negative(0)  # number of the first of these draws
    turns: int = positive(2)  # number of turntable revolutions in a measured recording; a simulated recording has one revolution
    reflector_repeats: int = positive(1)  # number of measured recordings of the corner reflector, which is placed anew for each
    rail_objects: list[str] = field(default_factory=lambda: ["corner_reflector"])
    rail_repeats: int = positive(1)
    rail_every: int = positive(3)  # a recording of the rail contains every n-th frame
    rover_objects: list[str] = field(
        default_factory=lambda: ["corner_reflector", "can_211_400", "drink_can_355", "mug", "mustard", "mouthwash"]
    )
    rover_rooms: list[str] = choice(["squash_court"], *ROOMS)
    rover_distances_m: list[float] = positive([1.0])
    rover_repeats: int = positive(1)
    rover_every: int = positive(4)  # a recording of a rover drive contains every n-th frame; its features need 13 frames


@dataclass
class StrengthCampaignConfig(CampaignConfig):
    """The recordings at which the table `headline` compares strengths of the gaps; some claims need more objects than the quick profile."""

    KEY = "profile.strength_campaign"
    turntable_distances_m: list[float] = positive([1.0, 1.5])
    rover_objects: list[str] = field(default_factory=list)


@dataclass
class ObjectsCampaignConfig(CampaignConfig):
    """The recordings of the table `many_objects`: the assortment on a turntable without a room. `turntable_objects` is ignored."""

    KEY = "profile.objects_campaign"
    turntable_room: str = "void"
    turntable_distances_m: list[float] = positive([0.75, 1.0, 1.25, 1.5])
    draws: int = positive(1)
    per_kind: int = positive(3)  # largest number of objects of each kind


@dataclass
class ProfileConfig(Checked):
    """The amount of computation: `quick` takes minutes on two cores, and `paper` computes the tables of the paper's size."""

    KEY = "profile"
    name: str = choice("quick", "paper")
    repeats: int = positive(3)  # number of radar positions in each room at which simulators are compared
    resamples: int = positive(1000)  # bootstrap samples for confidence intervals; slow statistics of drives use at most 300
    scan_rooms: list[str] = field(default_factory=lambda: ["lab"])  # rooms that the simulated phone scans
    scan_strengths: list[float] = positive([1.0])  # factors on the errors of the simulated phone scan; 1 is the published size
    strengths: list[float] = positive([1.0])  # factors on all gaps (measured.gap) in the table of the paper's main claims
    unknown_contents: bool = False  # whether some tables also show a simulation that knows only the surface of vessels
    exact_objects: bool = False  # whether tables of object recognition also show a testbed whose objects equal the catalogue
    operating_points: bool = True  # whether the table environment searches for conditions in which the paper's figures occur
    # quantities of supervision.randomise that the table randomisation_ablation leaves out, one at a time
    left_out: list[str] = choice(["level", "if_filter", "channels", "noise"], *(entry.name for entry in fields(RandomiseConfig)))
    layout_turns: int = not_negative(0)  # revolutions per recording in the paper's layout (table labelled_probe); 0: none
    campaign: CampaignConfig = field(default_factory=CampaignConfig)
    strength_campaign: StrengthCampaignConfig = field(default_factory=StrengthCampaignConfig)  # recordings for `strengths`
    objects_campaign: ObjectsCampaignConfig = field(default_factory=ObjectsCampaignConfig)


@dataclass
class TrackingConfig(Checked):
    """Where MLflow tracks runs: on the MLflow server `uri`, or in an SQLite database in the output folder."""

    KEY = "tracking"
    backend: str = choice("mlflow", "off")
    uri: str | None = url("set MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD instead")
    parent_run_id: str | None = None  # MLflow id of the sweep's parent run, which the sweep sets for its jobs

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.backend == "off" and self.uri:
            raise ConfigError(f"tracking=off contradicts tracking.uri={self.uri}; use tracking=mlflow")


@dataclass
class ExperimentConfig(Checked):
    """The result table to compute. The module of an experiment names the options that it reads in READS, except `name` and `module`."""

    KEY = "experiment"
    name: str | None = None
    module: str | None = None  # name of the Python module of an experiment outside the folder experiments/
    distances_m: list[float] = positive([])
    pairs: list[str] = field(default_factory=list)  # recordings that the gallery page shows: OBJECT/ROOM/MOTION/DISTANCE_M
    part: int = not_negative(0)  # part of the campaign's recordings that campaign_part simulates, from 0 to parts - 1
    parts: int = positive(1)  # number of parts of the campaign

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.part >= self.parts:
            raise ConfigError(
                f"experiment.part={self.part} does not exist; parts are 0 to {self.parts - 1} (experiment.parts={self.parts})"
            )

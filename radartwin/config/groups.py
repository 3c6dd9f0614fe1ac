"""The configuration: one typed dataclass per Hydra group, and the checks no single value can make.

The YAML files under conf/ name the options of each group; the types and defaults are here. `compose` is the only road
from command-line overrides to a `Config`, and every mistake on it becomes one `ConfigError` line. Nothing behind this
module sees a DictConfig. Fields marked by `_path` name files: they enter a run key by content, not by name
(radartwin/store/digest.py).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from radartwin.errors import ConfigError
from radartwin.features.names import families

PARTS = ("none", "large", "whole")
CHOSEN = ("parts", "max_bounces", "rays_per_wavelength2", "coupling", "diffuse")  # by simulator=auto, where they are null
# What each simulator reads besides backend, variant and elements; and the choices of what is chosen by name.
SIMULATOR_FIELDS: dict[str, dict[str, tuple[str, ...]]] = {
    "mitsuba": {
        "max_bounces": (), "rays": (), "rays_per_wavelength2": (), "room": ("auto", "panels", "tubes"), "coupling": (), "diffuse": (),
        "parts": PARTS,
    },
    "auto": {"tolerance": (), "parts": PARTS, "max_bounces": (), "rays_per_wavelength2": (), "coupling": (), "diffuse": ()},
    "rfgenesis": {"version": ("shipped", "columns", "corrected"), "grid": (), "fov_deg": ()},
    "points": {
        "cross_section": ("table", "sphere"), "points": ("centre", "box"), "room": ("images", "void"), "step_deg": (),
        "rays_per_wavelength2": (),
    },
    "sionna": {"max_bounces": (), "rays": (), "diffuse": (), "separation_m": ()},
}  # fmt: skip

# What each material source reads, with its default.
MATERIALS_FIELDS: dict[str, dict[str, Any]] = {
    "vlm": {
        "missing": None, "model": None, "provider": "recorded", "url": "http://127.0.0.1:8000/v1", "timeout_s": 120.0, "concurrency": 4,
        "views": 3,
    },
    "uniform": {"material": "plasterboard"},
    "void": {},
    "true": {},
    "random": {"p": 0.5, "among": "room"},
    "scene": {},
}  # fmt: skip


def _path() -> Any:
    return field(default=None, metadata={"path": True})


def _unkeyed(default: Any) -> Any:
    """A field that says where or how, never what: it stays out of run keys."""
    return field(default=default, metadata={"unkeyed": True})


def _one_of(key: str, value: str, options: Sequence[str]) -> None:
    if value not in options:
        raise ConfigError(f"{key}={value} is not known; options: {', '.join(options)}")


def _positive(key: str, *values: float | None) -> None:
    for value in values:
        if value is not None and not 0 < value < math.inf:
            raise ConfigError(f"{key}={value} must be above zero and finite")


def _finite(key: str, *values: float) -> None:
    for value in values:
        if not math.isfinite(value):
            raise ConfigError(f"{key}={value} must be finite")


def _no_password(key: str, url: str | None, remedy: str) -> None:
    """What is configured is logged and kept with the results; a password must not be in it."""
    if url and re.match(r"[\w+.-]+://[^/?#]*@", url):
        raise ConfigError(f"{key} carries a name or password, and it is written into logs and results; {remedy}")


ROOMS = ("lab", "atrium", "squash_court")
ROOM_CHOICES = {"detail": ("shell", "furnished", "cluttered"), "back": ("solid", "glass")}
TARGETS = ("corner_reflector", "plate", "sphere", "none")


@dataclass
class SceneConfig:
    """What is in front of the radar: a procedural room, a scan or a saved scene, and the target in it."""

    name: str = "lab"  # lab | atrium | squash_court | empty | void | plate | scan
    path: str | None = _path()  # scan: a scene folder, or a .glb/.ply/.obj mesh
    size_m: list[float] | None = None  # rooms: length, width, height; null: the room's own
    detail: str | None = None  # rooms: shell | furnished | cluttered; null: furnished
    back: str | None = None  # squash_court: solid | glass, its back wall; null: solid
    target: str = "corner_reflector"  # corner_reflector | plate | sphere | none | an object of the catalogue, such as mug
    target_size_m: float = 0.1  # reflector leg, plate edge or sphere diameter
    layout: str | None = _path()  # YAML: objects that stand in the room (radartwin/scene/layouts/layout.py)
    sentence: str | None = None  # the same in words: "a mug on the table 1.5 m in front of the door"
    llm_url: str | None = None  # of an OpenAI-compatible server, for sentences that the built-in grammar cannot read
    llm_model: str | None = None
    target_position_m: list[float] | None = None  # of what it stands on; null: on the boresight at trajectory.distance_m
    stand: bool = False  # a turntable disc on a post under the target

    def __post_init__(self) -> None:
        _one_of("scene.name", self.name, (*ROOMS, "empty", "void", "plate", "scan"))
        if self.target not in TARGETS:
            from radartwin.scene.objects.catalogue import catalogue

            _one_of("scene.target", self.target, (*TARGETS, *(name for name in catalogue() if name not in TARGETS)))
            if self.target_size_m != SceneConfig.target_size_m:
                raise ConfigError(f"scene.target_size_m is not read by scene.target={self.target}, which has its own size; leave it out")
        _positive("scene.target_size_m", self.target_size_m)
        _positive("scene.size_m", *(self.size_m or ()))
        _finite("scene.target_position_m", *(self.target_position_m or ()))
        for name, length in (("size_m", "length,width,height"), ("target_position_m", "x,y,z")):
            value = getattr(self, name)
            if value is not None and len(value) != 3:
                raise ConfigError(f"scene.{name}={value} must be [{length}] in metres")
        for name, readers in (("size_m", ROOMS), ("detail", ROOMS), ("back", ("squash_court",))):
            value = getattr(self, name)
            if value is not None and name in ROOM_CHOICES:
                _one_of(f"scene.{name}", value, ROOM_CHOICES[name])
            if value is not None and self.name not in readers:
                unread = f"scene.{name}={value} is not read by scene={self.name}"
                raise ConfigError(f"{unread}; choose scene={'|'.join(readers)}, or leave it out")
        if self.target == "none" and (self.stand or self.target_position_m is not None):
            raise ConfigError("scene.target=none leaves nothing to place; choose a scene.target, or leave stand and target_position_m out")
        if self.name == "scan" and not self.path:
            raise ConfigError("scene=scan needs the scan: add scene.path=FILE_OR_FOLDER")
        if self.name != "scan" and self.path:
            raise ConfigError(f"scene.path is only read by scene=scan, and scene.name is {self.name}; add scene=scan")
        if self.layout and self.sentence:
            raise ConfigError("scene.layout and scene.sentence both say what stands where; give one of them")
        _no_password("scene.llm_url", self.llm_url, "set RADARTWIN_VLM_KEY instead")
        if (self.llm_url or self.llm_model) and not (self.llm_url and self.llm_model and self.sentence):
            raise ConfigError("scene.llm_url and scene.llm_model are read together, for scene.sentence; give all three")

    def room_options(self) -> dict[str, Any]:
        """What the user set of the room's own options."""
        return {name: value for name in ("size_m", "detail", "back") if (value := getattr(self, name)) is not None}


@dataclass
class MaterialsConfig:
    """Who says what the room's surfaces are made of. A field that the chosen source does not read is null; null is the default elsewhere.

    `vlm` takes recorded answers in a run; `provider` and what follows it are the defaults of `radartwin label`, which asks.
    """

    source: str = "uniform"  # vlm | uniform | void | true | random | scene: as a scan's manifest says
    material: str | None = None  # uniform: of every room surface
    missing: str | None = None  # vlm: the material of surfaces that nobody answered; null refuses them
    model: str | None = None  # vlm: whose answers; null takes any recorded ones, and the server's default
    p: float | None = None  # random: share of wrong labels
    among: str | None = None  # random: wrong labels from the room's categories, or from all
    provider: str | None = _unkeyed(None)  # recorded | server | local
    url: str | None = _unkeyed(None)  # server: base of an OpenAI-compatible API; the key is in RADARTWIN_VLM_KEY
    timeout_s: float | None = _unkeyed(None)  # server: of one request
    concurrency: int | None = _unkeyed(None)  # server: requests under way at once
    views: int | None = _unkeyed(None)  # pictures of each surface

    def __post_init__(self) -> None:
        _one_of("materials.source", self.source, tuple(MATERIALS_FIELDS))
        read = MATERIALS_FIELDS[self.source]
        for name in (f.name for f in fields(self) if f.name != "source"):
            value = getattr(self, name)
            if name not in read and value is not None:
                readers = "|".join(source for source, names in MATERIALS_FIELDS.items() if name in names)
                raise ConfigError(
                    f"materials.{name}={value} is not read by materials={self.source}; leave it out, or choose materials={readers}"
                )
        _no_password("materials.url", self.url, "set RADARTWIN_VLM_KEY instead")
        if self.p is not None and not 0 <= self.p <= 1:
            raise ConfigError(f"materials.p={self.p:g} must be from 0 to 1")
        for name, options in (("among", ("room", "all")), ("provider", ("recorded", "server", "local"))):
            if (value := getattr(self, name)) is not None:
                _one_of(f"materials.{name}", value, options)
        for name in ("timeout_s", "concurrency", "views"):
            _positive(f"materials.{name}", getattr(self, name))

    def options(self, seed: int = 0) -> dict[str, Any]:
        """What `radartwin.label.sources.material_source` takes beside the source's name."""
        named = {"uniform": ("material",), "vlm": ("missing", "model"), "random": ("p", "among")}.get(self.source, ())
        return {name: self.value(name) for name in named} | ({"seed": seed} if self.source == "random" else {})

    def value(self, name: str) -> Any:
        """A field, or its default where it is null."""
        given = getattr(self, name)
        return MATERIALS_FIELDS[self.source].get(name) if given is None else given


@dataclass
class SimulatorConfig:
    """How paths are found. The variant is where the same rays are traced, so it is not part of a run's key.

    A field that the chosen simulator does not read is null; `elements` belongs to the signal and is read with all of them.
    """

    backend: str = "mitsuba"  # mitsuba | auto: mitsuba with no more modelled than the features need | rfgenesis | points | sionna
    variant: str = _unkeyed("auto")  # auto | llvm | cuda
    elements: str = "exact"  # exact | planar | auto: distances over each antenna element, or a plane wave across the array
    tolerance: float | None = None  # auto: how far a feature may move, in limits of its repeatability (radartwin/adaptive/limits.py)
    room: str | None = "auto"  # mitsuba: panels by images, tubes, or auto (panels where the room is flat); points: images | void
    # mitsuba; null with simulator=auto, which chooses what is null
    parts: str | None = "whole"  # of the room: none, large (without small things) or whole
    max_bounces: int | None = 4  # sionna: too
    rays: int | None = None  # per frame; null: by the width rule; sionna: its samples
    rays_per_wavelength2: float | None = 1.0  # on objects; points: of its table
    coupling: bool | None = True  # paths between objects and room, by mirrored sensors
    diffuse: bool | None = True  # scatter of rough surfaces, by a cloud fixed in the world; sionna: its own, which adds coherently
    # rfgenesis
    version: str | None = None  # shipped | columns | corrected (radartwin/simulation/backends/rfgenesis.py)
    grid: int | None = None  # pixels along each side
    fov_deg: float | None = None
    # points
    cross_section: str | None = None  # table: far field by aspect | sphere: one of the object's size
    points: str | None = None  # centre | box: of the bounding box, or of its faces
    step_deg: float | None = None  # of the table
    # sionna
    separation_m: float | None = None  # of the receiver while paths are looked for, so that corners are seen into

    def __post_init__(self) -> None:
        _one_of("simulator.backend", self.backend, tuple(SIMULATOR_FIELDS))
        _one_of("simulator.variant", self.variant, ("auto", "llvm", "cuda"))
        _one_of("simulator.elements", self.elements, ("exact", "planar", "auto"))
        for name in ("max_bounces", "rays", "rays_per_wavelength2", "grid", "fov_deg", "step_deg", "tolerance"):
            _positive(f"simulator.{name}", getattr(self, name))
        read = SIMULATOR_FIELDS[self.backend]
        for other in SIMULATOR_FIELDS:
            for name in SIMULATOR_FIELDS[other]:
                value = getattr(self, name)
                if name not in read and value is not None:
                    unread = f"simulator.{name}={value} is not read by simulator={self.backend}"
                    raise ConfigError(f"{unread}; choose simulator={other}, or leave it out")
                if name in read and value is None and name != "rays" and not (self.backend == "auto" and name in CHOSEN):
                    raise ConfigError(f"simulator.{name}=null: simulator={self.backend} needs a value; leave it out for the default")
        for name, options in read.items():
            if options and getattr(self, name) is not None:
                _one_of(f"simulator.{name}", str(getattr(self, name)), options)
        if self.fov_deg is not None and not self.fov_deg < 180:
            raise ConfigError(f"simulator.fov_deg={self.fov_deg:g} must be below 180")
        if self.separation_m is not None and not 0 <= self.separation_m <= 1:
            raise ConfigError(f"simulator.separation_m={self.separation_m:g} must be from 0 to 1")
        if self.step_deg is not None and self.step_deg > 90:
            raise ConfigError(f"simulator.step_deg={self.step_deg:g} must be at most 90")


@dataclass
class RadarConfig:
    """The fields of `radartwin.Radar`, or a TI configuration file that holds them. Positions: metres, x forward, y
    left, z up.
    """

    name: str = "iwr1843"
    file: str | None = _path()  # mmWave SDK .cfg, mmWave Studio .mmwave.json, .yaml; only element may be set beside it
    start_frequency_hz: float | None = None
    slope_hz_per_s: float | None = None
    sample_rate_hz: float | None = None
    num_samples: int | None = None
    num_chirps: int | None = None  # loops per transmitter and frame
    tx_positions_m: list[list[float]] | None = None
    rx_positions_m: list[list[float]] | None = None
    chirp_interval: float | None = None  # seconds between successive chirp starts, transmitters interleaved
    frame_rate_hz: float | None = None
    element: str | None = None  # iwr1843 | isotropic; null: the file's, else iwr1843
    noise_figure_db: float | None = None
    transmit_power_dbm: float | None = None
    real_sampling: bool | None = None  # null: the file's, else false

    def __post_init__(self) -> None:
        if self.element is not None:
            _one_of("radar.element", self.element, ("iwr1843", "isotropic"))
        if self.name == "file" and not self.file:
            raise ConfigError("radar=file needs the file: add radar.file=FILE.cfg or FILE.mmwave.json")
        if self.name != "file" and self.file:
            raise ConfigError(f"radar.file is only read by radar=file, and radar.name is {self.name}; add radar=file")
        if self.file and (refused := sorted(set(self.given()) - {"name", "element"})):
            raise ConfigError(f"radar.{refused[0]} is set, but radar=file takes it from {self.file}; change it there, or leave it out here")

    def given(self) -> dict[str, Any]:
        """The fields that the option or the user set, by the names `Radar` has for them."""
        return {f.name: value for f in fields(self) if f.name != "file" and (value := getattr(self, f.name)) is not None}


@dataclass
class TrajectoryConfig:
    """How sensor and target move. Distances are from the radar to the target's axis."""

    kind: str = "turntable"  # static | turntable | rail | depth | lateral | file
    position_m: list[float] | None = None  # of the radar at the start; null: the bench, or inside a scan's low-x end
    heading_deg: float = 0.0  # of its boresight, from +x to the left
    distance_m: float = 1.0  # at the start
    height_m: float = 1.0  # of the radar above the floor, where position_m does not say
    frames: int | None = None  # null: the whole sweep or revolution
    period_s: float = 25.0  # turntable: one revolution
    length_m: float = 1.0  # rail, depth and lateral: travelled
    speed_mps: float = 0.2
    angle_deg: float = 0.0  # rail: where the target goes, from away from the radar (0, radial) to the radar's left (90)
    # file: the radar's poses in the world
    path: str | None = _path()  # TUM or CSV text, or a ROS bag
    start_s: float = 0.0  # of the first frame, after the first pose
    axes: str = "sensor"  # of the poses: sensor (x forward, z up) | optical (z forward, y down)
    topic: str | None = None  # of a ROS bag
    frame: str | None = None  # of a ROS bag's transforms
    mount_m: list[float] | None = None  # where the radar sits on what the poses are of: x, y, z
    mount_deg: list[float] | None = None  # ... and how it is turned: roll, pitch, yaw

    def __post_init__(self) -> None:
        _one_of("trajectory.kind", self.kind, ("static", "turntable", "rail", "depth", "lateral", "file"))
        _one_of("trajectory.axes", self.axes, ("sensor", "optical"))
        for name in ("distance_m", "height_m", "frames", "period_s", "length_m", "speed_mps"):
            _positive(f"trajectory.{name}", getattr(self, name))
        for name in ("heading_deg", "angle_deg", "start_s"):
            _finite(f"trajectory.{name}", getattr(self, name))
        self._check_file()
        _finite("trajectory.position_m", *(self.position_m or ()))
        if self.position_m is not None and len(self.position_m) != 3:
            raise ConfigError(f"trajectory.position_m={self.position_m} must be [x,y,z] in metres")
        if self.kind == "depth" and self.length_m >= self.distance_m:
            reach = f"trajectory.length_m={self.length_m:g} runs into the target"
            raise ConfigError(f"{reach} at trajectory.distance_m={self.distance_m:g}; shorten one or lengthen the other")

    def _check_file(self) -> None:
        """The fields that only trajectory=file reads."""
        for name in ("mount_m", "mount_deg"):
            value = getattr(self, name)
            if value is not None and len(value) != 3:
                raise ConfigError(f"trajectory.{name}={value} must be three numbers")
            _finite(f"trajectory.{name}", *(value or ()))
        if self.kind == "file":
            if not self.path:
                raise ConfigError("trajectory=file needs the file: add trajectory.path=FILE")
            if self.position_m is not None:
                raise ConfigError(f"trajectory.position_m={self.position_m} is not read by trajectory=file, which has its own")
            if self.start_s < 0:
                raise ConfigError(f"trajectory.start_s={self.start_s:g} must be zero or above")
            return
        for name in ("path", "topic", "frame", "mount_m", "mount_deg"):
            if getattr(self, name):
                raise ConfigError(f"trajectory.{name} is only read by trajectory=file; add trajectory=file")


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
    folder: str | None = _path()  # recordings: a recording set (docs/recording-sets.md)
    gap: GapConfig = field(default_factory=GapConfig)

    def __post_init__(self) -> None:
        _one_of("measured.provider", self.provider, ("testbed", "recordings"))
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
            _positive(f"supervision.encoder.{name}", getattr(self, name))
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
        _one_of("supervision.mode", self.mode, ("label_free", "calibrated", "few_shot"))
        if self.mode == "few_shot" and self.shots < 1:
            raise ConfigError(f"supervision=few_shot needs supervision.shots of at least 1, not {self.shots}")
        if self.mode != "few_shot" and self.shots != 0:
            raise ConfigError(f"supervision.shots={self.shots} contradicts supervision.mode={self.mode}; use supervision=few_shot")
        if self.mode != "few_shot" and self.encoder.paired:
            unread = f"supervision.encoder.paired={self.encoder.paired:g} needs labelled measured recordings"
            raise ConfigError(f"{unread}; use supervision=few_shot, or leave it out")
        for name in ("seeds", "copies", "trees"):
            _positive(f"supervision.{name}", getattr(self, name))


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
            _positive(f"profile.campaign.{name}", getattr(self, name))
        for name in ("turntable_distances_m", "reflector_distances_m", "rover_distances_m"):
            _positive(f"profile.campaign.{name}", *getattr(self, name))
        for room in self.rover_rooms:
            _one_of("profile.campaign.rover_rooms", room, ROOMS)


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
            _positive(f"profile.{name}", getattr(self, name))
        _positive("profile.scan_strengths", *self.scan_strengths)


@dataclass
class TrackingConfig:
    """Where runs are recorded. `uri` names a server; without it, SQLite in the output folder."""

    backend: str = "mlflow"  # mlflow | off
    uri: str | None = None
    parent_run_id: str | None = None  # set by a sweep for its jobs

    def __post_init__(self) -> None:
        _one_of("tracking.backend", self.backend, ("mlflow", "off"))
        if self.backend == "off" and self.uri:
            raise ConfigError(f"tracking=off contradicts tracking.uri={self.uri}; use tracking=mlflow")
        if not (self.uri or "").startswith("sqlite:"):
            _no_password("tracking.uri", self.uri, "set MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD instead")


@dataclass
class ExperimentConfig:
    """Which table to compute. `module` is only needed by an experiment outside the experiments/ folder."""

    name: str | None = None
    module: str | None = None
    distances_m: list[float] = field(default_factory=list)
    pairs: list[str] = field(default_factory=list)  # of recordings that the gallery shows: OBJECT/ROOM/MOTION/DISTANCE_M

    def __post_init__(self) -> None:
        _positive("experiment.distances_m", *self.distances_m)


@dataclass
class Config:
    """A composed run. `output` is the root of everything written; it, `tracking` and `jobs` say where and how, never what."""

    scene: SceneConfig = field(default_factory=SceneConfig)
    materials: MaterialsConfig = field(default_factory=MaterialsConfig)
    simulator: SimulatorConfig = field(default_factory=SimulatorConfig)
    radar: RadarConfig = field(default_factory=RadarConfig)
    trajectory: TrajectoryConfig = field(default_factory=TrajectoryConfig)
    measured: MeasuredConfig = field(default_factory=MeasuredConfig)
    features: FeaturesConfig = field(default_factory=FeaturesConfig)
    supervision: SupervisionConfig = field(default_factory=SupervisionConfig)
    profile: ProfileConfig = field(default_factory=ProfileConfig)
    tracking: TrackingConfig = field(default_factory=TrackingConfig, metadata={"unkeyed": True})
    experiment: ExperimentConfig = field(default_factory=ExperimentConfig)
    seed: int = 0
    output: str = _unkeyed("outputs")
    jobs: int = _unkeyed(0)  # processes that recordings and tables are made by; 0: as many as there are cores and memory for

    def __post_init__(self) -> None:
        if self.jobs < 0:
            raise ConfigError(f"jobs={self.jobs} must be zero (as many as there are cores and memory for) or above")
        if self.seed < 0:
            raise ConfigError(f"seed={self.seed} must be zero or above")
        if self.materials.source == "void" and self.scene.target == "none":
            raise ConfigError("materials=void with scene.target=none leaves nothing to simulate; choose a scene.target")
        if self.materials.source == "true" and self.scene.name == "scan":
            raise ConfigError("materials=true needs a procedural room: nobody knows the true materials of scene=scan")
        if self.materials.source == "scene" and self.scene.name != "scan":
            raise ConfigError(
                f"materials=scene needs the labels of a scan, and scene is {self.scene.name}; add scene=scan, or materials=true"
            )
        if self.materials.source == "vlm" and self.scene.name in ("empty", "void", "plate"):
            raise ConfigError(f"materials=vlm needs a room with surfaces to label, and scene={self.scene.name} has none")

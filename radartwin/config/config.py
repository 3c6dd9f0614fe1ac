"""Define the composed configuration of a run: one typed field for each Hydra configuration group.

An option file under conf/ lists its dataclass in its defaults (`schema_NAME`) and holds only the values that differ from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from radartwin.config.checked_fields import MISSING, Checked, choice, not_negative, unkeyed
from radartwin.config.materials import MaterialsConfig
from radartwin.config.radar import RadarConfig
from radartwin.config.scene import SceneConfig
from radartwin.config.simulator import SimulatorConfig
from radartwin.config.study import ExperimentConfig, FeaturesConfig, MeasuredConfig, ProfileConfig, SupervisionConfig, TrackingConfig
from radartwin.config.trajectory import TrajectoryConfig
from radartwin.errors import ConfigError


def _schemas(base: type[Checked]) -> dict[str, type]:
    """Return the dataclass of each option of a group, from the names in `base` and its subclasses. A subclass has precedence."""
    schemas: dict[str, type] = {name: base for name in base.NAMES or (getattr(base, base.SELECTOR),) if name}
    for subclass in base.__subclasses__():
        schemas |= _schemas(subclass)
    return schemas


# the dataclass of each option, for groups whose options have different keys; Hydra's ConfigStore names it schema_OPTION
SCHEMAS = {base.KEY: _schemas(base) for base in (SceneConfig, MaterialsConfig, SimulatorConfig, TrajectoryConfig, MeasuredConfig)}
SCHEMAS["trajectory"]["diagonal"] = SCHEMAS["trajectory"]["rail"]


@dataclass
class Config(Checked):
    """The configuration of a run: settings that influence its result, and where and how the run computes (`tracking`, `output`, `jobs`)."""

    scene: SceneConfig = MISSING
    materials: MaterialsConfig = MISSING
    simulator: SimulatorConfig = MISSING
    radar: RadarConfig = field(default_factory=RadarConfig)
    trajectory: TrajectoryConfig = MISSING
    measured: MeasuredConfig = MISSING
    features: FeaturesConfig = field(default_factory=FeaturesConfig)
    supervision: SupervisionConfig = field(default_factory=SupervisionConfig)
    profile: ProfileConfig = field(default_factory=ProfileConfig)
    tracking: TrackingConfig = field(default_factory=TrackingConfig, metadata={"unkeyed": True})
    experiment: ExperimentConfig = field(default_factory=ExperimentConfig)
    contents: str = choice("filled", "unknown")  # known of catalogue objects: filled (walls and contents) | unknown (surface only)
    seed: int = not_negative(0)
    output: str = unkeyed("outputs")  # root folder of all files that runs write
    jobs: int = unkeyed(not_negative(0))  # number of worker processes; 0 starts as many as processor cores and memory allow

    def __post_init__(self) -> None:
        super().__post_init__()
        campaign, draw = self.profile.campaign, self.measured.draw
        first, last = campaign.first_draw, campaign.first_draw + max(campaign.draws, campaign.rover_draws) - 1
        if draw is not None and not first <= draw <= last:
            raise ConfigError(f"measured.draw={draw} does not exist: the draws of profile={self.profile.name} are {first} to {last}")
        source, scene = self.materials.source, self.scene
        if source == "void" and scene.target == "none":
            raise ConfigError("materials=void with scene.target=none leaves nothing to simulate; choose a scene.target")
        if source == "true" and scene.name == "scan":
            raise ConfigError(
                "materials=true needs a procedural room, because the true materials of a scan are unknown; use materials=scene"
            )
        if source == "scene" and scene.name != "scan":
            raise ConfigError(f"materials=scene needs the labels of a scan, and scene is {scene.name}; add scene=scan, or materials=true")
        if source == "vlm" and scene.name in ("empty", "void", "plate"):
            raise ConfigError(
                f"materials=vlm needs a room with surfaces to label, but scene={scene.name} has no room; choose scene=lab or "
                "materials=uniform"
            )

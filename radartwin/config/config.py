"""The composed configuration."""

from __future__ import annotations

from dataclasses import dataclass, field

from radartwin.config.checks import unkeyed
from radartwin.config.materials import MaterialsConfig
from radartwin.config.radar import RadarConfig
from radartwin.config.scene import SceneConfig
from radartwin.config.simulator import SimulatorConfig
from radartwin.config.study import ExperimentConfig, FeaturesConfig, MeasuredConfig, ProfileConfig, SupervisionConfig, TrackingConfig
from radartwin.config.trajectory import TrajectoryConfig
from radartwin.errors import ConfigError


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
    output: str = unkeyed("outputs")
    jobs: int = unkeyed(0)  # processes that recordings and tables are made by; 0: as many as there are cores and memory for

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

"""The material source `by_height`: surfaces on the floor are concrete, all others are of another material."""

from dataclasses import dataclass

from radartwin.label.surface_labels import Label, relabelled
from radartwin.scene.scene import Scene, Surface


@dataclass(frozen=True)
class ByHeight:
    name = "by_height"
    below_m: float = 0.05
    above: str = "plasterboard"

    def __call__(self, scene: Scene) -> Scene:
        return relabelled(scene, self.label, self.name)

    def label(self, index: int, surface: Surface) -> Label:
        material = "concrete" if surface.mesh.bounds[1, 2] < self.below_m else self.above
        return Label(material, 0.0, {"source": self.name, "confidence": None, "stand_in": False, "minc": None})

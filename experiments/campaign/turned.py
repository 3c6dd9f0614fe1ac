"""A turntable recording as what was traced of it: aspects, which of them each chirp sees, and what drifts meanwhile.

Three hundred seconds at 10 Hz are 800 MB of samples, all of them combinations of a thousand aspects of 16 KB: these are kept.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.io import files, untrusted_json
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.simulation.aspects import Aspects
from radartwin.store.products import save_arrays, save_json
from radartwin.testbed.drift import Drift

_NAME = "turned"


@dataclass(frozen=True, eq=False)
class Turned:
    """Attributes:
    aspects: of the target with everything at rest around it. angles: (F, C, T) of the table at each chirp, radians.
    drift: of what is around it; None where nothing does.
    """

    aspects: Aspects
    angles: np.ndarray
    radar: Radar
    drift: Drift | None = None
    provenance: dict[str, Any] = field(default_factory=dict)

    @property
    def traced(self) -> int:
        """States that were traced."""
        return len(self.aspects.signals)

    def recording(self) -> Recording:
        """All its frames."""
        iq = self.aspects.at(self.angles)
        if self.drift is not None:
            self.drift.add_to(iq)
        return Recording(iq, self.radar, None, provenance=self.provenance)

    def save(self, folder: Path) -> None:
        """Write turned.npz and turned.json into a folder under construction."""
        arrays = {"signals": self.aspects.signals, "angles": self.angles}
        if self.drift is not None:
            arrays |= {"drift_states": self.drift.states, "drift_course": self.drift.course}
        save_arrays(folder, arrays, _NAME)
        described = {"radar": self.radar.to_dict(), "symmetry": self.aspects.symmetry, "provenance": self.provenance}
        save_json(folder, _NAME, described)

    @staticmethod
    def is_in(folder: Path) -> bool:
        return (folder / f"{_NAME}.json").is_file()

    @classmethod
    def load(cls, folder: Path) -> Turned:
        """What `save` wrote."""
        described = untrusted_json.read(folder / f"{_NAME}.json")
        kept = files.read_arrays(folder / f"{_NAME}.npz")
        drift = Drift(kept["drift_states"], kept["drift_course"]) if "drift_states" in kept else None
        aspects = Aspects(kept["signals"], described["symmetry"])
        return cls(aspects, kept["angles"], Radar.from_dict(described["radar"]), drift, described["provenance"])

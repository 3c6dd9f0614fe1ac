"""Store a turntable recording as its radar signals at traced target angles (aspects), the turntable's angle and the surroundings' drift.

The 800 MB of samples of a recording of 300 s can be interpolated from the signals at about a thousand angles, which take 16 KB each.
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
from radartwin.testbed.bystander import Echo
from radartwin.testbed.drift import Drift

_NAME = "turned"


@dataclass(frozen=True, eq=False)
class Turned:
    """A turntable recording stored as signals at traced target angles. The method `recording` computes the samples of all frames."""

    aspects: Aspects  # signals of the scene at each traced target angle, with the surroundings at rest
    angles: np.ndarray  # (F, C, T) angle of the turntable at each chirp, radians
    radar: Radar
    drift: Drift | None = None  # slow change of the surroundings, or None
    person: Echo | None = None  # echo of a person in the room, or None
    provenance: dict[str, Any] = field(default_factory=dict)

    @property
    def traced(self) -> int:
        """Number of traced target angles (aspects)."""
        return len(self.aspects.signals)

    def recording(self) -> Recording:
        """Compute the samples of all frames by interpolation between the traced target angles."""
        iq = self.aspects.at(self.angles)
        if self.drift is not None:
            self.drift.add_to(iq)
        if self.person is not None:
            self.person.add_to(iq, self.radar)
        return Recording(iq, self.radar, None, provenance=self.provenance)

    def save(self, folder: Path) -> None:
        """Write the recording to the files turned.npz and turned.json in a folder."""
        arrays = {"signals": self.aspects.signals, "angles": self.angles}
        if self.drift is not None:
            arrays |= {"drift_states": self.drift.states, "drift_course": self.drift.course}
        if self.person is not None:
            arrays |= {"person_still": self.person.still, "person_towards": self.person.towards_m}
        save_arrays(folder, arrays, _NAME)
        described = {"radar": self.radar.to_dict(), "symmetry": self.aspects.symmetry, "provenance": self.provenance}
        save_json(folder, _NAME, described)

    @staticmethod
    def is_in(folder: Path) -> bool:
        return (folder / f"{_NAME}.json").is_file()

    @classmethod
    def load(cls, folder: Path) -> Turned:
        """Read a recording from a folder that the method `save` wrote."""
        described = untrusted_json.read(folder / f"{_NAME}.json")
        arrays = files.read_arrays(folder / f"{_NAME}.npz")
        drift = Drift(arrays["drift_states"], arrays["drift_course"]) if "drift_states" in arrays else None
        person = Echo(arrays["person_still"], arrays["person_towards"]) if "person_still" in arrays else None
        aspects = Aspects(arrays["signals"], described["symmetry"])
        return cls(aspects, arrays["angles"], Radar.from_dict(described["radar"]), drift, person, described["provenance"])

"""The interface from which tables read recordings, and the recordings of some motions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from experiments.campaign.cases import COMPARED, Case
from radartwin.features.log import Log
from radartwin.features.processed import Processed


class RecordingSource(Protocol):
    """Interface of a campaign (experiments.campaign.campaign). Tests may use a substitute for the campaign with the same interface."""

    def cases(self, domain: str, **conditions: Any) -> Sequence[Case]: ...
    def prepare(self, wanted: Any, materials: Any = None) -> None: ...
    def processed(self, domain: str, case: Case, materials: Any = None) -> tuple[str, Processed]: ...
    def log(self, case: Case, domain: str = "measured") -> Log: ...


def cases_of(source: RecordingSource, motions: Sequence[str]) -> list[tuple[str, Case]]:
    """Return the (domain, case) pairs of all measured and simulated recordings with these motions."""
    return [(domain, case) for domain in COMPARED for motion in motions for case in source.cases(domain, motion=motion)]

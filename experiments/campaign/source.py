"""The interface from which tables read recordings."""

from collections.abc import Sequence
from typing import Any, Protocol

from experiments.campaign.cases import Case
from radartwin.features.log import Log
from radartwin.features.processed import Processed


class RecordingSource(Protocol):
    """Interface of a campaign (experiments.campaign.campaign). Tests may use a substitute for the campaign with the same interface."""

    def cases(self, domain: str, **conditions: Any) -> Sequence[Case]: ...
    def prepare(self, wanted: Any) -> None: ...
    def processed(self, domain: str, case: Case) -> tuple[str, Processed]: ...
    def log(self, case: Case, domain: str = "measured") -> Log: ...

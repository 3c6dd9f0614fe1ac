"""The interface from which tables read recordings, and a function that reads matching measured and simulated recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar

from experiments.campaign.cases import COMPARED, Case
from radartwin.errors import ConfigError
from radartwin.features.log import Log
from radartwin.features.processed import Processed
from radartwin.io.progress import Progress
from radartwin.scene.objects.catalogue import catalogue

Reading = TypeVar("Reading")


class RecordingSource(Protocol):
    """Interface of a campaign (experiments.campaign.campaign). Tests may use a substitute for the campaign with the same interface."""

    def cases(self, domain: str, **conditions: Any) -> Sequence[Case]: ...
    def prepare(self, wanted: Any, materials: Any = None) -> None: ...
    def processed(self, domain: str, case: Case, materials: Any = None) -> tuple[str, Processed]: ...
    def log(self, case: Case, domain: str = "measured") -> Log: ...


def cases_of(source: RecordingSource, motions: Sequence[str]) -> list[tuple[str, Case]]:
    """Return the (domain, case) pairs of all measured and simulated recordings with these motions."""
    return [(domain, case) for domain in COMPARED for motion in motions for case in source.cases(domain, motion=motion)]


def read_both(
    source: RecordingSource,
    motions: Sequence[str],
    place: Callable[[Case], tuple[Any, ...]],
    read: Callable[[Case, str, Processed, Log], Reading],
    progress: Progress,
) -> dict[str, dict[Any, list[Reading]]]:
    """Read the measured and simulated recordings that both domains contain. A measured and a simulated recording match if `place` returns
    the same tuple for both.

    Args:
        place: function that returns the tuple (object, ...) of a case, for instance (object, room, distance).
        read: function (case, store key, processed recording, log) -> value to compare, such as a feature vector.
    Returns:
        For each domain a dictionary {tuple: list of the values of `read`}. The tuples are sorted by object in the order of the catalogue,
        then by their other entries.
    Raises:
        ConfigError: no tuple occurs in both the measured and the simulated recordings.
    """
    cases = {domain: [case for motion in motions for case in source.cases(domain, motion=motion)] for domain in COMPARED}
    common = set.intersection(*({place(case) for case in some} for some in cases.values()))
    if not common:
        raise ConfigError(
            f"the campaign has no {' or '.join(motions)} recordings of one object and place, both measured and simulated; "
            "add objects or distances to profile.campaign or to the recording set"
        )
    wanted = [(domain, case) for domain in COMPARED for case in cases[domain] if place(case) in common]
    source.prepare(wanted)
    order = {name: number for number, name in enumerate(catalogue())}
    ordered = sorted(common, key=lambda known: (order[known[0]], known[1:]))
    found: dict[str, dict[Any, list[Reading]]] = {domain: {known: [] for known in ordered} for domain in COMPARED}
    for domain, case in progress.over(wanted, "recordings read"):
        key, processed = source.processed(domain, case)
        found[domain][place(case)].append(read(case, key, processed, source.log(case, domain)))
    return found

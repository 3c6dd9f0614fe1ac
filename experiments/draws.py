"""Read the frame of a table: all draws of the measurement, and all versions of simulation and testbed.

A draw (experiments.campaign.cases.Case) is one sample of everything that the testbed chooses at random; profile.campaign.draws (turntable
and rail) and profile.campaign.rover_draws (drives) set their number. The simulation under test is the same for all draws.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from experiments.campaign.campaign import Campaign, joined, make_together
from experiments.campaign.cases import MEASURED, ROVER, TWIN, draws
from experiments.campaign.frame import Frame, Wanted, check_revolutions, shared, stored
from experiments.campaign.schedule import RecordingTask
from experiments.interface import Config, Progress, Store
from radartwin.errors import ConfigError

UNKNOWN, EXACT = "contents unknown", "objects of the catalogue"
OBJECT_GAPS = ("object_shape", "object_material", "contents")  # gaps that change the target


@dataclass(frozen=True)
class Part:
    """The recordings of one domain as one configuration makes them, with their entries in `frame.VERSIONS`; `select` may choose some."""

    domain: str
    config: Config
    versions: Mapping[str, str] = field(default_factory=dict)
    select: Callable[[Campaign], Wanted] | None = None


@dataclass(frozen=True)
class Query:
    """The recordings that a table reads: those of `config` in both domains, and those of further parts."""

    config: Config
    motions: Sequence[str]
    room: str | None = None
    several: bool = False
    side: str = ""  # side of the configured simulation
    unknown: bool = False  # add the simulation in which the contents of vessels are unknown (twin UNKNOWN, profile.unknown_contents)
    exact: bool = False  # add one draw of the testbed without the gaps OBJECT_GAPS (truth EXACT, profile.exact_objects)
    more: Sequence[Part] = ()

    @property
    def parts(self) -> list[Part]:
        config, profile = self.config, self.config.profile
        parts = [Part(MEASURED, config), Part(TWIN, config, {"side": self.side}), *self.more]
        if self.unknown and profile.unknown_contents and config.contents == "filled":
            parts.append(Part(TWIN, replace(config, contents="unknown"), {"side": self.side, "twin": UNKNOWN}))
        if self.exact and profile.exact_objects and config.measured.provider == "testbed":
            gap = replace(config.measured.gap, **dict.fromkeys(OBJECT_GAPS, 0.0))
            measured = replace(config.measured, gap=gap, draw=numbers(config)[0])
            parts.append(Part(MEASURED, replace(config, measured=measured), {"truth": EXACT}))
        return parts

    def wanted(self, store: Store, progress: Progress) -> list[tuple[Part, Campaign, Wanted]]:
        """Return the recordings of each part, as (domain, case) pairs of its campaign."""
        numbers(self.config, self.motions[0] in ROVER)  # refuses a draw that the campaign lacks
        usual, selections = Campaign(self.config, store, progress), []
        for part in self.parts:
            campaign = usual if part.config is self.config else Campaign(part.config, store, progress)
            wanted = part.select(campaign) if part.select else shared(campaign, self.motions, self.room, self.several)
            selections.append((part, campaign, [pair for pair in wanted if pair[0] == part.domain]))
        return selections

    def recordings(self, store: Store, progress: Progress) -> dict[str, RecordingTask]:
        """Return the recordings that the store lacks, as experiments.shared_simulations needs them."""
        return missing(self.wanted(store, progress))

    def sources(self, store: Store, progress: Progress) -> dict[str, Campaign]:
        """Return the campaign of each simulation, by its name in the column `twin` or `side`."""
        parts = [part for part in self.parts if part.domain == TWIN]
        return {part.versions.get("twin") or part.versions["side"]: Campaign(part.config, store, progress) for part in parts}

    def frame(self, store: Store, progress: Progress) -> Frame:
        """Return the frame of all draws. Missing recordings are simulated."""
        import pandas as pd

        make_together(missing(parts := self.wanted(store, progress)), self.config.jobs, progress)
        out = pd.concat([stored(campaign, wanted, progress).assign(**part.versions) for part, campaign, wanted in parts], ignore_index=True)
        if "turntable" in self.motions:
            check_revolutions(out)
        return out


def missing(parts: Sequence[tuple[Part, Campaign, Wanted]]) -> dict[str, RecordingTask]:
    """Return the recordings of all parts that the store lacks."""
    return joined([campaign.missing(wanted) for _, campaign, wanted in parts])


def numbers(config: Config, rover: bool = False) -> list[int]:
    """Return the draws that a table reads; a recording set is a single draw. Raises ConfigError for a draw that the campaign lacks."""
    if config.measured.provider != "testbed":
        return [0]
    known, draw = draws(config.profile.campaign, rover), config.measured.draw
    if draw is not None and draw not in known:
        kind = "drives" if rover else "turntable and rail"
        raise ConfigError(f"measured.draw={draw}: the draws of {kind} are {known[0]} to {known[-1]} in profile={config.profile.name}")
    return list(known) if draw is None else [draw]

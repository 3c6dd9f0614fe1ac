"""What the turntable tables read off each recording, in either domain: the rotation features, the signature, and if the target is seen."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.recognition.readings import Campaign, Case
from radartwin.errors import ConfigError, InputError
from radartwin.features import sets
from radartwin.features.log import angles, distances
from radartwin.features.profile import FAR_M, NEAR_M, gate
from radartwin.features.signature import Signature, signature
from radartwin.io.progress import Progress
from radartwin.plotting.style import PAGE_WIDTH_IN
from radartwin.scene.objects.catalogue import catalogue

MEASURED, TWIN = "measured", "twin"
DOMAINS = (MEASURED, TWIN)
LABELS = {MEASURED: "measured", TWIN: "simulated"}


@dataclass(frozen=True, eq=False)
class Turn:
    """One recording: its features by name, and whether its strongest return in the room is in the target gate."""

    case: Case
    key: str
    values: dict[str, float]
    signature: Signature
    localised: bool


Turns = dict[tuple[str, float], list[Turn]]  # by object and distance


def read(campaign: Campaign, progress: Progress) -> dict[str, Turns]:
    """Turns of both domains at the objects and distances that both have, in the catalogue's order.

    Raises:
        ConfigError: the campaign has none in common. InputError: turns of different numbers of frames.
    """
    cases = {domain: campaign.cases(domain, motion="turntable") for domain in DOMAINS}
    common = set.intersection(*({(case.object, case.distance_m) for case in chosen} for chosen in cases.values()))
    if not common:
        raise ConfigError("the turntable campaign has no object and distance that is both measured and simulated")
    wanted = [(domain, case) for domain in DOMAINS for case in cases[domain] if (case.object, case.distance_m) in common]
    found: dict[str, dict] = {domain: defaultdict(list) for domain in DOMAINS}
    campaign.prepare(wanted)
    for domain, case in progress.over(wanted, "turntable recordings"):
        found[domain][case.object, case.distance_m].append(_turn(campaign, domain, case))
    shapes = {turn.signature.level.shape for turns in found.values() for some in turns.values() for turn in some}
    if len(shapes) > 1:
        told = " and ".join(str(frames) for frames in sorted({shape[0] for shape in shapes}))
        raise InputError(f"turns of {told} frames cannot be compared; record all turntables at one frame rate and period")
    order = {name: number for number, name in enumerate(catalogue())}
    return {domain: dict(sorted(turns.items(), key=lambda item: (order[item[0][0]], item[0][1]))) for domain, turns in found.items()}


def _turn(campaign: Campaign, domain: str, case: Case) -> Turn:
    key, processed = campaign.processed(domain, case)
    log = campaign.log(case, domain)
    names, values = sets.vector(processed, log, "rotation")
    target_m = float(distances(log, processed.num_frames)[0])
    shown = signature(processed, angles(log, processed.num_frames), log.frame_rate_hz, target_m)
    seen = (processed.range_m >= NEAR_M) & (processed.range_m <= FAR_M)
    strongest = int(np.where(seen, processed.power.mean(axis=0), 0).argmax())
    localised = bool(gate(processed.range_m, target_m)[strongest])
    return Turn(case, key, dict(zip(names, (float(value) for value in values), strict=True)), shown, localised)


def objects(turns: Turns) -> list[str]:
    """Names of the objects, in the catalogue's order."""
    return list(dict.fromkeys(name for name, _ in turns))


def distances_m(turns: Turns) -> list[float]:
    """Distances that occur, ascending."""
    return sorted({distance for _, distance in turns})


def samples(turns: Turns, feature: str, name: str, distance_m: float | None = None) -> NDArray[np.float64]:
    """A feature's values over an object's recordings, at one distance or all."""
    return np.array([turn.values[feature] for turn in chosen(turns, [name], distance_m)])


def object_means(turns: Turns, feature: str, names: Sequence[str], distance_m: float | None = None) -> NDArray[np.float64]:
    """One value per object: the mean over distances of the mean over repetitions, so that no distance weighs more."""
    found = []
    for name in names:
        cells = [key for key in turns if key[0] == name and distance_m in (None, key[1])]
        found.append(np.mean([np.mean([turn.values[feature] for turn in turns[key]]) for key in cells]))
    return np.array(found)


def chosen(turns: Turns, names: Sequence[str], distance_m: float | None = None) -> list[Turn]:
    """Recordings of these objects, at one distance or all."""
    return [turn for (name, distance), some in turns.items() if name in names and distance_m in (None, distance) for turn in some]


def panels_width_in(panels: int) -> float:
    """Of a figure with a panel per distance: the page's for four, less for fewer."""
    return PAGE_WIDTH_IN * min(1.0, 0.25 + 0.25 * panels)


def is_can(name: str) -> bool:
    """Whether an object is of the near-identical set."""
    return "can_" in name


def keys(*parts: Sequence[Turn]) -> list[str]:
    return [turn.key for part in parts for turn in part]

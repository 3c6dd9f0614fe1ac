"""The table `headline`: the paper's main claims, with all gaps of the testbed at several strengths.

Each row is one claim, which another table judges at every strength (`profile.strengths` times all measured.gap.NAME). All strengths are
compared with the same smaller campaign, profile.strength_campaign, because the width of an interval depends on the number of draws, and the
paper's campaign at two more strengths takes four hours. Value and verdict of a row use profile.campaign. The claims are one family: their
intervals have the levels of Holm's correction (`at_levels`), those of the strengths have 95 %.
"""

import functools
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from experiments import draws
from experiments.campaign.campaign import joined
from experiments.campaign.cases import REFLECTOR, planned
from experiments.campaign.schedule import RecordingTask
from experiments.interface import Config, Progress, Store
from experiments.recognition import labelled_probe, reconstruction_ablation, rover_recognition, turntable_label_free
from experiments.recognition.protocol import CHANCE_MARGIN, FLOOR_ONLY, LEAST_GAIN, SAME_MODELS
from experiments.rover import rover_fidelity
from experiments.statistics import LEVEL, PERMUTATION, STUDENT, at_level
from experiments.turntable import environment, linear_rail, turntable_material, turntable_shape
from experiments.verdicts import EQUAL, NONE, NOT_HERE, PRIMARY, Claim, judge
from radartwin.config.compose import compose
from radartwin.errors import ConfigError
from radartwin.runs.experiment import JUDGED, SCORE_COLUMNS, VERDICTS, Result, Table
from radartwin.runs.run import run_experiment, run_key
from radartwin.store.digest import semantic

SOURCES = {
    module.TABLE.name: module
    for module in (
        turntable_shape, turntable_material, linear_rail, environment, rover_fidelity, labelled_probe, turntable_label_free,
        rover_recognition, reconstruction_ablation,
    )
}  # fmt: skip
DEPENDS, AGREES, NOT_COMPARED = "depends on strength", "the verdicts agree", "not compared"
NOMINAL = 1.0
WHOLE = "whole campaign"
COPIED = ("claim", *JUDGED, "reason", "items", "seed", "run_keys", *SCORE_COLUMNS, "draws")  # columns from the row of the other table
Rows = Sequence[Mapping[str, Any]]

TABLE = Table(
    name="headline",
    title="The paper's main claims",
    caption="Each row is one claim of the paper, which the table in the column 'table' states. Value, interval and verdict are those with "
    "all differences between testbed and simulation at their published size (strength 1), over all recordings. The intervals have the "
    "level in the column 'level' (Holm's correction). The columns 'strength' give value, interval and verdict at each strength, with the "
    "number of draws in brackets. They rest on a campaign of their own (profile.strength_campaign, which starts at draw 0 and is smaller "
    "than that of the paper profile), so that the column 'strength 1' may differ from the value. 'Over all strengths' compares the "
    "verdicts of these columns. The quick profile has strength 1 alone. 'Evidence' names the draws of the value; "
    "all draws and settings but the registered ones are exploratory (experiments/gaps/registration.py).",
)


@dataclass(frozen=True)
class Headline:
    """One claim of the paper, and the table row that judges it."""

    text: str  # the claim in words
    source: str  # where the paper states it
    table: str
    metric: str
    where: Mapping[str, Any] = field(default_factory=dict)  # values that further columns of the row must have
    unless: Mapping[str, Any] = field(default_factory=dict)  # the claim is left out if a row of the table has all these values
    claim: Claim = NONE  # the row must state it too; without a bound, the bound is the accuracy of chance
    test: tuple[str, str] = (STUDENT, "draws")  # test of the claim and unit of this test, over all draws of the paper profile


ON_OBJECTS, ON_BOTH = (PERMUTATION, "objects"), (STUDENT, "draws and objects")  # tests
GAIN = Claim(bound=LEAST_GAIN, null=0.0)
DRIVES = ("rover_fidelity", "rover_recognition", "reconstruction_ablation")  # tables of drives; all others are of turntable and rail
REGISTERED = {False: range(100, 110), True: range(100, 103)}  # draws that decide the registered claims; True: of drives
REGISTERED_PROFILE = ("profile=paper", f"profile.campaign.first_draw={REGISTERED[False][0]}")
AT_1_M = {"distance_m": 1.0}  # every profile has turntable recordings at 1 m, and the quick profile at no other distance


def on_probe(probe: str, unless: Mapping[str, Any]) -> list[Headline]:
    """Return the two claims about the table labelled_probe for one of its probes (ways to classify with labelled recordings)."""
    case, pretrained = {"supervision": "few_shot", "probe": probe, "layout": None}, labelled_probe.PRETRAINED
    return [
        Headline(
            f"{text} ({probe})", "labelled probe", "labelled_probe", "gain in accuracy", {**case, "method": f"{pretrained} - {other}"},
            unless, GAIN,
        )
        for text, other in (
            ("training on simulation beats raw features", labelled_probe.RAW),
            ("training on our simulation is more accurate than on RF-Genesis", labelled_probe.RIVAL),
        )
    ]  # fmt: skip


HEADLINES = (
    Headline(
        "the simulated order of objects by harmonic ratio is the measured order", "turntable, shape", "turntable_shape",
        "order of objects", {"case": "all objects"}, claim=turntable_shape.ORDER, test=ON_OBJECTS,
    ),
    Headline(
        "distances between objects are kept", "turntable, shape", "turntable_shape", "distances between objects", {"case": "all objects"},
        claim=turntable_shape.STRUCTURE, test=ON_OBJECTS,
    ),
    Headline(
        "cans have smaller harmonic ratios than reflector and bottles", "turntable, shape", "turntable_shape", "ratio of harmonic ratios",
        {"case": "peaked over cans", "of": "measured"}, claim=turntable_shape.SPLIT, test=ON_BOTH,
    ),
    Headline(
        "metal is brighter than plastic (1 m)", "turntable, material", "turntable_material", "metal less plastic (dB)",
        {"of": "measured", **AT_1_M}, claim=turntable_material.OVER, test=ON_BOTH,
    ),
    Headline(
        "the simulation exaggerates the contrast of metal and plastic (1 m)", "turntable, material", "turntable_material",
        "excess of contrast (dB)", AT_1_M, claim=turntable_material.EXAGGERATES, test=ON_BOTH,
    ),
    Headline(
        "the measured diagonal excursion is smaller than the rail's", "linear rail", "linear_rail", "excursion less the rail's (m)",
        {"object": REFLECTOR, "motion": "diagonal", "tracker": "continuous", "of": "measured"},
        claim=linear_rail.SHORT,
    ),
    Headline(
        "without the room the profiles do not correlate (2 m, amplitude)", "environment", "environment", "profile correlation",
        {"case": "void", "distance_m": 2.0, "scale": "amplitude"}, claim=environment.UNCORRELATED,
    ),
    Headline(
        "the room brings the profile closer to the measured one (2 m, amplitude)", "environment", "environment", environment.GAIN,
        {"distance_m": 2.0, "scale": "amplitude", "case": "room (vlm) - void"}, claim=environment.CLOSER,
    ),
    Headline(
        "most energy arrives from beyond the target (2 m)", "environment", "environment", "energy share beyond the target",
        {"distance_m": 2.0, "case": "measured (testbed)"}, claim=environment.BEYOND,
    ),
    Headline(
        "features order objects alike along drives (squash court)", "rover, fidelity", "rover_fidelity",
        "share of features that order objects alike", {"room": "squash_court", "motion": "depth"},
        claim=rover_fidelity.AGREE["squash_court"], test=ON_OBJECTS,
    ),
    # The probe RECORDINGS has no recording in both training and test. It needs two recordings of each object. The quick profile lacks them,
    # so it uses the probe REVOLUTIONS instead.
    *on_probe(labelled_probe.RECORDINGS, {}),
    *on_probe(labelled_probe.REVOLUTIONS, {"probe": labelled_probe.RECORDINGS}),
    Headline(
        "geometry transfers without labels", "turntable, without labels", "turntable_label_free", "accuracy", {"attribute": "geometry"},
        test=ON_OBJECTS,
    ),
    Headline(
        "material transfers without labels", "turntable, without labels", "turntable_label_free", "accuracy", {"attribute": "material"},
        test=ON_OBJECTS,
    ),
    Headline(
        "identity does not transfer without labels", "turntable, without labels", "turntable_label_free", "accuracy",
        {"attribute": "identity"}, claim=Claim(direction=EQUAL, margin=CHANCE_MARGIN, untestable=SAME_MODELS),
    ),
    Headline(
        "objects are known without labels (squash court, lateral)", "Table 3", "rover_recognition", "accuracy",
        {"supervision": "label_free", "room": "squash_court", "motion": "lateral", "classes": "object", "method": "trained on simulation"},
    ),
    Headline(
        "labelled materials beat one material", "ablation of the reconstruction", "reconstruction_ablation", "gain in accuracy",
        {"classes": "object", "method": "labelled materials - one material"}, claim=replace(GAIN, untestable=FLOOR_ONLY),
    ),
    Headline(
        "the reconstructed room beats none", "ablation of the reconstruction", "reconstruction_ablation", "gain in accuracy",
        {"classes": "object", "method": "labelled materials - no room"}, claim=replace(GAIN, untestable=FLOOR_ONLY),
    ),
)  # fmt: skip


@functools.cache
def _defaults(table: str, *overrides: str) -> Config:
    """Return the default configuration of a table. Reading the option files takes a tenth of a second or more each time."""
    return compose([f"experiment={table}", *overrides])


def at_strength(config: Config, table: str, strength: float) -> Config:
    """Return the configuration of another table, with the profile, simulator and measured recordings of `config`, and all gaps scaled."""
    measured = config.measured
    if measured.provider == "testbed":
        sizes = {name: strength * size for name, size in asdict(measured.gap).items()}
        try:
            measured = replace(measured, gap=replace(measured.gap, **sizes))
        except ConfigError as error:
            raise ConfigError(f"profile.strengths={strength:g} multiplies measured.gap: {error}; choose smaller strengths") from error
    shared = {name: getattr(config, name) for name in ("profile", "simulator", "radar", "seed", "output", "jobs")}
    return replace(_defaults(table), measured=measured, **shared, tracking=replace(config.tracking, backend="off", uri=None))


def strengths(config: Config) -> list[float]:
    """Return the strengths of the profile, with NOMINAL first. Measurements from a recording set have the strength NOMINAL only."""
    if config.measured.provider != "testbed":
        return [NOMINAL]
    return [NOMINAL, *(strength for strength in config.profile.strengths if strength != NOMINAL)]


def compared(config: Config) -> Config:
    """Return the configuration with the campaign at which the strengths are compared."""
    return _lean(replace(config, profile=replace(config.profile, campaign=config.profile.strength_campaign)))


def _lean(config: Config) -> Config:
    """Return the configuration without the recordings that no claim reads."""
    campaign, read = config.profile.campaign, {headline.where.get("room") for headline in HEADLINES}
    campaign = replace(campaign, rover_rooms=[room for room in campaign.rover_rooms if room in read] or campaign.rover_rooms)
    none = {"unknown_contents": False, "exact_objects": False, "layout_turns": 0, "operating_points": False}
    return replace(config, profile=replace(config.profile, campaign=campaign, **none))


def tables(config: Config) -> dict[tuple[float | str, str], Config]:
    """Return the configuration of each table that the rows compare, by strength and name. An entry with WHOLE in place of the strength
    has strength 1 and the whole campaign. Raises ConfigError for an unknown object in a campaign.
    """
    planned(config.profile.campaign, measured=True)
    planned(config.profile.strength_campaign, measured=True)
    usual = config.profile.campaign.first_draw == 0  # other draws are read by this table alone
    whole = config if usual else _lean(config)
    configs: dict[tuple[float | str, str], Config] = {(WHOLE, name): at_strength(whole, name, NOMINAL) for name in SOURCES}
    several = strengths(config)
    if len(several) > 1:
        few = compared(config)
        configs |= {(strength, name): at_strength(few, name, strength) for strength in several for name in SOURCES}
    return configs


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    """Return the recordings that the store lacks, at all strengths, for those tables that have a function `recordings`."""
    listed = {name: module.recordings for name, module in SOURCES.items() if hasattr(module, "recordings")}
    return joined([listed[name](table_config, store, progress) for (_, name), table_config in tables(config).items() if name in listed])


def run(config: Config, store: Store, progress: Progress) -> Result:
    return score(config, lambda table_config: run_experiment(table_config, progress=progress)[0])


def score(config: Config, computed: Callable[[Config], Result]) -> Result:
    """Build one row for each claim whose table has a row for it; `computed` returns the result of a configured table."""
    rows_of: dict[tuple[float | str, str], Rows] = {}
    known: dict[str, Result] = {}
    for (strength, name), table_config in tables(config).items():
        key = run_key(table_config)
        if key not in known:
            known[key] = computed(table_config)
        rows_of[strength, name] = known[key].rows
    rows: list[dict[str, Any]] = []
    several = sorted({strength for strength, _ in rows_of} - {WHOLE})
    for headline in HEADLINES:
        listed = rows_of[WHOLE, headline.table]
        if headline.unless and any(_has(row, headline.unless) for row in listed):
            continue
        nominal = _row(listed, headline)
        if nominal is None:
            continue
        at = {strength: _row(rows_of[strength, headline.table], headline) for strength in several}
        verdicts = {None if row is None else row["verdict"] for row in at.values()}
        case = {
            "claim of the paper": headline.text, "source": headline.source, "table": headline.table,
            **{f"strength {strength:g}": _told(row) for strength, row in at.items()},
            "over all strengths": NOT_COMPARED if not verdicts or None in verdicts else DEPENDS if len(verdicts) > 1 else AGREES,
            "evidence": evidence(config, headline.table in DRIVES, nominal.get("draws")),
        }  # fmt: skip
        rows.append({**case, **{name: nominal.get(name) for name in COPIED}, "seed": config.seed})
    at_levels(rows)
    counts = Counter(row["verdict"] for row in rows)
    metrics = {verdict: float(counts[verdict]) for verdict in VERDICTS}
    return Result("headline", rows, {}, metrics, sorted({key for result in known.values() for key in result.keys}))


def evidence(config: Config, drives: bool, count: int | None = None) -> str:
    """Return the draws of a row, and whether they are the registered draws, no more and no fewer, with the settings of the paper profile.
    Other draws and settings are exploratory, and so is a row that only `count` of the draws have.
    """
    read, usual = draws.numbers(config, drives), _defaults(TABLE.name, *REGISTERED_PROFILE)
    alike = read == list(REGISTERED[drives]) and count in (None, len(read)) and semantic(config) == semantic(usual)
    return f"draws {read[0]} to {read[-1]}, {'registered' if alike else 'exploratory'}"


def _row(rows: Rows, headline: Headline) -> Mapping[str, Any] | None:
    """Return the row with a claim that has the metric and the columns of a headline, or None. Raises ValueError if several rows fit."""
    fits = [row for row in rows if row["metric"] == headline.metric and row.get("claim") and _has(row, headline.where)]
    if len(fits) > 1:
        raise ValueError(f"headline {headline.text!r}: {len(fits)} rows of the table {headline.table} fit; give more columns of its row")
    return fits[0] if fits else None


def _has(row: Mapping[str, Any], columns: Mapping[str, Any]) -> bool:
    return all(row.get(name) == value for name, value in columns.items())


def _told(row: Mapping[str, Any] | None) -> str:
    if row is None:
        return "no such row"
    draws = row.get("draws") or 1
    verdict = f"{row['verdict']} ({draws} draw{'s' if draws > 1 else ''})"
    if row["value"] is None:
        return verdict
    return f"{row['value']:.3g} [{row['low']:.3g}, {row['high']:.3g}], {verdict}"


def at_levels(rows: Sequence[dict[str, Any]]) -> None:
    """Judge the rows as one family by Holm's correction (Scandinavian Journal of Statistics 6 (1979) 65): the claim of rank i of m has the
    level 1 - 0.05/(m - i + 1). A claim without a p value counts as p = 1. Claims that the testbed cannot decide are no tests.
    """
    claims = sorted((row for row in rows if row["verdict"] != NOT_HERE), key=lambda row: 1.0 if row["p"] is None else row["p"])
    for rank, row in enumerate(claims):
        row |= {"family": PRIMARY, "level": 1 - (1 - LEVEL) / (len(claims) - rank)}
        if row["p"] is None:
            continue
        ends = at_level(row["value"], *_numbers(row, "low", "high"), row["level"], row["freedom"], row["interval_scale"] or "")
        row["low"], row["high"] = (float(end) if math.isfinite(end) else None for end in np.clip(ends, *_numbers(row, "lowest", "highest")))
        row["verdict"] = judge(*(row[name] for name in ("value", "low", "high", "bound", "direction", "null", "margin", "reason")))


def _numbers(row: Mapping[str, Any], low: str, high: str) -> tuple[float, float]:
    """Return two ends of a row, of which None is infinite."""
    return (-math.inf if row[low] is None else row[low]), (math.inf if row[high] is None else row[high])

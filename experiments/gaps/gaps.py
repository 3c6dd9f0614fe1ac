"""Each gap between the testbed and the twin: none with all of them off, and what each one moves alone.

(a) All gaps off, the twin told the true materials and the exact room: simulated and measured recordings of the same cases are the same but
for the room's storage in single precision. How much that is, is told in decibels of the complex signal and of the mean range profile,
beside the solver's own error, which is what finer tracing with one bounce more changes. (b) Each gap alone at strength 1, in the paper
profile at 2 too: how far it moves the features, beside what physics says of it (experiments/gaps/claims.py, written before the run).
Geometry moves the twin, all others the testbed.

Read with care: a row is one draw of the gap (measured.gap, seed), not the mean over testbeds. Roughness is a factor either way on heights
that the rooms nominally have, and what it takes from mirror images returns as scatter, so that a room may read louder; the turntable's
motor and gear are clutter inside the target gate; geometry's scan is of the room with its clutter, which the truth of these rows has not.

Cost in the quick profile: 270 core seconds of recordings, 150 more where the store does not hold the scans of both rooms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import statistics
from experiments.campaign.cases import Case
from experiments.claims import NONE, Claim, row
from experiments.gaps import case_set
from experiments.gaps.case_set import CASES, FILLED, GAPS, GROUPS, METAL, Reading
from experiments.gaps.claims import expected
from radartwin.config.config import Config
from radartwin.errors import ConfigError
from radartwin.io.progress import Progress
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="gaps",
    title="Each gap by itself",
    caption="The row 'none' has every gap off and gives the twin the true materials and the exact room. The remaining difference "
    "between the domains comes from storing the room in single precision; it must stay below the change that finer tracing with "
    "one more bounce makes. Every other row switches on one gap and gives the resulting change of the features of the same "
    "recordings, beside a prediction from physics that was written before the first run. Changes of the complex signal are "
    "given in the target gate and from half a metre beyond it. The geometry gap changes the twin; all other gaps change the "
    "testbed. The cases are three objects on the lab's turntable and one drive in the squash court. Intervals are bootstraps "
    "over objects.",
)

NONE_DB = -80.0  # of the figure: what is less is none
CHANGE = " change (dB)"  # what ends the name of a ratio of signals
SHOWN = ("turntable", "drive")  # groups whose every feature has a row
# Turns of so many frames that they are interpolated (experiments/campaign/truth.py, aspects)
INTERPOLATED = {"quick": ((METAL[1], 6),), "paper": ((METAL[1], 6), (FILLED[0], 43))}
Moves = dict[tuple[str, float], dict[Case, dict[str, float]]]  # by gap and strength: of each case how far each feature moves
Keys = dict[tuple[str, float], list[str]]


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Rows of agreement with all gaps off, then of every gap alone."""
    check(config)
    strengths = (1.0,) if config.profile.name == "quick" else (1.0, 2.0)
    steps = [(gap, s) for gap in GAPS for s in strengths if gap != "solver" or s == 1]  # the solver is on or off
    base = {case: case_set.recorded(case_set.alone(config), store, progress, "measured", case) for case in CASES}
    exact = _twins(config, store, progress, None)
    moves: Moves = {}
    keys: Keys = {}
    for gap, strength in progress.over(steps, "gaps"):
        if gap == "geometry":
            found, against = _twins(config, store, progress, strength), exact
        else:
            alone = case_set.alone(config, gap, strength)
            found, against = {case: case_set.recorded(alone, store, progress, "measured", case) for case in CASES}, base
        moves[gap, strength] = {case: _moved(gap, found[case], against[case]) for case in CASES}
        keys[gap, strength] = case_set.keys([*found.values(), *against.values()])
    rows = _agreement(config, base, exact, moves["solver", 1.0])
    rows += [_interpolated(config, store, progress, base[case], case, turns) for case, turns in INTERPOLATED.get(config.profile.name, ())]
    rows += [line for step in moves for line in _rows(config, step, moves[step], keys[step])]
    figures: dict[str, Callable[[], Figure]] = {"gaps": lambda: _figure(moves, rows)}
    metrics = {f"{gap}_{strength:g}_{group}_room_change_dB": _mean(moves[gap, strength], group, "room change (dB)")
               for gap, strength in moves for group in SHOWN if strength == 1}  # fmt: skip
    return Result(TABLE.name, rows, figures, metrics, sorted({key for some in keys.values() for key in some}))


def check(config: Config) -> None:
    """Refuse what would be overridden without a word.

    Raises:
        ConfigError: recordings, gaps or materials that the table sets by itself.
    """
    case_set.check_untouched(config)
    if config.materials.source != "true":
        raise ConfigError(f"experiment=gaps tells the twin the true materials; leave materials={config.materials.source} out")


def _twins(config: Config, store: Store, progress: Progress, geometry: float | None) -> dict[Case, Reading]:
    """Every case as the twin has it in the exact room (None), or in a scan."""
    alone = case_set.alone(config) if geometry is None else case_set.alone(config, "geometry", geometry)
    return {case: case_set.recorded(alone, store, progress, "twin", case) for case in CASES}


def _moved(gap: str, one: Reading, base: Reading) -> dict[str, float]:
    found = case_set.moved(one, base)
    if gap == "hardware":  # nothing else has noise or leakage
        found |= {"noise floor (dB)": one.noise_db, "level at zero range, risen by (dB)": one.zero_db - base.zero_db}
    return found


def _agreement(
    config: Config, base: Mapping[Case, Reading], exact: Mapping[Case, Reading], solver: Mapping[Case, dict[str, float]]
) -> list[dict[str, Any]]:
    """What is left with all gaps off, case by case, against what finer tracing changes."""
    rows = []
    for case in CASES:
        found = case_set.moved(exact[case], base[case])
        keys = case_set.keys([base[case], exact[case]])
        for feature in ("target change (dB)", "room change (dB)"):
            own = solver[case][feature]
            claim = Claim(f"less than the solver's own error, {own:.1f} dB", below=own, least=1)
            rows.append(_row(config, "none", 0.0, case.name, feature, [found[feature]], keys, claim))
        difference = case_set.profile_difference_db(exact[case], base[case])
        rows.append(_row(config, "none", 0.0, case.name, "mean range profile, rms difference (dB)", [difference], keys))
    return rows


def _interpolated(config: Config, store: Store, progress: Progress, traced: Reading, case: Case, turns: int) -> dict[str, Any]:
    """A turn that is interpolated from aspects against the same turn with every frame traced."""
    many = case_set.alone(config, turns=turns)
    blended = case_set.recorded(many, store, progress, "measured", case, case_set.FRAMES)
    change = case_set.change_db(blended, traced, traced.target)
    claim = Claim("aspects stand for every frame", below=-20.0, least=1)
    return _row(config, "none", 0.0, f"{case.name}, interpolated", f"target{CHANGE}", [change], case_set.keys([traced, blended]), claim)


def _rows(config: Config, step: tuple[str, float], moves: Mapping[Case, dict[str, float]], keys: list[str]) -> list[dict[str, Any]]:
    """Every feature of the shown groups, and what is claimed of others."""
    claims = {(group, feature): claim for group, feature, claim in expected(*step)}
    wanted = [(group, feature) for group in SHOWN for feature in moves[GROUPS[group][0]]]
    wanted += [key for key in claims if key not in wanted]
    rows = []
    for group, feature in wanted:
        values = [moves[case][feature] for case in GROUPS[group]]
        if np.isfinite(values).all():
            rows.append(_row(config, *step, group, feature, values, keys, claims.get((group, feature), NONE)))
    return rows


def _row(
    config: Config, gap: str, strength: float, cases: str, metric: str, values: list[float], keys: list[str], claim: Claim = NONE
) -> dict[str, Any]:
    ratios = metric.endswith(CHANGE)  # whose decibels have no mean
    samples = 10 ** (np.array(values) / 20) if ratios else np.array(values)
    found = statistics.mean(samples, config.profile.resamples, config.seed)
    if ratios:
        value, low, high = (20 * float(np.log10(one)) for one in (found.value, found.low, found.high))
        found = replace(found, value=value, low=low, high=high)
    return row(config, {"gap": gap, "strength": strength, "cases": cases}, metric, found, keys, claim)


def _mean(moves: Mapping[Case, dict[str, float]], group: str, feature: str) -> float:
    return 20 * float(np.log10(np.mean([10 ** (moves[case][feature] / 20) for case in GROUPS[group]])))


def _figure(moves: Moves, rows: list[dict[str, Any]]) -> Figure:
    """Change of the signal in the target gate and in the room by each gap alone, turntable and drive, beside what is left with none."""
    drawing, panels = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=3.2, sharey=True, sharex=True)
    ordered = sorted(GAPS, key=lambda gap: _mean(moves[gap, 1.0], "turntable", f"room{CHANGE}"))
    places = np.arange(1 + len(ordered))
    for panel, group in zip(panels, SHOWN, strict=True):
        names = {case.name for case in GROUPS[group]}
        for part, colour, marker, shift in (("target", PALETTE[1], "o", 0.14), ("room", PALETTE[0], "s", -0.14)):
            feature = part + CHANGE
            left = [10 ** (r["value"] / 20) for r in rows if r["gap"] == "none" and r["metric"] == feature and r["cases"] in names]
            values = np.array([20 * np.log10(np.mean(left)), *(_mean(moves[gap, 1.0], group, feature) for gap in ordered)])
            label = "target gate" if part == "target" else "room, 0.5 m and more from it"
            panel.plot(np.maximum(values, NONE_DB), places + shift, marker, color=colour, ms=4.5, label=label, clip_on=False)
        panel.axvline(0, color="0.6", lw=0.6)
        panel.grid(axis="x", color="0.9", lw=0.5)
        panel.hlines(places[1:] - 0.5, NONE_DB, 10, color="0.93", lw=0.5)
        count = len(GROUPS[group])
        panel.set(title=f"{group}, {count} {'object' if count == 1 else 'objects'}", xlim=(NONE_DB, 10))
        panel.set_xlabel("change of the complex signal (dB)")
        panel.set_xticks([NONE_DB, -60, -40, -20, 0], ["none", "−60", "−40", "−20", "0"])
    panels[0].set_yticks(places, ["all off", *ordered])
    drawing.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return drawing

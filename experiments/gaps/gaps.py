"""The table `gaps`: agreement of simulation and virtual measurement with all gaps off, and the effect of each gap alone.

A gap is one kind of difference between virtual measurement (testbed) and simulation, set by measured.gap. In the rows of a gap, this gap
has strength 1 and all other gaps are off. The paper profile also uses strength 2. The predicted effects are in experiments/gaps/claims.py.

A table row of the paper profile is the mean over DRAWS random draws of the gap; the quick profile has one draw. The solver gap always has
one draw, because nothing about it is random. Roughness moves power from the specular reflection to diffuse scatter, so the echo power of a
rougher room can be higher. The turntable's motor and gear are clutter inside the target gate. In the rows of the geometry gap, the
simulated scan contains the room's clutter, but the virtual measurements do not. The quick profile needs 270 core-seconds to simulate the
recordings, and 150 core-seconds more if the scans of both rooms are not in the store.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import statistics
from experiments.campaign.cases import Case
from experiments.campaign.truth import DRAW_STEP
from experiments.claims import BELOW, NONE, Claim, RowList
from experiments.drawing import legend_above
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
    caption="A gap is one kind of difference between testbed and twin. The row 'none' has every gap off and gives the twin the true "
    "materials and the exact room. The domains must then differ by less than the change that finer tracing with one more "
    "bounce makes. Every other row switches one gap on and gives the change of the features, beside a prediction from "
    "physics. Changes of the complex signal are given in the target gate, and in the room more than half a metre from the target. "
    "The geometry gap changes the twin; all other gaps change the testbed. The cases are three objects on the lab's "
    "turntable and one drive in the squash court. The column 'source' says where the size of a gap at strength 1 comes from. Intervals "
    "are bootstraps over draws and objects.",
)

LOWEST_SHOWN_DB = -80.0  # lower end of the figure's axis
CHANGE = " change (dB)"  # ending of the names of features that give the change of the complex signal
SHOWN = ("turntable", "drive")  # groups of cases that have a row for every feature
# (case, number of revolutions) of recordings whose frames are interpolated (`aspects` in experiments/campaign/truth.py)
INTERPOLATED = {"quick": ((METAL[1], 6),), "paper": ((METAL[1], 6), (FILLED[0], 43))}
DRAWS = {"quick": 1, "paper": 3}
Moves = dict[tuple[str, float], list[dict[Case, dict[str, float]]]]  # [gap, strength][draw][case][feature]: change of the feature
Keys = dict[tuple[str, float], list[str]]


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute the agreement with all gaps off, then the effect of each gap alone. Raises ConfigError for settings that the table sets
    itself.
    """
    check(config)
    strengths = (1.0,) if config.profile.name == "quick" else (1.0, 2.0)
    # the solver gap is only on or off, and nothing about it is random
    steps = [
        (gap, s, draw) for gap in GAPS for s in strengths for draw in range(DRAWS.get(config.profile.name, 1))
        if gap != "solver" or (s, draw) == (1, 0)
    ]  # fmt: skip

    def recorded(domain: str, gap: str | None = None, strength: float = 1.0, draw: int = 0) -> dict[Case, Reading]:
        alone = case_set.alone(config, gap, strength)
        if domain == "twin":  # the seed decides the random errors of the scan
            alone = replace(alone, seed=alone.seed + DRAW_STEP * draw)
            return {case: case_set.recorded(alone, store, progress, domain, case) for case in CASES}
        return {case: case_set.recorded(alone, store, progress, domain, replace(case, draw=draw)) for case in CASES}

    base, exact = recorded("measured"), recorded("twin")
    moves: Moves = {}
    keys: Keys = {}
    for gap, strength, draw in progress.over(steps, "gaps"):
        domain, reference = ("twin", exact) if gap == "geometry" else ("measured", base)
        found = recorded(domain, gap, strength, draw)
        moves.setdefault((gap, strength), []).append({case: _moved(gap, found[case], reference[case]) for case in CASES})
        keys.setdefault((gap, strength), []).extend(one.key for one in (*found.values(), *reference.values()))
    rows = RowList(config)
    _add_agreement(rows, base, exact, moves["solver", 1.0][0])
    for case, turns in INTERPOLATED.get(config.profile.name, ()):
        blended = case_set.recorded(case_set.alone(config, turns=turns), store, progress, "measured", case, case_set.FRAMES)
        _add_interpolated(rows, case, base[case], blended)
    for step in moves:
        add_rows(rows, step, moves[step], keys[step])
    metrics = {f"{gap}_{strength:g}_{group}_room_change_dB": _mean(moves[gap, strength], group, "room change (dB)")
               for gap, strength in moves for group in SHOWN if strength == 1}  # fmt: skip
    used = sorted({key for some in keys.values() for key in some})
    return Result(TABLE.name, rows, {TABLE.name: lambda: _figure(moves, rows)}, metrics, used)


def check(config: Config) -> None:
    """Raise ConfigError if the configuration sets measured recordings, gaps or materials, because the table sets these itself."""
    case_set.check_untouched(config)
    if config.materials.source != "true":
        raise ConfigError(f"experiment=gaps gives the twin the true materials itself; leave materials={config.materials.source} out")


def _moved(gap: str, one: Reading, base: Reading) -> dict[str, float]:
    found = case_set.moved(one, base)
    if gap == "hardware":  # only the hardware gap adds noise and leakage
        found |= {"noise floor (dB)": one.noise_db, "level at zero range, risen by (dB)": one.zero_db - base.zero_db}
    return found


def _add_agreement(
    rows: RowList, base: Mapping[Case, Reading], exact: Mapping[Case, Reading], solver: Mapping[Case, dict[str, float]]
) -> None:
    """Add a row for each case with the difference between measurement and simulation with all gaps off.

    The claim in such a row is that this difference is smaller than the change that finer ray tracing causes.
    """
    for case in CASES:
        found = case_set.moved(exact[case], base[case])
        keys = [base[case].key, exact[case].key]
        for feature in ("target change (dB)", "room change (dB)"):
            own = solver[case][feature]
            claim = Claim(f"less than the solver's own error, {own:.1f} dB", bound=own, direction=BELOW, least=1)
            _add(rows, ("none", 0.0, case.name), feature, [[found[feature]]], keys, claim)
        difference = case_set.profile_difference_db(exact[case], base[case])
        _add(rows, ("none", 0.0, case.name), "mean range profile, rms difference (dB)", [[difference]], keys)


def _add_interpolated(rows: RowList, case: Case, traced: Reading, blended: Reading) -> None:
    """Add the difference between a turntable revolution interpolated from traced angles and the revolution with every frame traced."""
    change = case_set.change_db(blended, traced, traced.target)
    claim = Claim("interpolation between traced angles replaces tracing every frame", bound=-20.0, direction=BELOW, least=1)
    _add(rows, ("none", 0.0, f"{case.name}, interpolated"), f"target{CHANGE}", [[change]], [traced.key, blended.key], claim)


def add_rows(rows: RowList, step: tuple[str, float], moves: Sequence[Mapping[Case, dict[str, float]]], keys: list[str]) -> None:
    """Add the rows of a gap at a strength: all features for the case groups in SHOWN, only the predicted features for other groups.

    `moves` holds for each draw the changes of the features of each case.
    """
    claims = {(group, feature): claim for group, feature, claim in expected(*step)}
    wanted = [(group, feature) for group in SHOWN for feature in moves[0][GROUPS[group][0]]]
    wanted += [key for key in claims if key not in wanted]
    for group, feature in wanted:
        values = [[one[case][feature] for case in GROUPS[group]] for one in moves]
        if np.isfinite(values).all():
            _add(rows, (*step, group), feature, values, keys, claims.get((group, feature), NONE))


def _add(
    rows: RowList, where: tuple[str, float, str], metric: str, values: Sequence[Sequence[float]], keys: list[str], claim: Claim = NONE
) -> None:
    """Add one table row for a gap at a strength and a group of cases; `values` holds the values of the cases for each draw. Ratios of
    signals are averaged over cases as amplitudes, and over draws in decibels.
    """
    config = rows.config
    samples, scale = np.array(values), np.asarray
    if metric.endswith(CHANGE):
        samples, scale = 10 ** (samples / 20), _decibels
    limits = statistics.POSITIVE if " rms " in metric else statistics.ANY
    each = [statistics.mean(one, config.profile.resamples, config.seed, limits, scale) for one in samples]
    found = statistics.over_draws(each, config.profile.resamples, config.seed)
    source = config.measured.gap.sources().get(where[0], "")
    row = rows.add({**dict(zip(("gap", "strength", "cases"), where, strict=True)), "source": source}, metric, found, keys, claim)
    row["draws"] = len(values)


def _decibels(amplitude: Any) -> Any:
    return 20 * np.log10(amplitude)


def _mean(moves: Sequence[Mapping[Case, dict[str, float]]], group: str, feature: str) -> float:
    """Return the mean of a ratio of signals in decibels. The cases of a group are averaged as amplitudes, and draws in decibels."""
    return float(np.mean([_decibels(np.mean([10 ** (one[case][feature] / 20) for case in GROUPS[group]])) for one in moves]))


def _figure(moves: Moves, rows: Sequence[dict[str, Any]]) -> Figure:
    """Draw the relative change of the signal in target gate and room, for turntable and drive, for each gap alone and with all gaps off."""
    drawing, panels = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=3.2, sharey=True, sharex=True)
    ordered = sorted(GAPS, key=lambda gap: _mean(moves[gap, 1.0], "turntable", f"room{CHANGE}"))
    places = np.arange(1 + len(ordered))
    for panel, group in zip(panels, SHOWN, strict=True):
        names = {case.name for case in GROUPS[group]}
        for part, colour, marker, shift in (("target", PALETTE[1], "o", 0.14), ("room", PALETTE[0], "s", -0.14)):
            feature = part + CHANGE
            off = [10 ** (r["value"] / 20) for r in rows if r["gap"] == "none" and r["metric"] == feature and r["cases"] in names]
            values = np.array([_decibels(np.mean(off)), *(_mean(moves[gap, 1.0], group, feature) for gap in ordered)])
            label = "target gate" if part == "target" else "room, 0.5 m or more from the target"
            panel.plot(np.maximum(values, LOWEST_SHOWN_DB), places + shift, marker, color=colour, ms=4.5, label=label, clip_on=False)
        panel.axvline(0, color="0.6", lw=0.6)
        panel.grid(axis="x", color="0.9", lw=0.5)
        panel.hlines(places[1:] - 0.5, LOWEST_SHOWN_DB, 10, color="0.93", lw=0.5)
        count = len(GROUPS[group])
        panel.set(title=f"{group}, {count} {'object' if count == 1 else 'objects'}", xlim=(LOWEST_SHOWN_DB, 10))
        panel.set_xlabel("change of the complex signal (dB)")
        panel.set_xticks([LOWEST_SHOWN_DB, -60, -40, -20, 0], ["none", "−60", "−40", "−20", "0"])
    panels[0].set_yticks(places, ["all off", *ordered])
    legend_above(drawing, panels[0], 2)
    return drawing

"""The table `gaps`: agreement of simulation and virtual measurement with all gaps off, and the effect of each gap alone.

A gap has strength 1 (paper profile: also 2); `predictions` predicts its effects. A row of the paper profile is the mean over DRAWS draws.
Roughness moves power from specular reflection to diffuse scatter, so the echo of a rougher room can be stronger. The turntable's motor and
gear are clutter inside the target gate. In the rows of the geometry gap, the scan contains the room's clutter, but the virtual measurements
do not.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments import statistics
from experiments.campaign.cases import Case
from experiments.campaign.frame import Frame
from experiments.campaign.truth import DRAW_STEP
from experiments.cells import Cell, joined_rows, keys, using
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure, legend_above
from experiments.gaps import case_set
from experiments.gaps.case_set import CASES, FILLED, GAPS, GROUPS, METAL, Reading
from experiments.gaps.predictions import expected
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.verdicts import BELOW, NONE, Claim
from radartwin.errors import ConfigError

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
CONDITIONS = ("gap", "strength", "draw", "case", "key")  # columns of the frame of `cells`; the others are features


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute the agreement with all gaps off, then the effect of each gap. Raises ConfigError for settings of the table itself."""
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
    moves = []
    for gap, strength, draw in progress.over(steps, "gaps"):
        domain, reference = ("twin", exact) if gap == "geometry" else ("measured", base)
        for case, reading in recorded(domain, gap, strength, draw).items():
            at = {"gap": gap, "strength": strength, "draw": draw, "case": case, "key": [reading.key, reference[case].key]}
            changes = case_set.moved(reading, reference[case])
            if gap == "hardware":  # only the hardware gap adds noise and leakage
                risen_db = reading.zero_db - reference[case].zero_db
                changes |= {"noise floor (dB)": reading.noise_db, "level at zero range, risen by (dB)": risen_db}
            moves.append({**at, **changes})
    frame = pd.DataFrame(moves)
    rows = [cell.row(config) for cell in agreement(base, exact, frame[frame.gap == "solver"].set_index("case"))]
    for case, turns in INTERPOLATED.get(config.profile.name, ()):
        blended = case_set.recorded(case_set.alone(config, turns=turns), store, progress, "measured", case, case_set.FRAMES)
        rows.append(interpolated(case, base[case], blended).row(config))
    for row in rows:
        row["draws"] = 1
    rows += joined_rows([cell.row(config) for cell in cells(config, draw_frame)] for _, draw_frame in frame.groupby("draw"))
    metrics = {
        f"{r['gap']}_{r['strength']:g}_{r['cases']}_room_change_dB": r["value"]
        for r in rows
        if r["metric"] == f"room{CHANGE}" and r["strength"] == 1 and r["cases"] in SHOWN
    }
    return Result(TABLE.name, rows, {TABLE.name: lambda: _figure(rows)}, metrics, keys(frame.explode("key")))


def check(config: Config) -> None:
    """Raise ConfigError if the configuration sets measured recordings, gaps or materials, because the table sets these itself."""
    case_set.check_untouched(config)
    if config.materials.source != "true":
        raise ConfigError(f"experiment=gaps gives the twin the true materials itself; leave materials={config.materials.source} out")


def agreement(base: Mapping[Case, Reading], exact: Mapping[Case, Reading], solver: Frame) -> Iterator[Cell]:
    """Declare the difference of the domains with all gaps off, claimed to be below the change that finer tracing causes (`solver`)."""
    for case in CASES:
        changes = case_set.moved(exact[case], base[case])
        of = pd.DataFrame({"key": [base[case].key, exact[case].key]})
        for feature in ("target change (dB)", "room change (dB)"):
            solver_db = float(solver.loc[case, feature])
            claim = Claim(f"less than the solver's own error, {solver_db:.1f} dB", bound=solver_db, direction=BELOW, least=1)
            yield _cell(("none", 0.0, case.name), feature, of, [changes[feature]], claim)
        difference = case_set.profile_difference_db(exact[case], base[case])
        yield _cell(("none", 0.0, case.name), "mean range profile, rms difference (dB)", of, [difference])


def interpolated(case: Case, traced: Reading, blended: Reading) -> Cell:
    """Declare the difference between a turntable revolution interpolated from traced angles and the revolution with every frame traced."""
    of, change = pd.DataFrame({"key": [traced.key, blended.key]}), case_set.change_db(blended, traced, traced.target)
    claim = Claim("interpolation between traced angles replaces tracing every frame", bound=-20.0, direction=BELOW, least=1)
    return _cell(("none", 0.0, f"{case.name}, interpolated"), f"target{CHANGE}", of, [change], claim)


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of one draw: all features for the groups SHOWN, the predicted ones for others. A frame row is a case."""
    sources = config.measured.gap.sources()
    for (gap, strength), changes in frame.groupby(["gap", "strength"], sort=False):
        claims, by_case = {(group, feature): claim for group, feature, claim in expected(gap, strength)}, changes.set_index("case")
        wanted = [(group, feature) for group in SHOWN for feature in changes if feature not in CONDITIONS]
        for group, feature in dict.fromkeys((*wanted, *claims)):
            values = by_case.loc[list(GROUPS[group]), feature].to_numpy()
            if np.isfinite(values).all():
                where, claim = (gap, strength, group), claims.get((group, feature), NONE)
                yield _cell(where, feature, changes.explode("key"), values, claim, sources.get(gap, ""))


def _cell(
    where: tuple[str, float, str], metric: str, of: Frame, values: Sequence[float] | NDArray, claim: Claim = NONE, source: str = ""
) -> Cell:
    """Declare the mean over the cases of a gap, a strength and a group of cases. Ratios of signals are averaged as amplitudes."""
    samples, scale = np.array(values), np.asarray
    if metric.endswith(CHANGE):
        samples, scale = 10 ** (samples / 20), _decibels
    estimate = partial(statistics.mean, limits=statistics.POSITIVE if " rms " in metric else statistics.ANY, scale=scale)
    case = {**dict(zip(("gap", "strength", "cases"), where, strict=True)), "source": source}
    return Cell(case, metric, of, using(estimate, samples), claim)


def _decibels(amplitude: Any) -> Any:
    return 20 * np.log10(amplitude)


def _figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw the relative change of the signal in target gate and room, for turntable and drive, for each gap alone and with all gaps off."""
    drawing, panels = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=3.2, sharey=True, sharex=True)
    effect = {(r["gap"], r["cases"], r["metric"]): r["value"] for r in rows if r["strength"] == 1}
    ordered = sorted(GAPS, key=lambda gap: effect[gap, "turntable", f"room{CHANGE}"])
    places = np.arange(1 + len(ordered))
    for panel, group in zip(panels, SHOWN, strict=True):
        names = {case.name for case in GROUPS[group]}
        for part, colour, marker, shift in (("target", PALETTE[1], "o", 0.14), ("room", PALETTE[0], "s", -0.14)):
            feature = part + CHANGE
            off = [10 ** (r["value"] / 20) for r in rows if r["gap"] == "none" and r["metric"] == feature and r["cases"] in names]
            values = np.array([_decibels(np.mean(off)), *(effect[gap, group, feature] for gap in ordered)])
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

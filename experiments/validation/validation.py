"""Validation table (card): every physics check with its reference value, RadarTwin's value, error, limit and verdict.

The checks (cases) are in experiments/validation/oracles and are also physics tests (tests/physics/test_validation.py). With profile=quick,
the cases that take seconds run with some of their sizes, seeds and angles, with profile=paper all cases with all of them.
"""

import math
import time
from collections import Counter
from typing import Any

import numpy as np

from experiments import verdicts
from experiments.drawing import COLUMN_WIDTH_IN, PAGE_WIDTH_IN, PALETTE, Figure, figure
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.statistics import Estimate, exact
from experiments.validation import furnished_rooms
from experiments.validation.oracles import dielectrics, energy, motion, near, rooms, sampling, targets
from experiments.validation.oracles.case import Case, Untestable, reference_rows
from radartwin.runs import workers

TABLE = Table(
    name="validation",
    title="Checks of the tracer",
    caption="Every check of the simulator against an independent reference: closed forms, Mie and layered-cylinder series, near-field "
    "quadrature, image sources of rectangular rooms, full-wave fields of furnished rooms, transfer matrices and exact kinematics. "
    "No reference shares code with the tracer, but references of oil, PET and HDPE take their permittivity from its material table. "
    "Rows whose oracle begins with 'itself' compare two results of the tracer. A row compares n values, in the quick profile fewer "
    "than its text lists; it shows the reference and our value where they differ most. The column value is the error, which must not "
    "exceed the limit.",
)

DOMAIN = "oracle"
SUBJECTS = ("targets", "near field", "rooms", "furnished rooms", "dielectrics", "energy", "motion", "samples")  # in the order of the card
CASES: tuple[Case, ...] = tuple(
    sorted(
        (case for module in (targets, near, rooms, furnished_rooms, dielectrics, energy, motion, sampling) for case in module.CASES),
        key=lambda case: SUBJECTS.index(case.subject),
    )
)
DENSITIES = (1, 2, 4, 8, 16, 32, 64)
NOT_FINITE = 1e9  # shown for an error that is not finite, because a case that fails needs a value


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute every validation case of the profile and return the rows in the order of the validation table."""
    full = config.profile.name != "quick"
    cases = [(case.name, full) for case in CASES if full or case.cost == "quick"]
    with progress.task("validation cases", len(cases)) as done:
        rows = workers.each(named_row, cases, config.jobs, done)
    count = Counter(row["verdict"] or "absent" for row in rows)
    metrics = {f"cases_{word}": float(count[word]) for word in (verdicts.HOLDS, verdicts.MISSES, "absent")}
    metrics |= {f"share_of_limit_{r['case']}": r["error"] / r["limit"] for r in rows if r["verdict"] == verdicts.MISSES}
    figures = {
        "validation_rcs_pattern": lambda: _pattern_figure(full),
        "validation_ray_count": lambda: _ray_count_figure(full),
        "validation_near_field": lambda: _near_figure(full),
        "validation_room_profile": lambda: _room_figure(full),
        "validation_furnished_room": lambda: furnished_rooms.drawing(furnished_rooms.worst(full)),
    }
    return Result(TABLE.name, rows, figures, metrics)


def named_row(name: str, full: bool) -> dict[str, Any]:
    """Compute the case of this name. A worker cannot receive the functions of a case."""
    return row(next(case for case in CASES if case.name == name), full)


def row(case: Case, full: bool) -> dict[str, Any]:
    """Compute a validation case and return its table row, whose `oracle` says why a case cannot be tested."""
    started = time.perf_counter()
    oracle, reference, simulated, error, seconds, estimate = case.oracle, None, None, None, None, exact(math.nan, 0)
    try:
        finding = case.compare(full)
        reference, simulated, error = finding.reference, finding.simulated, finding.error if math.isfinite(finding.error) else NOT_FINITE
        seconds, estimate = round(time.perf_counter() - started, 2), Estimate(error, -math.inf, math.inf, finding.n)  # without an interval
    except Untestable as reason:
        oracle = f"absent: {reason}"
    return {
        "subject": case.subject, "case": case.name, "claim": case.claim, "oracle": oracle, "reference": reference, "ours": simulated,
        "error": error, "limit": case.limit, "unit": case.unit or "-",
        **verdicts.score_columns(case.metric, estimate, DOMAIN, error is not None and error <= case.limit), "seconds": seconds,
    }  # fmt: skip


def _pattern_figure(full: bool) -> Figure:
    """Draw the cross-section of a trihedral over azimuth and of a plate over angle, together with their references."""
    azimuth = np.linspace(-30, 30, 121 if full else 31)
    reference, simulated = targets.pattern(azimuth)
    drawing, (left, right) = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=2.6)
    left.plot(azimuth, reference, color="0.6", lw=2.5, label="quadrature of all bounces")
    left.plot(azimuth, simulated, color=PALETTE[0], label="tubes, 4 rays")
    try:
        table = [(float(r["az_deg"]), float(r["SBR_h0.1_dBsm"])) for r in reference_rows("trihedral_10cm_pattern.csv")]
        within = np.array([pair for pair in table if abs(pair[0]) <= 30])
        left.plot(*within[::4].T, ".", color=PALETTE[1], ms=3, label="reference table (prototype)")
    except Untestable:
        pass
    left.set(title="trihedral, leg 10 cm", xlabel="azimuth (deg)", ylabel="cross-section (dBsm)")
    left.legend(loc="lower center")
    angle = np.radians(np.linspace(0, 12, 121 if full else 41))
    mesh = targets.objects.plate(0.1, 0.1)
    right.plot(np.degrees(angle), [targets.db(max(targets.plate_rcs(0.1, a), 1e-6)) for a in angle], color="0.6", lw=2.5, label="sinc$^2$")
    measured = [targets.level(mesh, (np.cos(a), np.sin(a), 0.0), 1.0) for a in angle]
    right.plot(np.degrees(angle), measured, color=PALETTE[0], label="tubes, 1 ray")
    right.set(title="plate 10 cm", xlabel="angle (deg)", ylim=(-35, 22))
    right.legend(loc="upper right")
    return drawing


def _ray_count_figure(full: bool) -> Figure:
    """Draw the largest error over sizes and ray-grid offsets against the number of rays per square wavelength."""
    drawing, axes = figure(1, 1, width_in=COLUMN_WIDTH_IN, height_in=2.6)
    densities = DENSITIES if full else DENSITIES[:5:2]
    for number, target in enumerate(targets.TARGETS):
        errors = [targets.at_density(target, float(density), full).error for density in densities]
        axes.plot(densities, np.maximum(errors, 1e-3), "o-", ms=3, color=PALETTE[number], label=target.name)
    axes.plot([1, 4, 64], [0.5, 0.25, 0.25], color="0.3", lw=0.8, ls="--", drawstyle="steps-post", label="limit")
    axes.set(xscale="log", yscale="log", xlabel="rays per square wavelength", ylabel="largest error (dB)", ylim=(3e-3, 8))
    axes.legend(ncols=2, loc="upper right")
    return drawing


def _near_figure(full: bool) -> Figure:
    """Draw the effective cross-section of the near-field targets against distance."""
    distances = np.geomspace(0.3, 10, 41 if full else 13)
    drawing, axes = figure(1, 1, width_in=COLUMN_WIDTH_IN, height_in=2.6)
    for number, (name, (_, meshes)) in enumerate(near.MESHES.items()):
        reference, simulated = near.curve(name, next(iter(meshes)), distances)
        axes.plot(distances, reference, color=PALETTE[number], lw=2.5, alpha=0.35)
        axes.plot(distances, simulated, "o", ms=2.5, color=PALETTE[number], label=f"{name} 10 cm")
    axes.set(xscale="log", xlabel="distance (m)", ylabel="effective cross-section (dBsm)")
    axes.plot([], [], color="0.7", lw=2.5, label="quadrature")
    axes.plot([], [], "o", ms=2.5, color="0.3", label="4 tubes per square wavelength")
    axes.legend(loc="lower right")
    return drawing


def _room_figure(full: bool) -> Figure:
    """Draw the range profile of the squash court by image sources and by RadarTwin's tracer."""
    drawing, axes = figure(1, 1, width_in=PAGE_WIDTH_IN, height_in=2.4)
    methods = [("tubes", 1_200_000, "tubes, 1.2M rays"), ("tubes", 2_900_000, "tubes, 2.9M rays"), ("panels", 1_200_000, "flat faces")]
    exact = np.zeros(1)
    for number, (method, rays, label) in enumerate(methods if full else methods[::2]):
        axis, exact, simulated = rooms.compared("court", "constant", method, rays).profiles()
        inside = axis < 22
        if not number:
            axes.plot(axis[inside], exact[inside], color="0.6", lw=2.5, label="128 image sources")
        axes.plot(axis[inside], simulated[inside], color=PALETTE[number], lw=0.9, label=label)
    axes.set(xlabel="range (m)", ylabel="received / transmitted (dB)", title="squash court, |reflection| 0.4, 4 bounces")
    axes.set_ylim(top=axes.get_ylim()[1], bottom=float(exact.max()) - 70)
    axes.legend(loc="upper right")
    return drawing

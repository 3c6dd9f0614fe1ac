"""Facet ripple: the echo of a can made of flat facets varies with as many cycles per revolution as the can has facets.

A can of FACETS flat facets, and the same mesh curved by vertex normals, are simulated in the far field and at one metre. Both repeat after
one facet, so ASPECTS_PER_FACET angles represent all 2048 angles of a revolution. Ripple is the harmonic ratio of the band around FACETS.
Paper, disentangled fidelity, shape: the triangulated mesh ripples at about 128 cycles per revolution, smooth objects do not.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments.statistics import LOG, POSITIVE, Estimate, students_t
from experiments.verdicts import NONE, Claim, Row
from radartwin.config.config import Config
from radartwin.features.envelope import harmonic_ratio

if TYPE_CHECKING:
    import trimesh

FACETS = 128
ASPECTS_PER_FACET = 16
RADIUS_M, HEIGHT_M = 0.0683 / 2, 0.1016  # radius and height of the soup can in metres
APART_M = 1e-6  # gap between facets, so that they have no common vertices and stay flat
NEAR_M = 1.0
HALF_BAND = 8  # cycles per revolution on each side of FACETS
SEEDS = (1, 2, 3)  # random seeds of the ray grid
RIPPLES = Claim("flat facets ripple at their own number of cycles", "about 128 cycles", bound=10.0, null=1.0)


def can(flat: bool) -> trimesh.Trimesh:
    """Build the side wall of a can of FACETS facets along z, which are flat or curved by vertex normals."""
    import trimesh

    corner = 2 * np.pi * np.arange(FACETS + 1) / FACETS
    around = RADIUS_M * np.stack([np.cos(corner), np.sin(corner)], axis=1)
    start, end = around[:-1], around[1:]
    if flat:
        inwards = APART_M / 2 / np.linalg.norm(end - start, axis=1, keepdims=True)
        start, end = start + inwards * (end - start), end - inwards * (end - start)
    low, high = np.full((FACETS, 1), -HEIGHT_M / 2), np.full((FACETS, 1), HEIGHT_M / 2)
    parts = [np.hstack([start, low]), np.hstack([end, low]), np.hstack([end, high]), np.hstack([start, high])]
    first = 4 * np.arange(FACETS)[:, None]
    faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    mesh = trimesh.Trimesh(np.stack(parts, axis=1).reshape(-1, 3), faces, process=False)
    if not flat:
        mesh.merge_vertices()
    return mesh


def envelope(mesh: trimesh.Trimesh, distance_m: float | None, seed: int) -> NDArray[np.float64]:
    """Compute the radar cross-section in m^2 over a revolution, (FACETS * ASPECTS_PER_FACET,). `distance_m=None` is the far field."""
    from radartwin.simulation.rcs import rcs

    angles = 2 * np.pi / FACETS * np.arange(ASPECTS_PER_FACET) / ASPECTS_PER_FACET
    return np.tile([rcs(mesh, [np.cos(a), np.sin(a), 0.0], distance=distance_m, seed=seed) for a in angles], FACETS)


def ripple_rows(config: Config) -> list[Row]:
    """Build rows of the ripple of both cans, whose intervals span all random seeds of the ray grid, and of its ratio (see `ratio`)."""
    rows = []
    for distance in (NEAR_M, None):
        envelopes = {flat: [envelope(can(flat), distance, seed) for seed in SEEDS] for flat in (True, False)}
        band = {
            flat: [harmonic_ratio(curve, FACETS - HALF_BAND, FACETS + HALF_BAND) for curve in curves] for flat, curves in envelopes.items()
        }
        where = "far field" if distance is None else f"{distance:g} m"
        for flat, label in ((True, "flat facets"), (False, "curved facets")):
            case = {"case": f"can of {FACETS} {label}, {where}", "distance_m": distance, "of": "tracer"}
            spanned = Estimate(float(np.median(band[flat])), min(band[flat]), max(band[flat]), len(SEEDS))
            rows.append(_row(config, case, "facet ripple", spanned, NONE))
        case = {"case": f"flat over curved facets, {where}", "distance_m": distance, "of": "tracer"}
        rows.append(_row(config, case, "ratio of ripples", ratio(band[True], band[False]), RIPPLES))
    return rows


def ratio(above: list[float], below: list[float]) -> Estimate:
    """Return the geometric mean of the ratios over seeds, with the interval by Student's t of their logarithms.

    >>> round(ratio([1.0, 10.0, 100.0], [0.1, 1.0, 10.0]).value, 3)
    10.0
    """
    logs = students_t(np.log(np.array(above) / np.maximum(below, 1e-15)), unit="seeds")
    value, low, high = (float(np.exp(log)) for log in (logs.value, logs.low, logs.high))
    return replace(logs, value=value, low=low, high=high, limits=POSITIVE, scale=LOG)


def _row(config: Config, case: dict[str, Any], metric: str, estimate: Estimate, claim: Claim) -> Row:
    return Row(case, metric, estimate, frozenset(), claim, config, domain="none")

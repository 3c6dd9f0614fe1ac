"""The targets of the validation card. Slow tests cover all sizes, random seeds, angles and densities of ray tubes.

A target that the simulator misses is listed with its error. Its test fails if the target holds, or if the error grows by a tenth.
"""

import numpy as np
import pytest
from physics_helpers import WAVELENGTH

from experiments.validation import validation
from experiments.validation.oracles.case import Case, Finding, Untestable
from experiments.validation.oracles.cylinder import conductor_width, layered_width
from experiments.validation.oracles.nearfield import panel_quadrature
from experiments.validation.validation import CASES
from radartwin.runs.experiment import check_rows

QUICK_MISSES = {  # (error, where it occurs)
    "mie-table": (0.633, "5 mm radius, 4 rays"),
    "near-trihedral": (12.2, "10 cm at 0.5 m, in a minimum of the echo; ray tubes do not diffract the light that misses a face"),
    "near-dihedral": (1.35, "10 cm at 0.5 m; ray tubes do not diffract the light that misses a face"),
    "near-table": (0.44, "5 cm trihedral at 1 m; 0.417 at 16 rays per square wavelength"),
    "range-law": (0.108, "the 3 cm dihedral"),
    "panel-panels": (0.027, "largest error of all panels"),
    "furnished-given-profile": (1.503, "corner_cabinet_post; 1.46 if paths are pruned at 0.0005"),
    "furnished-seeded-profile": (7.6, "corner_02"),
    "furnished-seeded-complex": (0.17, "corner_02"),
}
FULL_MISSES = QUICK_MISSES | {
    "near-dihedral": (1.77, "15 cm at 1 m; ray tubes do not diffract the light that misses a face"),
    "panel-tubes": (0.029, "largest error of all panels, 4 rays"),
    "slabs-oblique": (0.22, "wood before concrete: a wave that is reflected once and diffracted once counts in an echo 45 dB below metal"),
    "reciprocity-single": (0.133, "curved targets at 0.5 m"),
    "scattered-power-corner": (0.185, "physical optics in a corner does not conserve energy"),
    "two-panels-tubes": (0.057, "the gap of 1 mm is closed, and the quadrature has no light that misses a panel"),
    "two-panels-panels": (0.05, "the gap of 1 mm between the panels is closed"),
    "room-1.2m-tubes": (0.092, "the corridor of |reflection| 0.4; within 0.08 in the other rooms"),
    "room-2.9m-tubes": (0.032, "the corridor of |reflection| 0.4; within 0.03 in the other rooms"),
    "furnished-seeded-profile": (8.6, "free_25"),
    "furnished-seeded-complex": (0.33, "corridor_13"),
}


class Missed(AssertionError):
    """The error is above the limit of the target, and at most a tenth above the listed error."""


def cases(full: bool) -> list:
    misses = FULL_MISSES if full else QUICK_MISSES
    return [
        pytest.param(case, id=case.name, marks=_expected(case, misses.get(case.name))) for case in CASES if full or case.cost == "quick"
    ]


def _expected(case: Case, miss: tuple[float, str] | None) -> list[pytest.MarkDecorator]:
    if miss is None:
        return []
    unit = f" {case.unit}" if case.unit else ""
    reason = f"known miss: error {miss[0]}{unit}, limit {case.limit}{unit} ({miss[1]})"
    return [pytest.mark.xfail(strict=True, raises=Missed, reason=reason)]


def check(case: Case, full: bool) -> None:
    try:
        found = case.compare(full)
    except Untestable as reason:
        pytest.skip(str(reason))
    miss = (FULL_MISSES if full else QUICK_MISSES).get(case.name)
    message = f"{case.claim}: {found.error:.4g} {case.unit} off {case.oracle}, over {case.limit}"
    if miss and case.limit < found.error <= 1.1 * miss[0]:
        raise Missed(message)
    assert found.error <= case.limit, message


@pytest.mark.parametrize("case", cases(full=False))
def test_quick_case_is_within_its_limit(case: Case) -> None:
    check(case, full=False)


@pytest.mark.slow
@pytest.mark.parametrize("case", cases(full=True))
def test_full_case_is_within_its_limit(case: Case) -> None:
    check(case, full=True)


def test_known_misses_name_existing_cases() -> None:
    assert {*QUICK_MISSES, *FULL_MISSES} <= {case.name for case in CASES}
    assert len({case.name for case in CASES}) == len(CASES)


def test_quadrature_matches_a_midpoint_sum() -> None:
    """The field of a plate, seen from a point on its axis."""
    side, distance, points = 0.1, 0.7, 1500
    x = ((np.arange(points) + 0.5) / points - 0.5) * side
    r = np.sqrt(distance**2 + x[:, None] ** 2 + x**2)
    expected = 1j / (4 * np.pi) * (np.exp(4j * np.pi / WAVELENGTH * r) / r**3 * distance).sum() * (side / points) ** 2
    corners = np.array([[0, -0.05, -0.05], [0, 0.05, -0.05], [0, 0.05, 0.05], [0, -0.05, 0.05]])
    assert panel_quadrature(corners, [distance, 0, 0], WAVELENGTH) == pytest.approx(expected, rel=2e-5)


def test_quadrature_of_a_concave_polygon_is_the_sum_of_its_parts() -> None:
    whole = np.array([[0, 0, 0], [0, 0.2, 0], [0, 0.2, 0.1], [0, 0.1, 0.1], [0, 0.1, 0.3], [0, 0, 0.3]])
    parts = whole[[0, 1, 2]], whole[[0, 2, 3]], whole[[0, 3, 4, 5]]
    sensor = [1.0, 0.07, 0.2]
    total = sum(panel_quadrature(part, sensor, WAVELENGTH) for part in parts)
    assert panel_quadrature(whole, sensor, WAVELENGTH) == pytest.approx(total, rel=1e-9)
    assert panel_quadrature(whole[::-1], sensor, WAVELENGTH) == pytest.approx(total, rel=1e-9)


def test_cylinder_series_has_the_right_limits() -> None:
    """Geometric optics for a large conductor, zero for air, and the metal core for a core inside an empty layer."""
    assert conductor_width(0.5, WAVELENGTH) == pytest.approx(np.pi * 0.5, rel=2e-3)
    assert layered_width([0.033, 0.03], [1.0, 1.0], WAVELENGTH) < 1e-12
    assert layered_width([0.04, 0.033], [1.0], WAVELENGTH) == pytest.approx(conductor_width(0.033, WAVELENGTH), rel=1e-6)


def test_rows_of_a_case_held_missed_and_absent() -> None:
    def absent(full: bool) -> Finding:
        raise Untestable("no table")

    shared = {"subject": "rooms", "claim": "c", "oracle": "o", "metric": "m", "limit": 0.1, "unit": "dB"}
    rows = [
        validation.row(Case(name="held", compare=lambda full: Finding(1.0, 1.05, 0.05), **shared), False),
        validation.row(Case(name="missed", compare=lambda full: Finding(1.0, 2.0, 1.0), **shared), False),
        validation.row(Case(name="not a number", compare=lambda full: Finding(1.0, np.nan, np.nan), **shared), False),
        validation.row(Case(name="absent", compare=absent, **shared), False),
    ]
    check_rows("validation", rows)
    assert [row["verdict"] for row in rows] == ["holds", "misses", "misses", ""]

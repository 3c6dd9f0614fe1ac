"""Check waves that cross panes against an independent transfer matrix: tables, polarisation, counts of panes, and simulated echoes."""

import numpy as np
import pytest
from panes import PANES, C, transmitted

from radartwin.materials import Layered, common_sheet
from radartwin.simulation import reflection_table

LOW_HZ, HIGH_HZ = 77e9, 80.44e9


@pytest.mark.parametrize("name", PANES)
def test_transmission_tables_agree_with_the_transfer_matrix_over_angle_and_sweep(name):
    """The interpolated tables have the transmission of four crossings within 0.01, relative to the incident field."""
    table = reflection_table.build([("metal", 0.0), (Layered(PANES[name]), 0.0)], LOW_HZ, HIGH_HZ)
    assert list(table.opaque) == [True, False]
    f = np.linspace(LOW_HZ, HIGH_HZ, 23)
    basis = reflection_table.lagrange_basis(table.frequencies_hz, f)
    for cosine in (1.0, 0.8, 0.5, 0.2):
        index = round(cosine * (reflection_table.COSINES - 1))
        exact = np.array([transmitted(PANES[name], index / (reflection_table.COSINES - 1), one) for one in f]).T
        for values, expected in zip((table.through_te, table.through_tm), exact, strict=True):
            assert np.abs(values[1, index] @ basis - expected).max() < 4e-3
            assert np.abs(values[1, index] ** 4 @ basis - expected**4).max() < 1e-2


def test_the_frequency_nodes_carry_the_delay_of_a_pane():
    """The phase of the transmission of 6 mm glass over the sweep is that of the 9 mm by which glass lengthens the path."""
    table = reflection_table.build([("glass", 0.0)], LOW_HZ, HIGH_HZ)
    f = np.linspace(60e9, 90e9, 3001)  # a mean over many fringes of the sheet
    exact = np.array([transmitted([("glass", 0.006)], 1.0, one)[0] for one in f])
    slope = -np.polyfit(f, np.unwrap(np.angle(exact)), 1)[0] * C / (2 * np.pi)
    assert slope == pytest.approx(0.006 * (np.sqrt(6.31) - 1), rel=0.02)
    f = np.linspace(LOW_HZ, HIGH_HZ, 41)
    ours = table.through_te[0, -1] @ reflection_table.lagrange_basis(table.frequencies_hz, f)
    exact = np.array([transmitted([("glass", 0.006)], 1.0, one)[0] for one in f])
    assert np.abs(np.angle(ours / exact)).max() < 0.01


def test_half_spaces_backed_stacks_metal_and_thick_walls_are_opaque():
    entries = ["concrete", "metal", Layered([], backing="glass"), Layered([("glass", 0.004)], backing="metal"), Layered([("metal", 1e-3)])]
    table = reflection_table.build([(entry, 0.0) for entry in [*entries, Layered([("concrete", 0.2)])]], LOW_HZ, HIGH_HZ)
    assert table.opaque.all()
    assert not table.through_te.any()
    assert not table.through_tm.any()
    names = ("door", "stud wall", "fabric", "double glazing")
    assert not reflection_table.build([(common_sheet(name), 0.0) for name in names], LOW_HZ, HIGH_HZ).opaque.any()

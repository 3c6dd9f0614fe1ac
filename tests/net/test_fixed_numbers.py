"""Fixed simulations and rows of tables equal the stored ones. `make net` runs these tests on the computer that stored the numbers."""

import json

import fixed_numbers
import numpy as np
import pytest

pytestmark = pytest.mark.net


@pytest.mark.parametrize("name", fixed_numbers.SIMULATIONS)
def test_samples_of_a_simulation(name: str) -> None:
    expected = np.load(fixed_numbers.SAMPLES)[name]
    np.testing.assert_allclose(fixed_numbers.SIMULATIONS[name](), expected, rtol=0, atol=1e-9 * abs(expected).max())


@pytest.mark.parametrize("name", fixed_numbers.TABLES)
def test_rows_of_a_table(name: str) -> None:
    rows, expected = fixed_numbers.rows(name), json.loads(fixed_numbers.ROWS.read_text())[name]
    assert len(rows) == len(expected)
    for row, stored in zip(rows, expected, strict=True):
        assert row.keys() == stored.keys()
        for column, value in stored.items():
            same = pytest.approx(value, rel=1e-9, abs=1e-9) if isinstance(value, float) else value
            assert row[column] == same, (stored, column)

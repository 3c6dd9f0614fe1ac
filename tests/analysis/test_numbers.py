"""Numbers of a text count as found only if a table that their section names holds them, rounded alike."""

import pytest

from analysis import numbers

TABLE = (
    "metric,paper,value,low,high,n\ncorrelation,-0.24 / +0.42,0.7412,0.7385,0.7449,3\n"
    "ratio,0.72-2.5,0.9,,,12\nshare,75 %,0.381,,,12\ntiny,,1.5e-07,,,1200\n"
)
FOUND = [
    "| gain of `rooms` | 0.74 (0.74 to 0.74) | 3 |",
    "`rooms`: 0.741 [0.739, 0.745], 38 % of 1,200, in the paper +0.42 and -0.24, and 0.72 to 2.5",
    "## Heading 99\n\nThe table `rooms` has n = 3.\n\n```\n77 is code\n```\n[a link](to/99.md) and `99` of 2026-11-26",
]
ABSENT = {
    "| `rooms` | 0.75 |": ("0.75", True),
    "`rooms` has a gain of 0.34 (0.74 to 0.74)": ("0.34", False),
    "`rooms` has a gain of 0.741 (0.741 to 0.75)": ("0.75", True),
    "`rooms`\n\n## Another section\n\n| 0.74 |": ("0.74", True),
    "`rooms`: 39 % of the echo": ("39 %", False),
    "`halls` is no table, so 0.74 is not found": ("0.74", False),
}


@pytest.fixture
def known(tmp_path):
    (tmp_path / "rooms.csv").write_text(TABLE)
    return numbers.tables(tmp_path)


@pytest.mark.parametrize("text", FOUND)
def test_numbers_of_the_named_table_are_found(text, known):
    assert numbers.missing(text, known) == []


@pytest.mark.parametrize("text", ABSENT)
def test_other_numbers_are_not_found(text, known):
    number, strict = ABSENT[text]
    assert [(number_in_text.text, number_in_text.strict) for number_in_text in numbers.missing(text, known)] == [(number, strict)]


def test_every_committed_table_has_numbers():
    assert all(numbers.tables().values())

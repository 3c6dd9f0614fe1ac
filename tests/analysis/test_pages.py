"""Pages are filled from tables: places select rows, and the shipped pages hold what the committed tables give."""

import pytest
from jinja2 import UndefinedError

from analysis import numbers
from analysis.pages import choosing, findings, paper_tables, readme
from analysis.pages.template import ROOT, filled

TABLE = """case,paper,value,low,high,draws,verdict
void,-0.24,0.4312,0.402,0.4549,3,contradicted
room,+0.42,0.78,0.78,0.78,10,supported
tiny,,0.0004,,,1,
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "rooms.csv").write_text(TABLE)
    return tmp_path


@pytest.mark.parametrize(("place", "expected"), {
    '{{ row("rooms", case="void") | interval }}': "0.43 (0.40 to 0.45)",
    '{{ row("rooms", case="room") | interval }}': "0.78",  # an interval without a width is left out
    '{{ row("rooms", paper="") | interval }}': "0.0004",
    '{{ row("rooms", case="void").paper | number }}': "-0.24",
    '{{ row("rooms", value=0.4312).low | number }}': "0.40",
    '{{ rows("rooms") | length }}': "3",
    '{{ rows("rooms", absent="") | rejectattr("verdict", "eq", "contradicted") | list | length }}': "2",
    '{{ rows("rooms") | selectattr("verdict") | lines("case", "value", "draws") }}':
        "| void | 0.43 (0.40 to 0.45) | 3 |\n| room | 0.78 | 10 |",
}.items())  # fmt: skip
def test_places_are_filled(place, expected, folder):
    assert filled(place, folder) == expected


@pytest.mark.parametrize(("place", "told"), {
    '{{ row("rooms", draws=4) }}': "0 rows of .*rooms.csv have {'draws': 4}, not one",
    '{{ row("rooms") }}': "3 rows",
    '{{ row("rooms", of="void") }}': "no column 'of'",
    '{{ row("rooms", case="void").p }}': "no attribute 'p'",
    '{{ rows("rooms", case="hall") | lines("case") }}': "no row fits",
    '{{ rows("rooms") | lines("p") }}': "'p'",
    '{{ row("halls", case="void") }}': "halls.csv does not exist; run radartwin tables --profile paper --only halls",
}.items())  # fmt: skip
def test_a_place_that_fits_no_row_is_refused(place, told, folder):
    with pytest.raises((ValueError, KeyError, UndefinedError), match=told):
        filled(place, folder)


@pytest.mark.parametrize("page", [findings, readme, paper_tables, choosing])
def test_pages_follow_from_the_committed_tables(page):
    assert page.PAGE.read_text(encoding="utf-8") == page.text()


def test_a_row_of_the_papers_tables_names_one_row_of_the_results():
    with pytest.raises(ValueError, match=r"turntable_shape\.csv: 4 rows have .*; change paper_tables\.yaml"):
        paper_tables.answer(
            paper_tables.committed,
            "",
            {"table": "turntable_shape", "metric": "order of objects", "of": "both", "case": "all objects at one distance"},
        )


def test_a_primary_claim_has_the_verdict_of_the_headline():
    answer = paper_tables.answer(
        paper_tables.committed,
        "",
        {"table": "environment", "metric": "energy share beyond the target", "case": "measured (testbed)", "distance_m": 2.0},
    )
    assert answer == ("0.25 (0.11 to 0.45 at 99.4 %)", "contradicted", "10")


@pytest.mark.parametrize("page", ["README.md", "docs/findings.md"])
def test_numbers_in_tables_of_the_pages_are_in_the_committed_tables(page):
    missing = numbers.missing((ROOT / page).read_text(encoding="utf-8"), numbers.tables())
    assert not [number for number in missing if number.strict]

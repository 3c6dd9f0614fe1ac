"""Register the claims of the headline before the recordings exist that decide them.

    python -m experiments.gaps.registration write registration.json [docs/results/headline.csv]
    python -m experiments.gaps.registration check registration.json outputs/tables/headline.csv

The first command writes the claims of a headline table with the draws that will decide them, the date and a hash of all this. The second
command refuses a file whose hash does not match, and says which claims of a table differ from the registered ones. The exit status is 2 if
a file is refused, and 1 if a claim differs.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.claims import NOT_HERE, PRIMARY
from radartwin.errors import InputError
from radartwin.io import files
from radartwin.store.digest import spec_digest

CLAIM = ("claim of the paper", "table", "metric", "bound", "direction", "null", "margin", "test", "unit")
FIXED = tuple(name for name in CLAIM if name not in ("bound", "null"))  # chance, a bound of some claims, may differ between campaigns
DRAWS = {"turntable and rail": [100, 109], "drives": [100, 102]}  # first and last


def claims_of(table: Path) -> list[dict[str, str]]:
    """Return the claims of a written headline table that this testbed can decide. Raises InputError for a table without these columns."""
    try:
        with table.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
        return [{name: row[name] for name in CLAIM} | {"family": PRIMARY} for row in rows if row["verdict"] != NOT_HERE]
    except (OSError, KeyError, UnicodeDecodeError) as error:
        raise InputError(f"{table} is no table of the headline ({error!r}); write it with radartwin tables --only headline") from error


def registration(claims: Sequence[dict[str, str]], date: str) -> dict[str, Any]:
    """Return the content of a registration, with its hash. Raises InputError for a claim without a test, bound or direction."""
    for claim in claims:
        for name in ("test", "direction", "bound", "unit"):
            if not claim.get(name):
                raise InputError(f"registration: the claim {claim.get(CLAIM[0])!r} has no {name}; make its table again")
    content = {"date": date, "draws": DRAWS, "claims": list(claims)}
    return {**content, "sha256": spec_digest(content)}


def read(path: Path) -> dict[str, Any]:
    """Read a registration. Raises InputError if it is no registration, was changed after its date, or has a claim without a test."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        found, claims, date = content.pop("sha256"), content["claims"], content["date"]
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is no registration ({error!r})") from error
    if found != spec_digest(content):
        raise InputError(f"{path}: the hash does not match, so the registration was changed after {date}; take the committed file")
    return registration(claims, date)


def differences(registered: dict[str, Any], claims: Sequence[dict[str, str]]) -> list[str]:
    """Return a line for each registered claim that the claims of a table lack or state otherwise, and for each that is not registered."""
    known, found = ({one[CLAIM[0]]: one for one in some} for some in (registered["claims"], claims))
    lines = [
        f"{text!r} is {'not registered' if text in found else 'missing'}"
        for text in {**known, **found}
        if (text in known) != (text in found)
    ]
    for text in known.keys() & found.keys():
        lines += [
            f"{text!r}: {name} {found[text][name]!r}, registered {known[text][name]!r}"
            for name in FIXED
            if found[text][name] != known[text][name]
        ]
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check a registration. Returns the exit status."""
    parser = argparse.ArgumentParser(description="Register the claims of the headline, or check a table against the registered claims.")
    parser.add_argument("verb", choices=("write", "check"))
    parser.add_argument("registration", type=Path)
    parser.add_argument("table", type=Path, nargs="?", default=Path("docs/results/headline.csv"))
    given = parser.parse_args(arguments)
    try:
        claims = claims_of(given.table)
        if given.verb == "write":
            content = registration(claims, datetime.datetime.now(datetime.UTC).date().isoformat())
            files.write_atomically(given.registration, json.dumps(content, indent=1) + "\n")
            print(f"{given.registration}: {len(claims)} claims, sha256 {content['sha256']}")
            return 0
        lines = differences(read(given.registration), claims)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print("\n".join(lines) or f"{given.table} states the claims of {given.registration}")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())

"""Register the claims of the headline before the recordings exist that decide them.

    python -m experiments.gaps.registration write registration.json
    python -m experiments.gaps.registration check registration.json [outputs/tables/headline.csv]

The first command writes the claims of the headline that this testbed can decide, the draws that will decide them, the date, and a hash of
all this. It needs no results, and never replaces a file. The headline reads these draws with profile=paper
profile.campaign.first_draw=100. The second command refuses a file whose hash does not match. It says which claims of a table differ from
the registered ones, and which rest on other draws or settings. The exit status is 2 if a file is refused, and 1 if a claim differs.
"""

import argparse
import csv
import datetime
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.gaps.headline import DRIVES, HEADLINES, REGISTERED
from experiments.verdicts import NOT_HERE, PRIMARY
from radartwin.errors import InputError
from radartwin.io import files
from radartwin.store.digest import spec_digest

TEXT = "claim of the paper"
FIXED = ("table", "metric", "bound", "direction", "null", "margin", "test", "unit")  # what a table states as it is registered
CHANCE = "chance"  # bound that follows from the classes
RULE = "Holm over the claims of the family, at 0.95"


def claims() -> list[dict[str, Any]]:
    """Return the claims of the headline that this testbed can decide, as they are registered."""
    out = []
    for headline in HEADLINES:
        claim, (test, unit) = headline.claim, headline.test
        if claim.untestable or headline.unless:
            continue
        bound = CHANCE if claim.bound is None and claim.null is None else claim.null if claim.bound is None else claim.bound
        null = bound if claim.null is None else claim.null
        drawn = REGISTERED[headline.table in DRIVES]
        rule = {"bound": bound, "direction": claim.direction, "null": null, "margin": claim.margin, "test": test, "unit": unit}
        at = {"table": headline.table, "metric": headline.metric, "where": dict(headline.where), "draws": [drawn[0], drawn[-1]]}
        out.append({TEXT: headline.text, **at, **rule, "family": PRIMARY, "level": RULE})
    return out


def registration(registered: Sequence[Mapping[str, Any]], date: str) -> dict[str, Any]:
    """Return the content of a registration, with its hash. Raises InputError for a claim without a test, unit, bound or direction."""
    for claim in registered:
        for name in ("test", "direction", "bound", "unit"):
            if claim.get(name) in (None, ""):
                raise InputError(f"registration: the claim {claim.get(TEXT)!r} has no {name}; state it in experiments/gaps/headline.py")
    content = {"date": date, "claims": list(registered)}
    return {**content, "sha256": spec_digest(content)}


def read(path: Path) -> list[dict[str, Any]]:
    """Read the claims of a registration. Raises InputError if it is no registration, was changed after its date, or lacks a test."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        digest, registered, date = content.pop("sha256"), content["claims"], content["date"]
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is no registration ({error!r})") from error
    if digest != spec_digest(content):
        raise InputError(f"{path}: the hash does not match, so the registration was changed after {date}; take the committed file")
    return registration(registered, date)["claims"]


def differences(registered: Sequence[Mapping[str, Any]], table: Path) -> list[str]:
    """Return a line for each registered claim that a headline table lacks, states otherwise, or judges on other draws, and for each claim
    of the table that is not registered. Raises InputError for another table.
    """
    known = {claim[TEXT]: claim for claim in registered}
    try:
        with table.open(encoding="utf-8", newline="") as stream:
            rows = {row[TEXT]: row for row in csv.DictReader(stream) if row["verdict"] != NOT_HERE}
    except (OSError, KeyError, UnicodeDecodeError) as error:
        raise InputError(f"{table} is no table of the headline ({error!r}); write it with radartwin tables --only headline") from error
    lines = [f"{text!r} is {'not registered' if text in rows else 'missing'}" for text in sorted(known.keys() ^ rows.keys())]
    for text, claim in known.items():
        if text in rows:
            stated = [(name, rows[text].get(name, ""), claim[name]) for name in FIXED]
            lines += [f"{text!r}: {name} {cell!r}, registered {value!r}" for name, cell, value in stated if not _equal(cell, value)]
            drawn = rows[text].get("evidence", "")
            if not drawn.endswith(", registered"):
                lines.append(f"{text!r}: {drawn or 'unknown draws'}, registered draws {claim['draws'][0]} to {claim['draws'][1]}")
    return lines


def _equal(cell: str, value: Any) -> bool:
    if value == CHANCE:  # it follows from the classes of the campaign
        return cell != ""
    if not isinstance(value, float):
        return cell == (value or "")
    try:
        return math.isclose(float(cell), value)
    except ValueError:
        return False


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check a registration. Returns the exit status."""
    parser = argparse.ArgumentParser(description="Register the claims of the headline, or check a table against the registered claims.")
    parser.add_argument("verb", choices=("write", "check"))
    parser.add_argument("registration", type=Path)
    parser.add_argument("table", type=Path, nargs="?", default=Path("docs/results/headline.csv"))
    given = parser.parse_args(arguments)
    try:
        if given.verb == "write":
            if given.registration.exists():
                raise InputError(f"{given.registration} exists, and a registration is never replaced; name a new file")
            content = registration(claims(), datetime.datetime.now(datetime.UTC).date().isoformat())
            files.write_atomically(given.registration, json.dumps(content, indent=1) + "\n")
            print(f"{given.registration}: {len(content['claims'])} claims, sha256 {content['sha256']}")
            return 0
        lines = differences(read(given.registration), given.table)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print("\n".join(lines) or f"{given.table} states the claims of {given.registration}")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())

"""Judge the rows of written tables anew, each from its own columns: `python -m analysis.judge [FOLDER]`.

The command prints the number of rows with each verdict, and each row whose verdict does not follow from its columns, or whose value or
interval lies outside the limits `lowest` and `highest` of the quantity (exit status 1).
Rows of engineering tables whose limit is a column of its own, or compares rows, are counted apart.
"""

import argparse
import csv
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from analysis.pages.template import RESULTS
from experiments.verdicts import SUPPORTED, judge, limit_kept
from radartwin.runs.experiment import LIMITS, VERDICTS

NUMBERS = ("value", "low", "high", "bound", "null", "margin")


def judged(row: Mapping[str, str]) -> str | None:
    """Return the verdict that follows from the cells of a row; None if the row has a limit without the columns of a claim."""
    if not row.get("direction"):
        return _by_limit(row)
    number = {name: float(row[name]) if row[name] else None for name in NUMBERS}
    word = judge(**number, direction=row["direction"], reason=row.get("reason", ""))
    return limit_kept(word == SUPPORTED) if row["verdict"] in LIMITS else word


def _by_limit(row: Mapping[str, str]) -> str | None:
    """Return the verdict on the limit of a row, such as "1.5", ">= 0.9" or "low <= 1", which the named end of the interval must keep."""
    if row["verdict"] not in LIMITS:
        return ""
    sign, _, limit = (row.get("limit") or "").rpartition(" ")
    if not limit:
        return None
    if sign == ">=":
        return limit_kept(float(row["low"]) >= float(limit))
    return limit_kept(float(row["low" if sign.startswith("low") else "high"] or row["value"]) <= float(limit))


def beyond_limits(row: Mapping[str, str]) -> bool:
    """Return whether the value or an end of the interval lies outside the limits of the quantity."""
    low, high = row.get("lowest") or "-inf", row.get("highest") or "inf"
    return any(not float(low) <= float(row[name]) <= float(high) for name in ("value", "low", "high") if row[name])


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge the tables of a folder. Returns the exit status."""
    parser = argparse.ArgumentParser(description="Judge the rows of written tables anew, each from its own columns.")
    parser.add_argument("folder", nargs="?", type=Path, default=RESULTS)
    counts, status = Counter[str](), 0
    files = sorted((folder := parser.parse_args(arguments).folder).glob("*.csv"))
    if not files:
        print(f"{folder} holds no table; name a folder with CSV files", file=sys.stderr)
        return 2
    for file in files:
        with file.open(encoding="utf-8", newline="") as stream:
            for line, row in enumerate(csv.DictReader(stream), 2):
                word = judged(row)
                counts["limits of other columns" if word is None else word] += 1
                if word not in (None, row["verdict"]):
                    print(f"{file}:{line}: the verdict is {row['verdict']!r}, but its columns say {word!r}")
                    status = 1
                if row.get("direction") and beyond_limits(row):
                    print(f"{file}:{line}: value or interval lies outside the limits {row['lowest'] or '-'} to {row['highest'] or '-'}")
                    status = 1
    told = [f"{counts[word]} {word}" for word in (*VERDICTS, *LIMITS, "limits of other columns")]
    print(*told, f"{counts['']} without a claim", sep=", ")
    return status


if __name__ == "__main__":
    sys.exit(main())

"""Check the numbers of a text against the committed tables: `python -m analysis.numbers docs/findings.md README.md`.

A section names its tables in backticks. A number of the section, also before a per cent sign, must round like a cell of one of these
tables. The command prints the others; its exit status is 1 if one is in a table or an interval of the text. Code, links and headings are
left out.
"""

import argparse
import csv
import re
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from analysis.pages.template import RESULTS
from radartwin.io.one_line import one_line

NUMBER = re.compile(r"(?<![\w./-])([-+]?\d{1,3}(?:,\d{3})+|[-+]?\d+(?:\.\d+)?)(?![\w-]|\.\d)(\s?%)?")
INTERVAL = re.compile(r"[(\[]\s*[-+]?[\d.]+ ?(?:to|,) ?[-+]?[\d.]+\s*[)\]]")
LEFT_OUT = re.compile(r"`[^`]*`|\]\([^)]*\)|https?://\S+|\d{4}-\d{2}-\d{2}")


class Number(NamedTuple):
    """A number of a text: its line number, its text, the line, and whether it must come from a table."""

    line: int
    text: str
    context: str
    strict: bool


def tables(folder: Path = RESULTS) -> dict[str, set[float]]:
    """Return all numbers of each committed table, those of the registered draws and of the headline of version 1.0 included."""
    known = defaultdict(set)
    for file in (file for part in ("*", "registered/*", "version_1.0/judged_anew") for file in folder.glob(f"{part}.csv")):
        with file.open(encoding="utf-8", newline="") as stream:
            known[file.stem] |= {value for row in csv.reader(stream) for cell in row for value in _values(cell)}
    return known


def missing(text: str, known: dict[str, set[float]]) -> list[Number]:
    """Return the numbers of a text that no table of their section holds."""
    numbers = []
    for first, section in _sections(text):
        values = set().union(*(known.get(name, ()) for name in re.findall(r"`([a-z_]+)`", "\n".join(section))))
        for at, line in enumerate(section, first):
            bare = LEFT_OUT.sub(lambda match: " " * len(match.group()), line)
            intervals = [match.span() for match in INTERVAL.finditer(bare)]
            for match in NUMBER.finditer(bare):
                wanted, scales = float(match.group(1).replace(",", "")), (1, 100) if match.group(2) else (1,)
                half = 0.501 * 10.0 ** -len(match.group(1).partition(".")[2])
                if not any(abs(value * scale - wanted) <= half for value in values for scale in scales):
                    strict = line.startswith("|") or any(low <= match.start() < high for low, high in intervals)
                    numbers.append(Number(at, match.group().strip(), line.strip(), strict))
    return numbers


def _values(cell: str) -> list[float]:
    """Return the numbers of a cell, which may be one number, a range such as 0.3-2.5, or words."""
    try:
        return [float(cell)]
    except ValueError:
        return [float(text.replace(",", "")) for text, _ in NUMBER.findall(re.sub(r"(?<=\d)-(?=\d)", " ", cell))]


def _sections(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the first line and the lines of each section. Headings and code are empty lines."""
    lines, first, code = [], 1, False
    for at, line in enumerate(text.splitlines(), 1):
        if line.startswith("```"):
            code = not code
        if line.startswith("#") and not code:
            yield first, lines
            lines, first = [], at
        lines.append("" if code or line.startswith(("#", "```")) else line)
    yield first, lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the numbers of the given texts that their tables do not hold. Returns the exit status."""
    parser = argparse.ArgumentParser(description="Check the numbers of texts against docs/results.")
    parser.add_argument("texts", nargs="+", type=Path)
    known, status = tables(), 0
    for path in parser.parse_args(arguments).texts:
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            print(f"{path}: {one_line(error)}; name a text file", file=sys.stderr)
            return 2
        for number in missing(text, known):
            status = status or int(number.strict)
            how = "is in no table of its section" if number.strict else "not checked"
            print(f"{path}:{number.line}: {number.text} {how}: {number.context}")
    return status


if __name__ == "__main__":
    sys.exit(main())

"""The history of benchmarks: one CSV with a line of commit, machine and ratios per run.

Seconds depend on the machine, but ratios within one run can be compared between machines and commits. The cell of a ratio that a run did
not measure is empty. A new ratio adds a column at the end.
"""

import csv
import io
import time
from collections.abc import Mapping
from pathlib import Path

from radartwin.io import files
from radartwin.runs import checkout

HISTORY = Path(__file__).with_name("bench_history.csv")
FIXED = ("date", "commit", "changed", "processor", "cores", "load", "python", "repeats", "variant")


def append(machine: Mapping[str, object], ratios: Mapping[str, float], history: Path = HISTORY) -> Path:
    """Add a line to the history and return the path of the file.

    Args:
        machine: values of the columns processor, cores, load (of other programs at the start), python, repeats and variant.
        ratios: measured ratios by name.
        history: the file, created if absent and replaced as a whole.
    """
    head, changed = checkout.commit()
    line = {"date": time.strftime("%Y-%m-%d"), "commit": head[:12], "changed": "yes" if changed else "no", **machine}
    line |= {name: f"{value:.4g}" for name, value in ratios.items()}
    lines = [*read(history), {name: str(value) for name, value in line.items()}]
    columns = [*FIXED, *dict.fromkeys(name for one in lines for name in one if name not in FIXED)]
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return files.write_atomically(history, text.getvalue())


def read(history: Path = HISTORY) -> list[dict[str, str]]:
    """Return the lines of the history, oldest first; an empty list if the file does not exist."""
    if not history.is_file():
        return []
    with history.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))

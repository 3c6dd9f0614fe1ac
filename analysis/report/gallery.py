"""Write one page for each gallery figure that compares a measured picture with a simulated picture.

The page has two sliders. The first slider moves the divider between the two pictures. The second slider selects the range at which the page
plots a cut through both pictures. The page reads the values from the HTML page of the figure (radartwin/plotting/pages.py).
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.report.content import Section
from analysis.report.folder import Stage
from radartwin.errors import MissingError
from radartwin.plotting.style import SEQUENTIAL

TABLE = "gallery"
PAGE = Path(__file__).with_name("page") / "compare.html"
_DATA = re.compile(r"^const data = (\{.*\});$", re.MULTILINE)


@dataclass(frozen=True)
class Compared:
    """A gallery figure that has a comparison page: the figure's name, and the page's link relative to the parts folder."""

    figure: str
    page: str


def write(sections: Sequence[Section], staged: Stage) -> list[Compared]:
    """Write a comparison page for each gallery figure that shows two pictures of equal axis ranges, one picture above the other.

    Raises MissingError if the HTML page of a figure is missing or damaged.
    """
    compared = []
    for section in sections:
        for name in section.figures if section.table.name == TABLE and not section.absent else ():
            panels = pairs(drawn(section.figure(name, ".html"), section.command))
            if panels:
                staged.path(f"gallery/{name}.html").write_text(page(name, panels), encoding="utf-8")
                compared.append(Compared(name, f"gallery/{name}.html"))
    return compared


def drawn(path: Path, command: str) -> dict[str, Any]:
    """Read the plotted data from the HTML page of a figure. `command` is the command that draws the figure again."""
    found = _DATA.search(path.read_text(encoding="utf-8", errors="replace"))
    try:
        data = json.loads(found[1]) if found else None
    except ValueError:
        data = None
    if not isinstance(data, dict) or "axes" not in data:
        raise MissingError(f"{path} is damaged; run {command} again")
    return data


def pairs(data: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the picture panels of the upper row that have a panel of equal axis ranges below.

    Each entry of the returned list holds the panel's title, label, axis ranges and marks, and the values of both panels.
    """
    pictured = [axes for axes in data["axes"] if len(axes["pictures"]) == 1]
    half, found = len(pictured) // 2, []
    for upper, lower in zip(pictured[:half], pictured[half:], strict=False):
        extent, values = upper["pictures"][0]["extent"], [one["pictures"][0]["values"] for one in (upper, lower)]
        if not np.allclose(extent, lower["pictures"][0]["extent"], rtol=1e-6) or np.shape(values[0]) != np.shape(values[1]):
            continue
        marks = [[series["points"] for series in one["series"]] for one in (upper, lower)]
        found.append({"title": upper["title"], "x": lower["x"]["label"], "extent": extent, "values": values, "marks": marks})
    return found


def page(name: str, panels: Sequence[dict[str, Any]]) -> str:
    """Return the HTML of the comparison page of one figure. The values in the page are in decibels."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    ramp = [to_hex(colour) for colour in colormaps[SEQUENTIAL](range(256))]
    data = json.dumps({"panels": panels, "ramp": ramp}, allow_nan=False).replace("<", "\\u003c")
    title = html.escape(f"{name.replace('_', ' ').removeprefix('gallery ')}: measured and simulated")
    return PAGE.read_text(encoding="utf-8").replace("/*TITLE*/", title).replace("/*DATA*/", data)

"""The report: one folder that opens without network, OUTPUT/report/index.html.

content   what is told of each table: rows, claims, figures, or why there is none
origin    where it comes from: versions, machine, seeds, cost, MLflow runs
gallery   pages that compare a measured picture with a simulated one
rooms     the rooms in three dimensions
markup    the page as text; everything that enters it is escaped there
folder    the files of the page, whole or not at all
page/     template, style and scripts
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from analysis.report import folder, gallery, markup, origin, rooms
from analysis.report.content import FAILED, MISSING, STALE, Section

__all__ = ["FAILED", "MISSING", "STALE", "Section", "write"]


def write(sections: Sequence[Section], output: Path) -> Path:
    """Write OUTPUT/report from what the output folder holds; the path of its index.html.

    The folder can be moved by itself. The same content gives the same bytes, and what an earlier report left is gone.

    Raises:
        MissingError: a file of a table is missing or damaged.
        OutputError: the folder cannot be written.
    """
    with folder.staged(output / "report") as staged:
        for section in sections:
            for part, path in section.files():
                staged.take(path, part)
        compared, shown = gallery.write(sections, staged), rooms.write(staged)
        come_from = origin.of(sections, output)
        return staged.publish(lambda parts: markup.page(sections, compared, shown, come_from, parts))

"""Write the report, OUTPUT/report/index.html, in one folder that a browser opens without network.

content   rows, claims and figures of each table, or the reason why the table is absent
origin    versions, machine, seeds, run times and MLflow runs behind the report
gallery   pages that compare a measured picture with a simulated one
rooms     pages of the rooms in three dimensions
claims    the summary of all claims
markup    the page as text; it escapes everything that enters the page
folder    the files of the page, written so that a reader never sees an incomplete report
page/     template, style and scripts
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from analysis.report import folder, gallery, markup, origin, rooms
from analysis.report.content import FAILED, MISSING, STALE, Section

__all__ = ["FAILED", "MISSING", "STALE", "Section", "path", "write"]


def path(output: Path) -> Path:
    """Return the path of the report's first page."""
    return output / "report" / folder.INDEX


def write(sections: Sequence[Section], output: Path) -> Path:
    """Write OUTPUT/report from the tables and figures of the output folder, and return the path of its index.html.

    The report folder can be moved elsewhere. The same content gives the same bytes. Files of an earlier report are removed.

    Raises:
        MissingError: a file of a table is missing or damaged.
        OutputError: the folder cannot be written.
    """
    with folder.staged(output / "report") as staged:
        for section in sections:
            for part, file in section.files():
                staged.take(file, part)
        compared, shown = gallery.write(sections, staged), rooms.write(staged)
        made_from = origin.of(sections, output)
        return staged.publish(lambda parts: markup.page(sections, compared, shown, made_from, parts))

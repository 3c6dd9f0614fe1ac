"""Write the report, OUTPUT/report/index.html. A browser can open the report from this folder without an internet connection.

- `content` reads rows, claims and figures of each table, or the reason why a table is absent.
- `origin` reads the versions, machine, seeds, run times and MLflow runs behind the report.
- `rooms` writes pages that show the rooms in three dimensions.
- `markup` fills the template of the report page, which escapes all text that enters the page.
- `folder` writes the files so that a browser never loads an incomplete report.
- `page/` holds the HTML template, the style sheet and the scripts.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from analysis.report import markup, origin, publish, room_pages
from analysis.report.content import FAILED, MISSING, STALE, Section

__all__ = ["FAILED", "MISSING", "STALE", "Section", "path", "write"]


def path(output: Path) -> Path:
    """Return the path of the report's first page, index.html, in the output folder."""
    return output / "report" / publish.INDEX


def write(sections: Sequence[Section], output: Path) -> Path:
    """Write OUTPUT/report from the tables and figures of the output folder, and return the path of its index.html.

    The report folder can be moved elsewhere. Reports of the same tables and figures are equal byte by byte. Files of an earlier report in
    the folder are removed.

    Raises:
        MissingError: a file of a table is missing or damaged.
        OutputError: the folder cannot be written.
    """
    with publish.staged(output / "report") as staged:
        for section in sections:
            for part, file in section.files():
                staged.take(file, part)
        pages = room_pages.write(staged)
        made_from = origin.of(sections, output)
        return staged.publish(lambda parts: markup.page(sections, pages, made_from, parts))

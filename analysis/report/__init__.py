"""Write the report, OUTPUT/report/index.html, which a browser can open without an internet connection.

`content` reads the tables, `origin` their runs, `room_pages` draws the rooms, and `markup` fills the template in `page`, which escapes all
text that enters the page.
"""

from collections.abc import Sequence
from pathlib import Path

from analysis.report import markup, origin, room_pages
from analysis.report.content import FAILED, LEFT_OUT, MISSING, STALE, Section
from radartwin.io import files

__all__ = ["FAILED", "LEFT_OUT", "MISSING", "STALE", "Section", "path", "write"]
PARTS = ("figures", "tables", "rooms")  # subfolders of the report


def path(output: Path) -> Path:
    """Return the path of the report's first page, index.html, in the output folder."""
    return output / "report" / "index.html"


def write(sections: Sequence[Section], output: Path) -> Path:
    """Write OUTPUT/report from the tables and figures of the output folder, and return the path of its index.html.

    Reports of the same tables and figures are equal byte by byte. The page is written after the files that it links to, and files of an
    earlier report are removed last. Raises MissingError if a file of a table is missing or damaged, and OutputError.
    """
    root = path(output).parent
    content: dict[str, Path | bytes] = {f"{part}/{file.name}": file for section in sections for part, file in section.files()}
    rooms = room_pages.drawn()
    content |= {room.page: room.html for room in rooms} | {room.picture: room.jpeg for room in rooms}
    text = markup.page(sections, rooms, origin.of(sections, output))
    for part in PARTS:
        files.make_folder(root / part)
        files.sweep(root / part)
    for link, source in content.items():
        data = source.read_bytes() if isinstance(source, Path) else source
        if not (root / link).is_file() or (root / link).read_bytes() != data:
            files.write_atomically(root / link, data)
    page = files.write_atomically(path(output), text)
    for part in PARTS:
        for file in (root / part).iterdir():
            if f"{part}/{file.name}" not in content:
                file.unlink()
    return page

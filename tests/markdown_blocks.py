"""Read the code blocks and the commands of a Markdown page, and run them."""

from __future__ import annotations

import importlib
import re
import shlex
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"


@dataclass(frozen=True)
class Block:
    """A code block of a Markdown page. `language` is "" for a plain block; `file` is the file name in the comment of the block's first
    line.
    """

    language: str
    text: str

    @property
    def file(self) -> str | None:
        named = re.match(r"(?:# @package \w+\n)?# ([\w/]+\.\w+)\n", self.text)
        return named and named[1]


def blocks(page: Path) -> list[Block]:
    """Return the fenced and the indented code blocks in the order of the page."""
    out: list[Block] = []
    lines: list[str] = []
    fence: str | None = None
    for line in [*page.read_text().splitlines(), ""]:
        if line.startswith("```"):
            if fence is None:
                fence, lines = line[3:], []
            else:
                out, fence, lines = [*out, Block(fence, "\n".join(lines) + "\n")], None, []
        elif fence is not None:
            lines.append(line)
        elif line.startswith("    "):
            lines.append(line[4:])
        elif lines:
            out, lines = [*out, Block("", "\n".join(lines) + "\n")], []
    return out


def commands(page: Path) -> list[str]:
    """Return the commands of the plain code blocks, with continuation lines joined and comments removed."""
    return [line for block in blocks(page) if not block.language for line in lines_of(block)]


def lines_of(block: Block) -> list[str]:
    lines = (re.sub(r"\s+#.*", "", line) for line in re.sub(r"\\\n\s*", "", block.text).splitlines())
    return [line for line in lines if line.startswith("radartwin ")]


def prose(page: Path) -> str:
    """Return the text of the page without its fenced code blocks."""
    return re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)


def quoted(page: Path) -> list[str]:
    """Return the pieces of inline code (text between backquotes) of the page, without its fenced code blocks."""
    return re.findall(r"`([^`\n]+)`", prose(page))


def follow(page: Iterable[Block], folder: Path, words: Callable[[list[str]], list[str] | None]) -> int:
    """Run the code blocks of a page from top to bottom, with its commands in this process. Returns the number of commands.

    Args:
        words: function that converts the arguments of a printed command to the arguments that are run, or returns None to skip the command.
    """
    from radartwin.cli import main

    count = 0
    for block in page:
        if block.file:
            (folder / block.file).parent.mkdir(parents=True, exist_ok=True)
            (folder / block.file).write_text(block.text)
            importlib.invalidate_caches()
        elif block.language == "python":
            exec(compile(block.text, "example", "exec"), {"__name__": "__main__"})
        for line in lines_of(block) if not block.language else ():
            given = words(shlex.split(line)[1:])
            if given is not None:
                assert main(given) == 0, line
                count += 1
    return count

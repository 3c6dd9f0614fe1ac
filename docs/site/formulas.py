"""Draw the formulas of Markdown pages as SVG pictures with Matplotlib, so that the documentation site needs no script and no network.

Inline formulas stand between dollar signs, displayed formulas in fenced blocks of the language `math`, as on GitHub.
"""

from __future__ import annotations

import hashlib
import html
import io
import re
from pathlib import Path

CODE = re.compile(r"^(?P<fence>```+|~~~+).*?^(?P=fence)[ \t]*$|`[^`\n]+`", re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r"^```math\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"(?<![\\$])\$(?=\S)([^$\n]+(?:\n[^$\n]+)?)(?<=\S)\$(?!\$)")
SIZE_PT = 11.0
POINTS_PER_EM = 9.5  # points of a formula of SIZE_PT per em of the text, so that the letters of both are equally large
# Matplotlib knows no \lvert, and needs braces where LaTeX takes one letter or digit.
SPELLING = (
    (re.compile(r"\\[lr]vert\b"), "|"),
    (re.compile(r"\\frac\s*(\w)"), r"\\frac{\1}"),
    (re.compile(r"(\\frac\{[^{}]*\})\s*(\w)"), r"\1{\2}"),
    (re.compile(r"\\(mathbf|mathrm|text|hat|sqrt)\s*(\\[a-zA-Z]+|[a-zA-Z])(?![a-zA-Z{])"), r"\\\1{\2}"),
    (re.compile(r"\\text\b"), r"\\mathrm"),
)


def with_pictures(text: str, folder: Path, address: str) -> str:
    """Replace the formulas of a Markdown page by pictures, and return the text of the page.

    Args:
        text: Markdown; formulas in code are left as they are.
        folder: folder to which the pictures are written.
        address: address of this folder relative to the page.
    Raises:
        ValueError: Matplotlib cannot draw a formula. The message holds the formula.
    """
    text = BLOCK.sub(lambda match: f'\n<p class="formula">{_terms(match[1], folder, address)}</p>\n', text)
    out, start = [], 0
    for code in CODE.finditer(text):
        out += [_inline(text[start : code.start()], folder, address), code[0]]
        start = code.end()
    return "".join([*out, _inline(text[start:], folder, address)])


def _inline(text: str, folder: Path, address: str) -> str:
    return INLINE.sub(lambda match: _picture(match[1], folder, address), text)


def _terms(tex: str, folder: Path, address: str) -> str:
    """Return one picture for each equation of a displayed formula, so that a narrow window breaks the line between two equations."""
    return " ".join(_picture(term, folder, address) for term in re.split(r",\s*\\qquad", tex))


def _picture(tex: str, folder: Path, address: str) -> str:
    tex = " ".join(tex.split())
    name = hashlib.sha256(tex.encode()).hexdigest()[:16] + ".svg"
    drawn, depth_pt, height_pt = draw(tex)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(drawn)
    style = f"height:{height_pt / POINTS_PER_EM:.3f}em;vertical-align:{-depth_pt / POINTS_PER_EM:.3f}em"
    return f'<img class="tex" alt="{html.escape(tex).replace("|", "&#124;")}" src="{address}/{name}" style="{style}">'


def draw(tex: str) -> tuple[bytes, float, float]:
    """Return the SVG picture of a LaTeX formula, its depth below the baseline and its whole height, both in points.

    Raises:
        ValueError: Matplotlib cannot draw the formula.
    """
    import matplotlib
    from matplotlib.font_manager import FontProperties
    from matplotlib.mathtext import math_to_image

    spelled = tex
    for pattern, new in SPELLING:
        spelled = pattern.sub(new, spelled)
    stream = io.BytesIO()
    with matplotlib.rc_context({"mathtext.fontset": "stix", "svg.hashsalt": "radartwin", "savefig.transparent": True}):
        try:
            depth = math_to_image(f"${spelled}$", stream, prop=FontProperties(size=SIZE_PT), dpi=72, format="svg")
        except ValueError as error:
            raise ValueError(f"the formula {tex!r} cannot be drawn: {' '.join(str(error).split())}") from error
    drawn = stream.getvalue().decode()
    drawn = re.sub(r"<metadata>.*?</metadata>", "", drawn, flags=re.DOTALL)
    size = re.search(r'height="([\d.]+)pt"', drawn)
    assert size is not None
    return drawn.encode(), float(depth), float(size[1])

"""Define the style of every figure: print sizes in inches, and the Okabe-Ito palette for colour-blind readers.

Ref: M. Okabe, K. Ito, Color Universal Design (2008), https://jfly.uni-koeln.de/color/. The figures need no display and no pyplot.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radartwin.io import files

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442", "#000000")
COLUMN_WIDTH_IN, PAGE_WIDTH_IN = 3.33, 7.0  # acmart sigconf, one and two columns
TEXT_PT = 7  # size of every text of a figure
SEQUENTIAL = "viridis"
SUFFIXES = (".png", ".pdf")


def style() -> dict[Any, Any]:
    """Return the Matplotlib settings of the project's figures, as an argument of `matplotlib.rc_context`."""
    from cycler import cycler

    return {
        "axes.prop_cycle": cycler(color=PALETTE),
        "axes.spines.right": False,
        "axes.spines.top": False,
        "axes.titlesize": TEXT_PT,
        "axes.labelsize": TEXT_PT,
        "figure.constrained_layout.use": True,
        "figure.dpi": 100,
        "figure.titlesize": TEXT_PT,
        "font.size": TEXT_PT,
        "image.cmap": SEQUENTIAL,
        "legend.fontsize": TEXT_PT,
        "legend.frameon": False,
        "lines.linewidth": 1.2,
        "pdf.fonttype": 42,
        "savefig.dpi": 200,
        "svg.fonttype": "none",
        "svg.hashsalt": "radartwin",
        "xtick.labelsize": TEXT_PT,
        "ytick.labelsize": TEXT_PT,
    }


def figure(
    rows: int = 1, columns: int = 1, *, width_in: float = PAGE_WIDTH_IN, height_in: float = 2.6, **subplots: Any
) -> tuple[Figure, Any]:
    """Create a figure in the project's style. Returns figure and axes like `plt.subplots`, but does not register the figure in pyplot."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(style()):
        drawing = Figure(figsize=(width_in, height_in))
        return drawing, drawing.subplots(rows, columns, **subplots)


def pixel_edges(axis: Sequence[float] | NDArray) -> tuple[float, float]:
    """Return the outer edges of the first and of the last picture pixel along an evenly spaced axis (N,) of pixel centres.

    >>> pixel_edges([0.0, 1.0, 2.0])
    (-0.5, 2.5)
    """
    half = (axis[1] - axis[0]) / 2 if len(axis) > 1 else 0.5
    return float(axis[0] - half), float(axis[-1] + half)


def fewer_colours(png: bytes, colours: int) -> bytes:
    """Return a PNG file with at most this number of colours, which needs a third to a quarter of the bytes."""
    from PIL import Image

    stream = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").quantize(colours, kmeans=3, dither=Image.Dither.NONE).save(stream, "PNG", optimize=True)
    return stream.getvalue()


def save(drawing: Callable[[], Figure] | Figure | Path, stem: Path) -> list[Path]:
    """Write a figure, what draws it, or copies of existing figure files, as `stem`.png and .pdf, and return the two paths."""
    import matplotlib

    paths = [stem.with_name(stem.name + suffix) for suffix in SUFFIXES]
    if isinstance(drawing, Path):
        for path in paths:
            files.write_atomically(path, drawing.with_name(drawing.name + path.suffix).read_bytes())
        return paths
    with matplotlib.rc_context(style()):
        drawn = drawing() if callable(drawing) else drawing
        for path in paths:
            # Without its creation date, the PDF of the same figure has the same bytes.
            stream = io.BytesIO()
            drawn.savefig(stream, format=path.suffix[1:], metadata={"CreationDate": None} if path.suffix == ".pdf" else None)
            files.write_atomically(path, stream.getvalue())
            drawn.set_layout_engine("none")  # reuse the layout for the PDF, because computing it takes as long as drawing
    return paths

"""The API reference, made from the docstrings: `make docs` writes build/docs/index.html.

pdoc reads the library as Python does and follows Google's form of docstrings. Every warning is an error, so a signature that cannot be
resolved is found here and not by a reader.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

OUT = Path(__file__).resolve().parents[1] / "build" / "docs"
# The public API first, then what it is made of. The command line and the runner are described by their help.
MODULES = (
    "radartwin",
    "radartwin.materials",
    "radartwin.scene",
    "radartwin.reconstruct",
    "radartwin.label",
    "radartwin.simulation",
    "radartwin.radar",
    "radartwin.recordings",
    "radartwin.testbed",
    "radartwin.features",
    "radartwin.adaptive",
    "radartwin.recognize",
    "radartwin.config",
    "radartwin.runs.experiment",
    "radartwin.store.products",
    "radartwin.errors",
    "!radartwin.simulation.backends.sionna_material",  # sets a Mitsuba variant of its own when it is imported
)
# pdoc looks for a NamedTuple's annotations in a namespace that lacks its module's imports, and prints them as they are written.
NAMED_TUPLES = (
    r"Error parsing type annotation .* for radartwin\.scene\.(objects\.catalogue\.Part|rooms\.parts\.Finish|textures\.Look)\.__init__\."
)


def build(out: Path, modules: tuple[str, ...] = MODULES) -> Path:
    """Write the pages of the modules and those below them; returns the first page.

    Raises:
        Warning: whatever Python or pdoc would have warned of.
    """
    import pdoc
    import pdoc.render

    pdoc.render.configure(docformat="google", show_source=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=NAMED_TUPLES)
        pdoc.pdoc(*modules, output_directory=out)
    return out / "index.html"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write the API reference.")
    parser.add_argument("--out", type=Path, default=OUT, help="folder (default: build/docs)")
    print(build(parser.parse_args().out))

"""Build the documentation site: `make docs` writes build/docs/index.html.

The site holds the pages of docs/, the README, the executed tutorial and the reference from the docstrings. The script copies all pages into
build/pages and adds the parts that MkDocs does not make: the outputs of the tutorial, the pictures of the formulas (formulas.py), and one
page per module. MkDocs then writes the HTML files. The HTML files need no server and no network. Every warning of MkDocs counts as an
error.
"""

from __future__ import annotations

import argparse
import logging
import os
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).resolve().parent
DOCS, ROOT = HERE.parent, HERE.parents[1]
PAGES, OUT = ROOT / "build" / "pages", ROOT / "build" / "docs"
sys.path.insert(0, str(HERE))
import formulas  # noqa: E402  # without this path, the script does not find the modules beside it

# The public API first, then the packages from which it is built. `radartwin --help` describes the command line.
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
    "radartwin.live",
    "radartwin.benchmark",
    "radartwin.plugins",
    "radartwin.config",
    "radartwin.runs.experiment",
    "radartwin.store.products",
    "radartwin.errors",
)
LINK = re.compile(r"(?<=\]\()([^)#\s]+)(?=[)#])")
NETWORK_WORKER, WORKER = "https://unpkg.com/iframe-worker/shim", "worker.js"
EXECUTION_S = 600  # longest time of one cell of the tutorial


def build(out: Path = OUT, pages: Path = PAGES, modules: tuple[str, ...] = MODULES, execute: bool = True) -> Path:
    """Build the site and return its first page.

    Args:
        out: folder of the site; the content of an earlier site is deleted.
        pages: folder of the Markdown pages from which MkDocs builds the site; its old content is deleted.
        modules: modules of the reference. A package includes the modules below it.
        execute: whether the tutorial is executed; otherwise it has no outputs.
    Raises:
        ValueError: `out` holds files other than a site, a link leads to no file, or a formula cannot be drawn.
        mkdocs.exceptions.Abort: MkDocs warned, for example of a missing anchor or of an object without docstring.
    """
    from mkdocs.commands.build import build as build_site
    from mkdocs.config import load_config

    out = check_out(out)
    write_pages(pages, modules, execute)
    config = load_config(str(HERE / "mkdocs.yml"), docs_dir=str(pages), site_dir=str(out), strict=True)
    assert config.nav is not None
    for section in ("decisions", "reference"):
        page_names = sorted(path.name for path in (pages / section).glob("*.md") if path.name != "index.md")
        names = [f"{module}.md" for module in modules] if section == "reference" else page_names
        config.nav.append({section.capitalize(): [f"{section}/{name}" for name in ("index.md", *names)]})
    config.plugins.on_startup(command="build", dirty=False)
    try:
        build_site(config)
    finally:
        config.plugins.on_shutdown()
    _use_own_worker(out)
    return out / "index.html"


def check_out(out: Path) -> Path:
    """Return the absolute path of the folder of the site. MkDocs deletes the content of this folder.

    Raises:
        ValueError: the path is a file, or a folder that is neither empty nor an earlier site nor build/docs.
    """
    out = out.resolve()
    if out.exists() and not out.is_dir():
        raise ValueError(f"{out} is a file; give a new or empty folder to --out")
    earlier = (out / "index.html").is_file() and (out / "search").is_dir()
    if out != OUT and out.is_dir() and any(out.iterdir()) and not earlier:
        raise ValueError(f"{out} holds files and no earlier site, and the build would delete them; give a new or empty folder to --out")
    return out


def write_pages(pages: Path, modules: tuple[str, ...] = MODULES, execute: bool = True) -> None:
    """Write the Markdown pages of the site. The arguments are those of `build`."""
    shutil.rmtree(pages, ignore_errors=True)
    placed = {source: pages / target for source, target in _places()}
    for source, target in placed.items():
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.suffix == ".ipynb":
            text = _notebook(source, target, execute)
        elif source.suffix == ".md":
            text = source.read_text(encoding="utf-8")
        else:
            shutil.copyfile(source, target)
            continue
        text = LINK.sub(lambda match, source=source: _link(match[1], source, placed), text)
        up = "../" * (len(target.relative_to(pages).parts) - 1)
        target.write_text(formulas.with_pictures(text, pages / "formulas", f"{up}formulas"), encoding="utf-8")
    _write_decisions(pages)
    _write_reference(pages / "reference", modules)


def _places() -> Iterator[tuple[Path, Path]]:
    """Yield each file of docs/ that the site shows, and the README, with its path in the site."""
    yield ROOT / "README.md", Path("readme.md")
    for source in sorted(DOCS.rglob("*")):
        if source.is_file() and HERE not in source.parents and "__pycache__" not in source.parts:
            target = source.relative_to(DOCS)
            if source.suffix == ".ipynb":
                target = target.with_suffix(".md")
            yield source, target.with_name("index.md") if target.name == "README.md" else target
    for name in ("style.css", WORKER):
        yield HERE / name, Path(name)


def _link(address: str, source: Path, placed: dict[Path, Path]) -> str:
    """Return the address in the site of the file to which a link in the page `source` leads."""
    if re.match(r"[a-z]+:", address) or (placed[source].parent / address).is_file():  # a picture of the tutorial's outputs
        return address
    linked = (source.parent / address).resolve()
    if linked == DOCS / "decisions":
        linked = DOCS / "decisions" / "README.md"
        placed = {**placed, linked: placed[DOCS / "README.md"].parent / "decisions" / "index.md"}
    if linked not in placed:
        raise ValueError(f"{source.relative_to(ROOT)}: the link {address} leads to no page of the site; link a page, or name the file")
    return Path(os.path.relpath(placed[linked], placed[source].parent)).as_posix()


def _notebook(source: Path, target: Path, execute: bool) -> str:
    """Execute a notebook in a temporary folder, write its pictures beside the page, and return the page with the outputs of all cells."""
    import tempfile

    import nbformat
    from nbclient import NotebookClient
    from nbconvert import MarkdownExporter

    notebook = nbformat.read(source, as_version=4)
    if execute:
        with tempfile.TemporaryDirectory() as folder:
            NotebookClient(notebook, timeout=EXECUTION_S, kernel_name="python3", resources={"metadata": {"path": folder}}).execute()
    folder = f"{target.stem}_files"
    text, resources = MarkdownExporter().from_notebook_node(notebook, {"output_files_dir": folder, "unique_key": target.stem})
    for name, content in resources["outputs"].items():
        (target.parent / name).parent.mkdir(parents=True, exist_ok=True)
        (target.parent / name).write_bytes(content)
    return text


def _use_own_worker(out: Path) -> None:
    """Let the pages load the file worker.js instead of a script from the network. Pages that are opened from a disk need this for their
    search.
    """
    changed = 0
    for page in out.rglob("*.html"):
        up = "../" * (len(page.relative_to(out).parts) - 1)
        text = page.read_text(encoding="utf-8")
        changed += NETWORK_WORKER in text
        page.write_text(text.replace(NETWORK_WORKER, f"{up}{WORKER}"), encoding="utf-8")
    if not changed:
        raise ValueError(f"no page loads {NETWORK_WORKER}; this version of the theme needs another remedy for its search in files")


def _write_decisions(pages: Path) -> None:
    """Write the list of the decision records, with the heading of each record."""
    rows = []
    for page in sorted((pages / "decisions").glob("[0-9]*.md")):
        heading = page.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
        rows.append(f"- [{heading}]({page.name})")
    text = "# Decisions\n\nEach record states a decision about the software, its reasons, and the alternatives.\n\n" + "\n".join(rows)
    (pages / "decisions" / "index.md").write_text(text + "\n", encoding="utf-8")


def _write_reference(folder: Path, modules: tuple[str, ...]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for module in modules:
        options = "" if module == "radartwin" else "    options:\n      show_submodules: true\n"
        (folder / f"{module}.md").write_text(f"# {module}\n\n::: {module}\n{options}", encoding="utf-8")
    rows = "\n".join(f"- [{module}]({module}.md)" for module in modules)
    text = f"# Reference\n\nThe reference is built from the docstrings. `import radartwin as rt` gives the public API.\n\n{rows}\n"
    (folder / "index.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s: %(message)s")
    parser = argparse.ArgumentParser(description="Build the documentation site.")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of the site (default: build/docs)")
    parser.add_argument("--no-execution", action="store_true", help="leave out the outputs of the tutorial")
    given = parser.parse_args()
    try:
        check_out(given.out)
    except ValueError as error:
        sys.exit(f"build_site.py: {error}")
    print(build(given.out, execute=not given.no_execution))

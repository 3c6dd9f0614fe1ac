"""Write the results in README.md from their template and the committed tables (`python -m analysis.pages`), and draw its two pictures
(`python -m analysis.pages.readme` runs `radartwin demo` and the Python example).
"""

import contextlib
import functools
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from analysis.pages import paper_tables
from analysis.pages.template import ROOT, committed, filled, verdicts
from radartwin.io import files

PAGE, FIGURES = ROOT / "README.md", ROOT / "docs" / "figures"
TEMPLATE = Path(__file__).with_name("readme_template.md")
PART = re.compile(r"## How accurate is it\?.*?(?=## Licence)", re.DOTALL)
TRAINING = {"(i)": "none", "(ii)": "a corner reflector", "(iii)": "a few labels"}  # by the paper's level of supervision


def text() -> str:
    """Return README.md with the results of the committed tables."""
    part = filled(TEMPLATE.read_text(encoding="utf-8"), table_3=table_3(), counts=verdicts("registered/headline"))
    page, number = PART.subn(lambda _: part, PAGE.read_text(encoding="utf-8"))
    if number != 1:
        raise ValueError(f"{PAGE}: {number} sections 'How accurate is it?' end before a section 'Licence', not one; restore both headings")
    return page


def table_3() -> Iterator[list[str]]:
    """Yield the cells of the paper's Table 3 on the registered draws: task, real data for training, figures of the paper and ours, our gain
    with its verdict, chance, n, and the verdict on our accuracy.
    """
    section = next(section for section in paper_tables.content() if section["title"].startswith("Table 3"))
    answer = functools.partial(paper_tables.answer, lambda table: committed(f"registered/{table}"), "")
    for row in section["rows"]:
        level, task, raw, trained, chance = row["cells"]
        row = {**section["where"], **row, "layout": None}
        (ours_raw, _, _), (ours, verdict, n) = (answer({**row, **cell}) for cell in (raw, trained))
        gain = {**row, "method": f"{trained['method']} - {raw['method']}", "metric": "gain in accuracy"}
        gained = "" if row["metric"] == "balanced accuracy" else ", ".join(answer(gain)[:2])
        task = task.replace("rover lateral", "drive past").replace("rover depth", "drive towards")
        cells = (raw["paper"], ours_raw, trained["paper"], ours, gained, chance["paper"], n, verdict)
        yield [task, TRAINING[level], *map(str, cells)]


def draw() -> None:
    """Run the demonstration and the Python example of README.md in a temporary folder, and copy a picture of each to docs/figures."""
    from radartwin.commands.demo import demo
    from radartwin.commands.demo.demo_page import STRIP

    (example,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        subprocess.run([sys.executable, "-"], input=example, text=True, check=True)
        room = Path("outputs/processed/room/range_azimuth.png")
        for name, picture in (("demo", demo(Path("outputs")).with_name(STRIP)), ("first_lines", room)):
            print(files.write_atomically(FIGURES / f"{name}.png", picture.read_bytes()))


if __name__ == "__main__":
    draw()

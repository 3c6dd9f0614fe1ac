"""Commands and examples in documents and help texts can be run or parsed, and every file, module and Hydra target that they name exists.

The commands of the README are tested in test_readme.py.
"""

from __future__ import annotations

import queue
import re
import shlex
import sys
import types
from pathlib import Path

import numpy as np
import own_experiment
import pytest
from markdown_blocks import DOCS, ROOT, blocks, commands, follow, prose, quoted

from experiments.validation.validation import CASES
from radartwin.commands.arguments import parse
from radartwin.commands.examples import EXAMPLES, FIRST_STEPS
from radartwin.config.compose import Composer, combinations, compose
from radartwin.recordings.recording_set import RecordingSet
from radartwin.runs import sweep
from radartwin.runs.search import space
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface

PAGES = sorted(DOCS.rglob("*.md"))
README = ROOT / "README.md"
RUN_HERE = {"benchmark.md", "extending.md", "own-objects.md", "recording-sets.md"}
# Commands that take too long, run until Ctrl-C, or need a cluster or absent data, by their first words, with the reason. The test only
# composes their options.
COMPOSED = {
    "radartwin view room --live": "serves until Ctrl-C; test_live.py serves a scene folder",
    "radartwin view lab --live": "serves until Ctrl-C; test_live.py serves the laboratory",
    "radartwin run -m experiment=environment materials=vlm,uniform,void seed": "nine jobs of minutes; sweeps of small ones: test_faults.py",
    "radartwin run -m experiment=environment seed=0,1,2,3 --output": "needs a cluster: make test-slurm starts one",
    "radartwin run experiment=environment -m seed=0,1,2,3 --output": "needs a cluster: make test-slurm starts one",
    "radartwin run -m experiment=campaign_part": "a campaign of an hour; tests/slurm/test_campaign_parts.py runs parts of a small one",
    "radartwin tables --profile paper": "hours; make tables runs the quick profile",
    "radartwin run -m experiment=turntable_shape": "three campaigns of minutes",
    "radartwin run -m experiment=rover_fidelity": "three campaigns of minutes",
    "radartwin run -m experiment=environment simulator": "six campaigns of minutes",
    "radartwin export": "minutes; tests/experiments/test_campaigns_recorded.py exports a small campaign and scores it",
    "radartwin run experiment=environment measured=recordings": "reads what export wrote; the same test does",
    "radartwin process capture.bin": "reads a capture of the user; tests/radar/test_captures.py chooses the same board",
    "radartwin import iq1m": "reads a public data set; tests/recordings/test_roverd.py imports traces of the same layout",
    "radartwin import radical": "reads a public data set; tests/recordings/test_roverd.py imports a cube",
    "radartwin import coloradar": "reads a public data set; tests/recordings/test_roverd.py imports a cube with poses",
    "radartwin import sim2radar": "reads a public data set; tests/recordings/test_importers.py imports folders of captures",
}


def reason(command: str) -> str | None:
    return next((why for start, why in COMPOSED.items() if command.startswith(start)), None)


def accept(command: str) -> None:
    """Parse a command and compose its configurations without running it.

    Raises:
        SystemExit, UserError: the command line or the configuration is wrong.
    """
    options = parse(shlex.split(command)[1:])
    assert callable(options.verb)
    if command.split()[1] not in ("run", "simulate", "export") or getattr(options, "mcap", None):
        return
    ours, hydras = sweep.split([word for word in options.overrides if word != "experiment=mine"])  # defined in docs/extending.md
    assert all(word.startswith(("hydra/launcher=", "hydra.launcher.")) for word in hydras)
    if getattr(options, "search", None):
        fixed, searched = space(ours)
        assert searched
        compose(fixed)
    elif getattr(options, "multirun", False):
        assert len(sweep.composed(combinations(ours), Composer())) > 1
    else:
        compose(ours)


SHOWN = [(page.name, command) for page in [*PAGES, README] for command in commands(page)]
HELP = [command for examples in (FIRST_STEPS, *EXAMPLES.values()) for command, _ in examples]


def test_every_command_has_a_test_or_a_reason() -> None:
    pages = [(name, command) for name, command in SHOWN if name != README.name]
    assert len(pages) >= 15
    assert not [c for name, c in pages if name not in RUN_HERE and not reason(c) and "--search" not in c]
    assert not [start for start in COMPOSED if not any(command.startswith(start) for _, command in SHOWN)]


@pytest.mark.parametrize("command", sorted({c for name, c in SHOWN if reason(c) or name == README.name} | set(HELP)))
def test_printed_command_is_accepted(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("room", "SET"):
        (tmp_path / folder).mkdir()
    (tmp_path / "SET" / "card.yaml").write_text("")
    accept(command)


@pytest.mark.parametrize("verb", ["", *EXAMPLES])
def test_help_ends_with_examples(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        parse([*filter(None, [verb]), "--help"])
    assert stopped.value.code == 0
    shown = capsys.readouterr().out.partition("\nexamples:\n")[2]
    examples = EXAMPLES[verb] if verb else FIRST_STEPS
    assert len(examples) >= 2
    for command, text in examples:
        assert f"  {text}\n    {command}\n" in shown + "\n"
        assert not verb or command.split()[1] == verb


def test_the_search_runs(here: Path, monkeypatch: pytest.MonkeyPatch, inside) -> None:
    (command,) = [c for c in commands(DOCS / "sweeps.md") if "--search" in c]
    arguments, environment = own_experiment.write(here / "own")
    monkeypatch.setenv("OWN_EXPERIMENT", environment["OWN_EXPERIMENT"])
    words = shlex.split(command)[1:]
    assert space([word for word in words if "=" in word and word != "experiment=mine"])[1].keys() >= {"trajectory.height_m", "materials"}
    done = inside(*words, *arguments[2:], "--trials", "2", "tracking=off")
    assert "2 trials" in done.stdout, done.stderr


def untracked(words: list[str]) -> list[str]:
    return [*words, *(["tracking=off"] if words[0] == "run" else [])]


def test_how_to_extend_works_as_printed(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = blocks(DOCS / "extending.md")
    assert sum(block.language == "python" for block in page) == 10
    assert follow(page, here, untracked) == 4
    said = capsys.readouterr()
    first = said.out.split("range_m doppler_mps azimuth_deg power_db\n")[1].split()
    assert float(first[0]) == pytest.approx(0.97, abs=0.03), "the tin stands a metre before the radar"
    assert "mine: 1 row (1 holds)" in said.out
    assert "sweep: 1 done, 1 cached" in said.out


@pytest.mark.slow
def test_own_objects_are_trained_and_classified_as_printed(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The page docs/own-objects.md trains on own meshes in free space and in a room. The test takes fewer frames and distances."""
    small = ["--frames", "96", "--distances", "1.0,1.2,1.4", "tracking=off", "jobs=1"]
    walls = {"floor": objects.box([0, 0, -0.1], [4, 4, 0]), "wall": objects.box([4, 0, 0], [4.1, 4, 2.5])}
    Scene(Surface(mesh, "plasterboard", name) for name, mesh in walls.items()).save(here / "room")
    assert follow(blocks(DOCS / "own-objects.md"), here, lambda words: [*words, *(small if words[0] == "train" else [])]) == 4
    said = capsys.readouterr()
    assert said.out.split("label probability\n")[1].startswith("mug ")
    assert {path.name for path in (here / "my-model").iterdir()} == {"README.md", "model.json", "model.safetensors"}


def test_recording_sets_are_made_as_printed(here: Path, shared_data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The page docs/recording-sets.md imports one capture and then a folder of captures with a mapping file, checks the recording set, and
    loops over its recordings.
    """
    capture = shared_data / "radar" / "iwr6843_static_room"
    for stem in ("CAPTURE", "FOLDER/mug_1m/run3", "FOLDER/mug_0.5m/run1"):
        (here / stem).parent.mkdir(parents=True, exist_ok=True)
        (here / f"{stem}.bin").symlink_to(capture / "iwr6843_frame_adc_data.bin")
        (here / f"{stem}.mmwave.json").symlink_to(capture / "iwr6843_mmwaveDevice.mmwave.json")
    (here / "FOLDER/mug_1m/run3.txt").write_text("0 0 0 1 0 0 0 1\n1 0.1 0 1 0 0 0 1\n")
    page = blocks(DOCS / "recording-sets.md")
    (mapping,) = [block.text for block in page if block.text.startswith("card:")]
    (here / "map.yaml").write_text(mapping)
    until = next(i for i, block in enumerate(page) if block.language == "sh")
    assert follow(page[:until], here, untracked) == 3
    assert "doctor: the set can be used" in capsys.readouterr().out
    (loop,) = [block.text for block in page if block.text.startswith("from radartwin.recordings")]
    given: dict[str, object] = {}
    exec(loop, given)
    assert given["row"].room == "lab"  # type: ignore[attr-defined]


class FakeSystem:
    """Stands for xwr.XWRSystem: a board that sends frames of noise, of which the second lost packets."""

    def __init__(self, *, radar: dict, capture: dict) -> None:
        self.config = types.SimpleNamespace(raw_shape=(radar["frame_length"], 3, 4, 2 * radar["adc_samples"]))
        assert capture["sys_ip"] == "192.168.33.30"

    def qstream(self) -> queue.Queue:
        frames: queue.Queue = queue.Queue()
        rng = np.random.default_rng(0)
        for number in range(3):
            data = rng.integers(-500, 500, self.config.raw_shape).astype("<i2").tobytes()
            frames.put(types.SimpleNamespace(timestamp=1.7e9 + 0.05 * number, data=data, complete=number != 1))
        frames.put(None)
        return frames

    def stop(self) -> None:
        pass


def test_capture_on_linux_works_as_printed(here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    page = blocks(DOCS / "recording-sets.md")
    first = next(i for i, block in enumerate(page) if block.file == "config.yaml")
    (program,) = [block for block in page if block.file == "capture.py"]
    last = next(i for i, block in enumerate(page) if "radartwin import TRACE" in block.text)
    (here / "config.yaml").write_text(page[first].text)
    monkeypatch.setitem(sys.modules, "xwr", types.SimpleNamespace(XWRSystem=FakeSystem))
    exec(compile(program.text, "capture.py", "exec"), {"__name__": "__main__"})
    assert follow(page[last : last + 1], here, untracked) == 1
    said = capsys.readouterr()
    assert "CAPTURED: 1 recording added, 1 in all" in said.out
    assert "1 of 3 frames have lost packets" in said.err
    (row,) = RecordingSet.load(here / "CAPTURED")
    assert row.object == "mug"


@pytest.mark.parametrize("page", [*PAGES, README], ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_points_to_exists(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)\)", page.read_text()):
        assert (page.parent / target).exists(), target
    for path in quoted(page):
        if re.fullmatch(r"(radartwin|experiments|analysis|tests|docs|conf)(/[\w.-]+)+", path) and "NAME" not in path:
            assert (ROOT / path).exists() or list(ROOT.glob(f"{path}*")), path
    for module in re.findall(r"`python -m ([\w.]+)", prose(page)):
        place = ROOT / module.replace(".", "/")
        assert place.with_suffix(".py").exists() or (place / "__main__.py").exists(), module
    for target in re.findall(r"`make ([\w-]+)`", prose(page)):
        assert f"\n{target}:" in (ROOT / "Makefile").read_text(), target


@pytest.mark.parametrize("command", sorted({c for page in [*PAGES, README] for c in quoted(page) if re.match(r"radartwin [a-z]", c)}))
def test_a_command_in_the_text_is_taken(command: str) -> None:
    words = shlex.split(command)[1:]
    needed = {"reconstruct": ["--out", "x"], "export": ["--out", "x"], "import": ["x", "--out", "x"], "classify": ["x", "--model", "x"]}
    needed["train"] = ["x", "--out", "x"]
    positional = {"label": ["x"], "view": ["x"], "process": ["x"], "reconstruct": ["x"]}
    extra = needed.get(words[0], []) if "--out" not in words and "--model" not in words else []
    try:
        parse(words)
    except SystemExit:
        parse([*words, *positional.get(words[0], []), *extra])


def test_the_index_links_every_page() -> None:
    index = (DOCS / "README.md").read_text()
    links = {(DOCS / target).resolve() for target in re.findall(r"\]\(([^)#\s]+)\)", index)}
    wanted = {page.resolve() for page in PAGES if page.parent == DOCS} - {DOCS / "README.md"}
    assert wanted | {(DOCS / "tutorial.ipynb").resolve()} <= links
    assert {DOCS / "decisions", DOCS / "results/README.md"} <= links


def test_checks_that_concepts_names_are_checks() -> None:
    known = {case.name for case in CASES}
    named = re.findall(r"Checked by: (.*?)(?:\n\n|\Z)", (DOCS / "concepts.md").read_text(), flags=re.S)
    assert len(named) >= 9
    found = {word for text in named for word in re.findall(r"`([^`/\n]+)`", text) if re.fullmatch(r"[a-z0-9.-]+", word)}
    assert found <= known, found - known
    assert len(found) >= 30

"""Printed commands and examples run or parse, and the files and modules that pages name exist. For the README: test_readme.py."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import own_experiment
import pytest
from composing import COMPOSER, compose
from markdown_blocks import DOCS, ROOT, blocks, commands, follow, prose, quoted

from radartwin.commands.arguments import PURPOSES, parse
from radartwin.commands.examples import EXAMPLES
from radartwin.config.compose import combinations
from radartwin.runs import sweep
from radartwin.runs.optimise import space
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface

PAGES = sorted(DOCS.rglob("*.md"))
README = ROOT / "README.md"


def accept(command: str) -> None:
    """Parse a command and compose its configurations without running it."""
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
        assert len(sweep.composed(combinations(ours), COMPOSER)) > 1
    else:
        compose(ours)


PRINTED = {command for page in [*PAGES, README] for command in commands(page)}
HELP = [command for examples in EXAMPLES.values() for command, _ in examples]


@pytest.mark.parametrize("command", sorted(PRINTED | set(HELP)))
def test_printed_command_is_accepted(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("room", "SET"):
        (tmp_path / folder).mkdir()
    (tmp_path / "SET" / "card.yaml").write_text("")
    accept(command)


def test_help_names_each_verb_once_and_that_of_a_verb_ends_with_examples(inside) -> None:
    named = [line.split()[0] for line in inside("--help").stdout.splitlines() if line.startswith("  ")]
    assert named == [verb for purpose in PURPOSES.values() for verb in purpose]
    assert sorted(named) == sorted(EXAMPLES)
    for verb, examples in EXAMPLES.items():
        printed = inside(verb, "--help").stdout.partition("\nexamples:\n")[2]
        for command, text in examples:
            assert f"  {text}\n    {command}\n" in printed + "\n"
            assert command.split()[1] == verb


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
    """The page docs/recording-sets.md imports captures with and without a mapping file, checks the set, and loops over it."""
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

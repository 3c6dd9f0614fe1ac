"""Help teaches by example: every verb has examples, and each is what the command line and the configuration take."""

from __future__ import annotations

import argparse
import shlex

import pytest

from radartwin import cli
from radartwin.commands.examples import _ROAD, EXAMPLES
from radartwin.config.compose import combinations, compose
from radartwin.runs import sweep
from radartwin.runs.search import space

COMMANDS = [command for listed in (_ROAD, *EXAMPLES.values()) for command, _ in listed]
COMPOSED = ("run", "simulate", "export")


def parsed(command: str) -> argparse.Namespace:
    program, *words = shlex.split(command)
    assert program == "radartwin"
    return cli._parse(words)


def verbs() -> list[str]:
    actions = cli._parser()._actions
    return list(next(action.choices for action in actions if isinstance(action, argparse._SubParsersAction)))


def test_every_verb_has_examples_and_its_help_ends_with_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert set(EXAMPLES) == set(verbs())
    for verb, listed in {"": _ROAD, **EXAMPLES}.items():
        with pytest.raises(SystemExit) as stopped:
            cli._parse([*filter(None, [verb]), "--help"])
        assert stopped.value.code == 0
        shown = capsys.readouterr().out.partition("\nexamples:\n")[2]
        for command, text in listed:
            assert f"  {text}\n    {command}\n" in shown + "\n"
        assert len(listed) >= 2
        assert all(command.split()[1] == verb for command, _ in listed if verb)


@pytest.mark.parametrize("command", COMMANDS)
def test_an_example_is_taken(command: str) -> None:
    options = parsed(command)
    assert callable(options.verb)


@pytest.mark.parametrize("command", [command for command in COMMANDS if command.split()[1] in COMPOSED])
def test_the_overrides_of_an_example_compose(command: str) -> None:
    options = parsed(command)
    mine = [word for word in options.overrides if word != "experiment=mine"]  # the reader's own, in docs/extending.md
    ours, hydras = sweep.split(mine)
    if getattr(options, "search", None):
        fixed, searched = space(ours)
        assert searched
        compose(fixed)
    elif getattr(options, "multirun", False):
        assert len(sweep.composed(combinations(ours))) > 1
        assert all(word.startswith(("hydra/launcher=", "hydra.launcher.")) for word in hydras)
    else:
        compose(mine)

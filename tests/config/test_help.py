"""The help of every verb ends with examples, and each example can be parsed and composed."""

from __future__ import annotations

import argparse
import shlex

import pytest

from radartwin.commands.arguments import parse
from radartwin.commands.examples import EXAMPLES, FIRST_STEPS
from radartwin.config.compose import combinations, compose
from radartwin.runs import sweep
from radartwin.runs.search import space

COMMANDS = [command for examples in (FIRST_STEPS, *EXAMPLES.values()) for command, _ in examples]
COMPOSED = ("run", "simulate", "export")


def parsed(command: str) -> argparse.Namespace:
    program, *words = shlex.split(command)
    assert program == "radartwin"
    return parse(words)


@pytest.mark.parametrize("verb", ["", *EXAMPLES])
def test_help_ends_with_examples(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        parse([*filter(None, [verb]), "--help"])
    assert stopped.value.code == 0
    shown = capsys.readouterr().out.partition("\nexamples:\n")[2]
    examples = EXAMPLES[verb] if verb else FIRST_STEPS
    for command, text in examples:
        assert f"  {text}\n    {command}\n" in shown + "\n"
    assert len(examples) >= 2
    assert all(command.split()[1] == verb for command, _ in examples if verb)


@pytest.mark.parametrize("command", COMMANDS)
def test_example_is_accepted(command: str) -> None:
    options = parsed(command)
    assert callable(options.verb)
    if command.split()[1] not in COMPOSED:
        return
    words = [word for word in options.overrides if word != "experiment=mine"]  # the reader's own, in docs/extending.md
    ours, hydras = sweep.split(words)
    if getattr(options, "search", None):
        fixed, searched = space(ours)
        assert searched
        compose(fixed)
    elif getattr(options, "multirun", False):
        assert len(sweep.composed(combinations(ours))) > 1
        assert all(word.startswith(("hydra/launcher=", "hydra.launcher.")) for word in hydras)
    else:
        compose(words)

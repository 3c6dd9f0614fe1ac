"""The commit of the checkout is unknown, with a warning, if git cannot read the repository."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from radartwin.runs import checkout


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(checkout, "ROOT", tmp_path)
    checkout.commit.cache_clear()
    yield tmp_path
    checkout.commit.cache_clear()


def test_without_a_repository_there_is_no_commit(root: Path) -> None:
    assert checkout.commit() == ("none", False)


def test_a_repository_that_git_refuses_warns_once_with_the_message_of_git(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    subprocess.run(["git", "init", "-q", str(root)], check=True)
    monkeypatch.setenv("GIT_TEST_ASSUME_DIFFERENT_OWNER", "1")  # git's own tests use this variable
    with pytest.warns(UserWarning, match="git cannot read the commit of .*: fatal: ") as caught:
        assert [checkout.commit() for _ in range(2)] == [("unknown", True)] * 2
    assert len(caught) == 1
    assert "\n" not in str(caught[0].message)


def test_a_machine_without_git_warns(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (root / ".git").mkdir()
    monkeypatch.setenv("PATH", str(root))
    with pytest.warns(UserWarning, match="git cannot read the commit of .*No such file or directory: 'git'"):
        assert checkout.commit() == ("unknown", True)

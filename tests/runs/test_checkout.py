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


def test_a_repository_that_git_refuses_or_a_machine_without_git_warns_once(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert checkout.commit() == ("none", False)
    checkout.commit.cache_clear()
    subprocess.run(["git", "init", "-q", str(root)], check=True)
    monkeypatch.setenv("GIT_TEST_ASSUME_DIFFERENT_OWNER", "1")  # git's own tests use this variable
    with pytest.warns(UserWarning, match="git cannot read the commit of .*: fatal: ") as caught:
        assert [checkout.commit() for _ in range(2)] == [("unknown", True)] * 2
    assert len(caught) == 1
    assert "\n" not in str(caught[0].message)
    checkout.commit.cache_clear()
    monkeypatch.setenv("PATH", str(root))
    with pytest.warns(UserWarning, match="git cannot read the commit of .*No such file or directory: 'git'"):
        assert checkout.commit() == ("unknown", True)

"""Provide test fixtures that mount small file systems, which a test can fill or make read-only."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from disks import Disk, mounted


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Disk]:
    """Mount a file system of 3 MB for one test, so that the test can fill the disk."""
    yield from mounted(tmp_path / "disk", 3)


@pytest.fixture(scope="module")
def shared_disk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Disk]:
    """Return a disk of 12 MB that all tests of a test module share."""
    yield from mounted(tmp_path_factory.mktemp("mounted") / "disk", 12)

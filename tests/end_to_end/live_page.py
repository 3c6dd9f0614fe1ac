"""Start `radartwin view --live` as a process, and find and drag things of its page in a browser."""

from __future__ import annotations

import contextlib
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import browser
import numpy as np
from processes import started
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT = 1500, 950


@contextlib.contextmanager
def serving(folder: Path, *arguments: str | Path) -> Iterator[tuple[int, subprocess.Popen[str]]]:
    """Run the command in a folder. Yields the port of the page and the process of the command."""
    command = [sys.executable, "-m", "radartwin", "view", *map(str, arguments), "--live", "--port", "0"]
    process = started(command, folder, PYTHONWARNINGS="error::DeprecationWarning:radartwin")
    assert process.stdout is not None
    try:
        found = re.fullmatch(r"live: http://127\.0\.0\.1:(\d+)\n", process.stdout.readline())
        assert found, process.stderr.read() if process.stderr else ""
        yield int(found[1]), process
    finally:
        if process.poll() is None:
            process.terminate()
        process.communicate(timeout=60)


def open_page(page: browser.Page, port: int) -> None:
    """Open the live page and wait until it shows an answer, without the browser's note about software rendering."""
    page.call("Emulation.setDeviceMetricsOverride", width=WIDTH, height=HEIGHT, deviceScaleFactor=1, mobile=False)
    page.call("Page.navigate", url=f"http://127.0.0.1:{port}/")
    page.until("document.body !== null && /answer 1: /.test(document.body.innerText)", 200)
    page.run("document.querySelectorAll('.mantine-Notification-closeButton').forEach(button => button.click())")


def pixel(camera: Any, point: np.ndarray) -> tuple[float, float]:
    """Return the place of a point (3,) of the world in the window, for the camera of a viser client.

    The camera looks along its own z axis, with x to the right and y down.
    """
    rotation = Rotation.from_quat(np.asarray(camera.wxyz), scalar_first=True).as_matrix()
    x, y, z = rotation.T @ (np.asarray(point) - np.asarray(camera.position))
    focal = camera.image_height / 2 / np.tan(camera.fov / 2)
    return float(camera.image_width / 2 + focal * x / z), float(camera.image_height / 2 + focal * y / z)

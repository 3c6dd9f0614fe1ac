"""`radartwin view --live`: its process, its bad input, and its page in a browser, with screenshots in outputs/screenshots."""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from processes import descendants, listening, runs, serving, wait_until
from scipy.spatial.transform import Rotation

import radartwin as rt
from radartwin.builders.scene import build_target
from radartwin.config.scene import RoomScene
from radartwin.live.serve import running
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import pose

HOST = "127.0.0.1"
WIDTH, HEIGHT = 1500, 950


def served(folder: Path, scene: str | Path) -> contextlib.AbstractContextManager[tuple[str, subprocess.Popen[str]]]:
    """Run the live page of a scene. The result yields the port of the page and the process of the command."""
    words = ("view", scene, "--live", "--port", "0")
    return serving(folder, r"^live: http://127\.0\.0\.1:(\d+)$", *words, PYTHONWARNINGS="error::DeprecationWarning:radartwin")


@pytest.fixture(scope="module")
def plate_scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a scene folder with a metal plate, which is answered fast."""
    plate = objects.plate(0.3, 0.3).apply_transform(np.diag([-1.0, -1.0, 1.0, 1.0])).apply_translation([2.0, 0, 1])
    return Scene([Surface(plate, "metal", "plate", role="object")]).save(tmp_path_factory.mktemp("scene") / "plate")


def handshake(port: int, origin: str) -> str:
    """Open a web socket as a page of `origin` would, and return the first line of the server's answer."""
    with socket.create_connection((HOST, port), timeout=10) as connection:
        lines = (
            "GET / HTTP/1.1", f"Host: {HOST}:{port}", "Upgrade: websocket", "Connection: Upgrade", f"Origin: {origin}",
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Protocol: viser-v1.1.1",
        )  # fmt: skip
        connection.sendall("\r\n".join([*lines, "", ""]).encode())
        return connection.recv(4096).decode(errors="replace").splitlines()[0]


@pytest.mark.parametrize("number", [signal.SIGINT, *(pytest.param(n, marks=pytest.mark.slow) for n in (signal.SIGTERM, signal.SIGHUP))])
def test_the_page_is_served_on_this_machine_only_until_a_signal_ends_it(plate_scene: Path, tmp_path: Path, number: signal.Signals) -> None:
    with served(tmp_path, plate_scene) as (found, process):
        port = int(found)
        assert listening(port) == {HOST}
        assert handshake(port, f"http://{HOST}:{port}").split()[1] == "101"
        # a page of another site, whose scripts may open web sockets to this machine
        assert handshake(port, "http://attacker.example").split()[1] == "403"
        begun = descendants(process.pid)
        process.send_signal(number)
        said, complained = process.communicate(timeout=30)
        assert process.returncode == 0
        assert (said, complained) == ("", "")
        assert listening(port) == set()
        wait_until(lambda: not any(runs(pid) for pid in begun), 10)


@pytest.mark.slow
def test_a_signal_ends_the_page_during_a_search(tmp_path: Path) -> None:
    with served(tmp_path, "lab") as (port, process):
        wait_until(lambda: len(searching(process.pid)) > 1, 200)  # the search and the threads that it starts
        process.send_signal(signal.SIGTERM)
        assert process.wait(5) == 0
        assert listening(int(port)) == set()


def searching(pid: int) -> list[int]:
    """Return the nice values of those threads of a process that have a lower priority than the process itself."""
    levels = subprocess.run(["ps", "-L", "-o", "ni=", "-p", str(pid)], capture_output=True, text=True).stdout.split()
    return [nice for nice in map(int, levels) if nice > min(map(int, levels))]


def test_a_viser_that_starts_its_web_server_in_another_way_is_refused(inside, plate_scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import viser.infra._infra
    import websockets.asyncio.server

    module = SimpleNamespace(**vars(websockets.asyncio.server))
    unwrapped = SimpleNamespace(**{**vars(websockets), "asyncio": SimpleNamespace(server=module)})
    monkeypatch.setattr(viser.infra._infra, "websockets", unwrapped)
    done = inside("view", plate_scene, "--live", "--port", "0")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("radartwin: view --live cannot check which pages connect")
    assert done.stderr.count("\n") == 1


def test_bad_input_gives_one_line_and_status_2(inside, plate_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trimesh.creation.box((3, 3, 3)).export(tmp_path / "bare.ply")
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        cases = {
            ("view", plate_scene, "--live", "--port", str(port)): f"port {port} is taken; leave --port out",
            ("view", "bare.ply", "--live"): "bare.ply carries no material labels",
            ("view", "nothing", "--live"): "scene nothing is not there",
            ("view", plate_scene, "--live", "--recording", "nothing"): "nothing.bin: no such file",
            ("view", plate_scene, "--live", "--by", "segment"): "leave --by out",
            ("view", plate_scene, "--port", "8080"): "--port applies only to the live page; add --live",
        }
        for words, wanted in cases.items():
            done = inside(*words)
            assert (done.returncode, done.stdout) == (2, ""), words
            assert wanted in done.stderr
            assert done.stderr.count("\n") == 1
    monkeypatch.setitem(sys.modules, "viser", None)
    done = inside("view", plate_scene, "--live")
    assert done.returncode == 2
    assert done.stderr == "radartwin: view --live needs viser: pip install 'radartwin[live]'\n"


def pixel(camera: Any, point: np.ndarray) -> tuple[float, float]:
    """Return the place of a point (3,) in the window. The camera looks along its own z axis, with x to the right and y down."""
    rotation = Rotation.from_quat(np.asarray(camera.wxyz), scalar_first=True).as_matrix()
    x, y, z = rotation.T @ (np.asarray(point) - np.asarray(camera.position))
    focal = camera.image_height / 2 / np.tan(camera.fov / 2)
    return float(camera.image_width / 2 + focal * x / z), float(camera.image_height / 2 + focal * y / z)


@pytest.mark.slow
def test_the_page_shows_the_room_the_answer_and_a_clicked_path(chromium) -> None:
    """The page shows the laboratory with a corner reflector 2 m before the radar."""
    start = rooms.lab_bench().sensor_pose
    target = (s.moved(pose(start[:3, 3] + 2.0 * start[:3, 0])) for s in build_target(RoomScene()))
    with running(rooms.lab() + Scene(target), rt.Radar.iwr1843(), start, 0) as live:
        page = chromium()
        page.call("Emulation.setDeviceMetricsOverride", width=WIDTH, height=HEIGHT, deviceScaleFactor=1, mobile=False)
        page.call("Page.navigate", url=f"http://{HOST}:{live.port}/")
        page.until("document.body !== null && /answer \\d+: complete/.test(document.body.innerText)", 200)
        page.run("document.querySelectorAll('.mantine-Notification-closeButton').forEach(button => button.click())")
        camera = next(iter(live.server.get_clients().values())).camera
        assert page.run("document.querySelector('.uplot') !== null")
        text = page.run("document.body.innerText")
        for words in ("plasterboard", "floorboard 8 mm on concrete", "0 dB is -55 dB"):
            assert words in text
        page.screenshot("live-start")
        assert live.page.answer
        strongest = live.page.answer.paths[0]  # of the reflector; the click may also meet a path of the room behind it
        x, y = pixel(camera, 0.5 * strongest.points[0] + 0.5 * strongest.points[1])
        page.click_at(x + 5, y - 5)
        page.until("/received over transmitted power\\s+range\\s+[25]\\.0/.test(document.body.innerText)", 20)
        page.screenshot("live-path")
        live.page.choose(0)
        page.until("/surfaces\\s+target/.test(document.body.innerText)", 20)
        assert not [line for line in page.messages if line.startswith("exception")]
        assert not live.crash

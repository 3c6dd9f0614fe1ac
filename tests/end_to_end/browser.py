"""Control the browser Chromium without a window, by DevTools commands through a pipe."""

from __future__ import annotations

import base64
import contextlib
import io
import itertools
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

SCREENSHOTS = Path(__file__).resolve().parents[2] / "outputs" / "screenshots"
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
OPTIONS = (
    "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-extensions", "--remote-debugging-pipe",
)  # fmt: skip


def find() -> str | None:
    """Return the browser's path, or None if no browser is installed."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Page:
    """Control a tab of the browser. The list `messages` collects the console messages and the uncaught JavaScript errors of the tab."""

    def __init__(self, send: int, receive: int) -> None:
        self._send, self._receive, self._buffer = send, receive, b""
        self._ids = itertools.count(1)
        self._session: str | None = None
        self.messages: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> Any:
        """Send one command to the browser and return its answer. Console messages that arrive before the answer are
        stored in `messages`.
        """
        number = next(self._ids)
        command: dict[str, Any] = {"id": number, "method": method, "params": parameters}
        if self._session:
            command["sessionId"] = self._session
        os.write(self._send, json.dumps(command).encode() + b"\0")
        end = time.monotonic() + 60
        while (answer := self._next(end)).get("id") != number:
            self._note(answer)
        if "error" in answer:
            raise AssertionError(f"{method}: {answer['error']['message']}")
        return answer["result"]

    def _next(self, end: float) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            if not select.select([self._receive], [], [], max(0.0, end - time.monotonic()))[0]:
                raise AssertionError("the browser did not answer within a minute")
            chunk = os.read(self._receive, 1 << 20)
            if not chunk:
                raise AssertionError("the browser has gone")
            self._buffer += chunk
        message, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(message)

    def _note(self, event: dict[str, Any]) -> None:
        parameters = event.get("params", {})
        if event.get("method") == "Runtime.consoleAPICalled":
            self.messages.append(f"{parameters['type']}: {[a.get('value') for a in parameters['args']]}")
        elif event.get("method") == "Runtime.exceptionThrown":
            self.messages.append(f"exception: {parameters['exceptionDetails'].get('exception', {}).get('description')}")
        elif event.get("method") == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.messages.append(f"log: {parameters['entry']['text']}")
        elif event.get("method") == "Network.requestWillBeSent" and not parameters["request"]["url"].startswith(("file:", "data:")):
            self.messages.append(f"network: {parameters['request']['url'][:100]}")

    def run(self, expression: str) -> Any:
        """Evaluate a JavaScript expression in the tab and return its value."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def open(self, path: Path, width: int = 1280, height: int = 800, fragment: str = "") -> None:
        """Load a file and wait until the page reports that it has drawn its content."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Page.navigate", url=path.resolve().as_uri() + fragment)
        self.until("document.body !== null && (document.body.dataset.ready === 'yes' || document.querySelector('.failure') !== null)")

    def until(self, condition: str, seconds: float = 40) -> None:
        end = time.monotonic() + seconds
        while not self.run(condition):
            assert time.monotonic() < end, f"not within {seconds} s: {condition}; console: {self.messages}"
            time.sleep(0.05)

    def click(self, selector: str) -> None:
        """Click the middle of an element when the element no longer moves and is not covered; then wait two frames for the page to draw."""
        self.click_at(*self._at_rest(selector))

    def click_at(self, x: float, y: float) -> None:
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
        self.settle()

    def tap(self, x: float, y: float) -> None:
        """Touch a point of the page with a finger."""
        self.call("Emulation.setTouchEmulationEnabled", enabled=True)
        self.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        self.settle()

    def _at_rest(self, selector: str) -> tuple[float, float]:
        """Return the middle of an element after the element has not moved for 0.25 s, because loading iframes may move the elements below
        them.
        """
        end, since, last = time.monotonic() + 30, time.monotonic(), None
        while True:
            x, y, hit = self.run(
                f"(() => {{ const e = document.querySelector({selector!r}), b = e.getBoundingClientRect(); "
                "const x = b.left + b.width / 2, y = b.top + b.height / 2; "
                "return [x, y, e.contains(document.elementFromPoint(x, y))]; })()"
            )
            if not hit or (x, y) != last:
                since, last = time.monotonic(), (x, y)
            elif time.monotonic() - since > 0.25:
                return x, y
            assert time.monotonic() < end, f"{selector} does not come to rest, or something covers it"
            time.sleep(0.03)

    def hover(self, x: float, y: float) -> None:
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        self.settle()

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=start[0], y=start[1], button="left", clickCount=1)
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=end[0], y=end[1], button="left", buttons=1)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=end[0], y=end[1], button="left", clickCount=1)
        self.settle()

    def settle(self) -> None:
        self.run("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")

    def press(self, key: str, code: int) -> None:
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)

    def screenshot(self, name: str = "") -> np.ndarray:
        """Return the pixels of the browser window, shape (height, width, 3), uint8. If `name` is given, also write
        outputs/screenshots/NAME.png.
        """
        png = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if name:
            SCREENSHOTS.mkdir(parents=True, exist_ok=True)
            (SCREENSHOTS / f"{name}.png").write_bytes(png)
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


@contextlib.contextmanager
def browser(executable: str, profile: Path) -> Iterator[Callable[[], Page]]:
    """Start a browser. Yields a function that opens a new tab."""
    to_browser, our_send = os.pipe()
    our_receive, from_browser = os.pipe()
    # The protocol's pipe is file descriptors 3 and 4; the shell puts ours there.
    command = f'exec "$0" "$@" 3<&{to_browser} 4>&{from_browser}'
    process = subprocess.Popen(
        ["bash", "-c", command, executable, *OPTIONS, f"--user-data-dir={profile}", "about:blank"],
        pass_fds=(to_browser, from_browser),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(to_browser)
    os.close(from_browser)
    try:
        yield lambda: Page(our_send, our_receive)
    finally:
        os.close(our_send)
        os.close(our_receive)
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

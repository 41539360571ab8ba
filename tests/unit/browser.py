"""Headless Chromium, steered by its debugging protocol: real clicks, keys, downloads, pictures."""

import base64
import io
import itertools
import json
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest
from matplotlib.image import imread

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    *("--headless", "--no-sandbox", "--hide-scrollbars", "--disable-dev-shm-usage"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--remote-debugging-port=0"),
)
PATIENCE_S = 120
"""After which a page that does not get ready is a failure."""


class Page:
    """A window of a browser."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._numbers = socket, itertools.count()
        self.ask("Page.enable")

    def ask(self, method: str, **values: Any) -> dict[str, Any]:
        """Call the protocol; the answer."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": values}))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE_S))
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]

    def run(self, script: str) -> Any:
        """The value of an expression in the page."""
        found = self.ask("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def open(self, url: str, width: int = 1400, height: int = 1000) -> None:
        """Show a page in a window of that size, and wait until it is there."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.ask("Emulation.setDeviceMetricsOverride", **size)
        self.ask("Page.navigate", url=url)
        until(lambda: self.run("document.readyState === 'complete' && location.href !== ''"))
        until(lambda: self.run("location.protocol") in (url.split("/")[0], "blob:"))

    def click(self, element: str) -> None:
        """Click with the mouse on what a script finds."""
        box = f"(e => {{e.scrollIntoView({{block: 'center'}}); return e}})({element})"
        box += ".getBoundingClientRect()"
        x, y = self.run(f"(b => [b.x + b.width / 2, b.y + b.height / 2])({box})")
        for kind in ("mousePressed", "mouseReleased"):
            where = {"x": x, "y": y, "button": "left", "clickCount": 1}
            self.ask("Input.dispatchMouseEvent", type=kind, **where)

    def picture(self) -> np.ndarray:
        """What is seen, shape (height, width, 4)."""
        found = self.ask("Page.captureScreenshot", format="png")
        return np.asarray(imread(io.BytesIO(base64.b64decode(found["data"])), format="png"))


def until(ready: Callable[[], Any]) -> Any:
    """Wait for what is true; its value."""
    end = time.monotonic() + PATIENCE_S
    while not (found := ready()):
        assert time.monotonic() < end, "the page did not get ready"
        time.sleep(0.05)
    return found


@contextmanager
def browser(folder: Path) -> Iterator[Page]:
    """A browser that keeps its files in a folder; skips where none is installed."""
    connect = pytest.importorskip("websockets.sync.client").connect
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip(f"needs one of {', '.join(NAMES)}")
    command = [program, *FLAGS, f"--user-data-dir={folder}", "about:blank"]
    done = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        said = folder / "DevToolsActivePort"
        port = until(lambda: said.exists() and said.read_text().partition("\n")[0])
        with urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
            (page,) = (one for one in json.load(answer) if one["type"] == "page")
        with connect(page["webSocketDebuggerUrl"], max_size=None) as socket:
            yield Page(socket)
    finally:
        done.terminate()
        done.wait()

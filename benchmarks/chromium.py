"""A page in headless Chromium, driven over its debugging pipe."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--hide-scrollbars", "--remote-debugging-pipe",
)  # fmt: skip


def chromium() -> str | None:
    """Return the program, None where there is none."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


class Page:
    """A page that is open: `value` evaluates JavaScript in it, and ``requests`` are the addresses that it asked for."""

    def __init__(self, read: int, write: int) -> None:
        self.read, self.write, self.count, self.rest = read, write, 0, b""
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.session = ""

    def send(self, method: str, **params: Any) -> Any:
        """Return the answer to a command of the Chrome DevTools Protocol."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self.count:
                assert "error" not in answer, answer
                return answer["result"]

    def _next(self) -> Any:
        while b"\0" not in self.rest:
            part = os.read(self.read, 1 << 20)
            assert part, "Chromium has ended"
            self.rest += part
        line, self.rest = self.rest.split(b"\0", 1)
        answer = json.loads(line)
        if answer.get("method") == "Network.requestWillBeSent":
            self.requests.append(answer["params"]["request"]["url"])
        if answer.get("method") == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(answer["params"]["exceptionDetails"])[:2000])
        return answer

    def value(self, text: str) -> Any:
        """Return the value of a JavaScript expression; that of a promise once it is there."""
        result = self.send("Runtime.evaluate", expression=text, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in result, json.dumps(result["exceptionDetails"])[:2000]
        return result["result"].get("value")

    def press(self, key: str, code: int) -> None:
        """Press and release a key."""
        for kind in ("rawKeyDown", "keyUp"):
            self.send("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code)

    def picture(self, path: Path) -> None:
        """Write what the window shows as a PNG."""
        path.write_bytes(base64.b64decode(self.send("Page.captureScreenshot")["data"]))


@contextmanager
def opened(address: str, width: int = 1280, height: int = 800) -> Iterator[Page]:
    """Open an address in a window of its own; the page's promise ``ready`` is awaited."""
    program = chromium()
    assert program is not None
    ends = [os.pipe(), os.pipe()]
    from_browser, from_us = ends[1][0], ends[0][1]
    to_browser, to_us = (fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (ends[0][0], ends[1][1]))
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        # The program reads from its descriptor 3 and writes to 4.
        command = f'exec "$@" 3<&{to_browser} 4>&{to_us}'
        run = subprocess.Popen(
            ["bash", "-c", command, "bash", program, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
            pass_fds=(to_browser, to_us), stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        for each in (to_browser, to_us, ends[0][0], ends[1][1]):
            os.close(each)
        try:
            page = Page(from_browser, from_us)
            target = page.send("Target.createTarget", url="about:blank")["targetId"]
            page.session = page.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            page.send(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
            for domain in ("Network", "Runtime", "Page"):
                page.send(f"{domain}.enable")
            page.send("Page.navigate", url=address)
            page.value(
                "new Promise((done) => document.readyState === 'complete' ? done() : addEventListener('load', done))"
            )
            page.value("ready")
            yield page
        finally:
            run.terminate()
            run.wait(timeout=20)
            os.close(from_us)
            os.close(from_browser)

"""A headless Chromium with an empty profile, controlled over a pipe (Chrome DevTools Protocol)."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--window-size=1100,900",
    "--remote-debugging-pipe",
)  # fmt: skip
_AT_3_AND_4 = """
import os, sys
commands, answers = (os.dup(int(one)) for one in sys.argv[1:3])
for source, place in ((commands, 3), (answers, 4)):
    os.dup2(source, place)
    os.set_inheritable(place, True)  # dup2 leaves it as it was where both are the same
os.execv(sys.argv[3], sys.argv[3:])
"""
"""Program that starts Chromium with commands on file descriptor 3 and responses on 4."""


class Browser:
    """A browser page. `send` calls a protocol method, `value` evaluates a JavaScript expression, `events` collects
    events.
    """

    def __init__(self, to_browser: int, from_browser: BinaryIO) -> None:
        self._to, self._from = to_browser, from_browser
        self._number, self._session = 0, ""
        self.events: list[dict[str, Any]] = []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method and return its answer."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        os.write(
            self._to, json.dumps(message | ({"sessionId": self._session} if self._session else {})).encode() + b"\0"
        )
        while True:
            said = json.loads(self._message())
            if said.get("id") == self._number:
                assert "error" not in said, (method, said["error"])
                answer: dict[str, Any] = said["result"]
                return answer
            self.events.append(said)

    def _message(self) -> bytes:
        parts = []
        while (byte := self._from.read(1)) not in (b"\0", b""):
            parts.append(byte)
        assert parts, "the browser ended"
        return b"".join(parts)

    def value(self, expression: str) -> Any:
        """Evaluate a JavaScript expression, awaiting a promise, and return the value."""
        told = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def until(self, expression: str, seconds: float = 60.0) -> Any:
        """Evaluate an expression repeatedly until it is true, and return the value."""
        end = time.monotonic() + seconds
        while not (value := self.value(expression)):
            assert time.monotonic() < end, f"{expression} is not true after {seconds:g} s"
        return value

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """Move, press or release the mouse at a position in the window."""
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def sized(self, width: int, height: int, *, is_mobile: bool = False, **media: str) -> None:
        """Resize the window, and set preferences such as `prefers-color-scheme`, with _ for -."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": is_mobile}
        self.send("Emulation.setDeviceMetricsOverride", **size)
        features = [{"name": name.replace("_", "-"), "value": value} for name, value in media.items()]
        self.send("Emulation.setEmulatedMedia", features=features)
        if not is_mobile:  # a telephone lays out a page without a stated width 980 wide
            self.until(f"innerWidth === {width}")

    def named(self, *methods: str) -> list[dict[str, Any]]:
        """Parameters of all events named in `methods`."""
        return [event["params"] for event in self.events if event.get("method") in methods]


@contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """Start a browser with an empty profile, and end it afterwards."""
    assert CHROMIUM
    commands, to_browser = os.pipe()
    from_browser, answers = os.pipe()

    placed = [sys.executable, "-c", _AT_3_AND_4, str(commands), str(answers)]
    process = subprocess.Popen(
        [*placed, CHROMIUM, *_FLAGS, f"--user-data-dir={profile}"],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        pass_fds=(commands, answers), start_new_session=True,
    )  # fmt: skip
    os.close(commands)
    os.close(answers)
    try:
        with os.fdopen(from_browser, "rb") as answered:
            yield Browser(to_browser, answered)
    finally:
        os.close(to_browser)
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(20)

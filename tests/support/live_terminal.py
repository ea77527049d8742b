"""A program in an emulated terminal of any size: screen content, typed keys, and the effect of resizing."""

from __future__ import annotations

import fcntl
import os
import select
import struct
import subprocess
import termios
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pyte
from rich.console import RenderableType
from rich.segment import Segment

from analysis.cli.plain_console import PlainConsole

PATIENCE_S = 90.0
"""Time limit for the screen to show a text. Chosen: a bus scan took more than 40 s on a computer that stalled for
seconds.
"""


class Terminal:
    """A pty with an emulated screen, used in a `with` statement."""

    def __init__(self, command: Sequence[str | Path], width: int, height: int, env: Mapping[str, str]) -> None:
        self.master, self._slave = os.openpty()
        self.screen = pyte.Screen(width, height)
        self._stream = pyte.ByteStream(self.screen)
        self.received = b""
        self.resize(width, height)
        self.before = termios.tcgetattr(self._slave)
        self.process = subprocess.Popen(
            command,
            stdin=self._slave,
            stdout=self._slave,
            stderr=subprocess.PIPE,
            start_new_session=True,
            env={**os.environ, "TERM": "xterm-256color", "LANG": "C.UTF-8", **env},
        )

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()
        os.close(self.master)
        os.close(self._slave)

    def resize(self, width: int, height: int) -> None:
        """Resize the window: content outside is cut off, the rest stays until it is overwritten."""
        self.screen.resize(height, width)
        fcntl.ioctl(self.master, termios.TIOCSWINSZ, struct.pack("HHHH", height, width, 0, 0))

    def type(self, text: str) -> None:
        """Press keys."""
        os.write(self.master, text.encode())

    def read(self, seconds: float) -> None:
        """Read the output that arrives within a time."""
        if select.select([self.master], [], [], seconds)[0]:
            data = os.read(self.master, 1 << 16)
            self.received += data
            self._stream.feed(data)

    def text(self) -> str:
        return "\n".join(self.screen.display)

    def until(self, shown: Callable[[str], bool], why: str = "") -> str:
        """Wait until the text of the screen fulfils a condition, and return the text."""
        end_s = time.monotonic() + PATIENCE_S
        while not shown(self.text()):
            assert time.monotonic() < end_s, f"{why}\n{self.text()}"
            self.read(0.2)
        return self.text()

    def ended(self) -> int:
        """Wait for the program to end and return its exit code. stderr is not read."""
        end_s = time.monotonic() + PATIENCE_S
        while self.process.poll() is None:
            assert time.monotonic() < end_s, self.text()
            self.read(0.1)
        while select.select([self.master], [], [], 0)[0]:  # written between the last reading and the end
            self.read(0)
        return self.process.returncode

    def is_as_before(self) -> bool:
        """True if the terminal settings are the same as before the program ran."""
        return termios.tcgetattr(self._slave) == self.before


def screen_of(picture: RenderableType, width: int, height: int) -> list[list[Segment]]:
    """The rows of a picture on a terminal of this size."""
    console = PlainConsole()
    return console.render_lines(picture, console.options.update_dimensions(width, height), pad=False)


def lines_of(picture: RenderableType, width: int, height: int) -> list[str]:
    return ["".join(segment.text for segment in row) for row in screen_of(picture, width, height)]

"""Access to the terminal: size, alternate screen with flicker-free drawing, and keys.

Only changed rows are sent, to save bandwidth over ssh. Systems without POSIX terminals have no keys, and Ctrl-C ends
the program.
"""

from __future__ import annotations

import os
import re
import select
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import TextIO

from analysis.apps.live.canvas import Canvas
from analysis.cli.plain_console import PlainConsole

_ENTER = "\x1b[?1049h\x1b[?25l\x1b[?7l"
"""Enter the alternate screen, hide the cursor and disable wrapping (xterm control sequences)."""
_LEAVE = "\x1b[?7h\x1b[?25h\x1b[?1049l"
_BEGIN, _END = "\x1b[?2026h", "\x1b[?2026l"
"""Synchronised output of a picture to avoid partial display. Terminals that do not support it ignore it."""
_CLEAR = "\x1b[0m\x1b[2J"
_FALLBACK = (80, 24)
_NO_CHARACTER = re.compile(r"\x1b(\[[0-?]*[ -/]*[@-~]|O.)")
"""Sequences of arrow and similar keys: control sequences of ECMA-48, section 5.4, and of the keypad."""


class Painter:
    """Draws canvases and sends only the differences."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._shown: list[str] = []
        self._size = (0, 0)

    def __enter__(self) -> Painter:
        self._out.write(_ENTER)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError):
            self._out.write(_LEAVE)
            self._out.flush()

    def paint(self, canvas: Canvas) -> None:
        """Send the changes since the last canvas."""
        console = PlainConsole(width=canvas.width)
        with console.capture() as captured:
            console.print(canvas, end="", crop=False, soft_wrap=True)
        lines = captured.get().split("\n")
        size = (canvas.width, canvas.height)
        changed = range(len(lines))
        cleared = size != self._size
        if not cleared:
            changed = [row for row in changed if lines[row] != self._shown[row]]  # type: ignore[assignment]
        if cleared or changed:
            rows = "".join(f"\x1b[{row + 1};1H{lines[row]}" for row in changed)
            self._out.write(_BEGIN + _CLEAR * cleared + rows + _END)
            self._out.flush()
        self._shown, self._size = lines, size

    def invalidate_screen(self) -> None:
        """Send the entire screen next time."""
        self._size = (0, 0)


def size_of(out: TextIO) -> tuple[int, int]:
    try:
        size = os.get_terminal_size(out.fileno())
    except (OSError, ValueError):
        return _FALLBACK
    return (size.columns, size.lines) if size.columns and size.lines else _FALLBACK


class Keys:
    """Keys of a terminal in unbuffered mode; None: no terminal."""

    def __init__(self, descriptor: int | None) -> None:
        self._descriptor = descriptor

    def read_keys(self, seconds: float) -> list[str]:
        """Keys typed within a time. Arrow and similar keys are ignored."""
        if self._descriptor is None:
            time.sleep(seconds)
            return []
        if not select.select([self._descriptor], [], [], seconds)[0]:
            return []
        typed = os.read(self._descriptor, 1024)
        if not typed:  # the terminal is closed
            raise KeyboardInterrupt
        return list(_NO_CHARACTER.sub("", typed.decode("utf-8", "ignore")))


@contextmanager
def keys_of(terminal: TextIO) -> Iterator[Keys]:
    """Provide the keys of a terminal and restore it afterwards."""
    try:
        import termios  # noqa: PLC0415 - Windows lacks it
        import tty  # noqa: PLC0415
    except ModuleNotFoundError:
        yield Keys(None)
        return
    if not terminal.isatty():
        yield Keys(None)
        return
    descriptor = terminal.fileno()
    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor)
        attributes = termios.tcgetattr(descriptor)
        attributes[6][termios.VSUSP] = b"\0"  # Ctrl-Z would leave this screen in the shell
        termios.tcsetattr(descriptor, termios.TCSADRAIN, attributes)
        yield Keys(descriptor)
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def is_terminal() -> bool:
    return sys.stdout.isatty() and os.environ.get("TERM") != "dumb"

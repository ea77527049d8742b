"""The picture and the keys of a terminal. Without POSIX terminals there are no keys, and Ctrl-C ends the program."""

from __future__ import annotations

import os
import re
import select
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console, ConsoleDimensions, RenderableType
from rich.segment import Segment

_NO_CHARACTER = re.compile(r"\x1b(\[[0-?]*[ -/]*[@-~]|O.)")
"""Sequences of arrow and similar keys: control sequences of ECMA-48, section 5.4, and of the keypad."""


class ChangingPicture:
    """A picture on the whole screen of a console. Only changed rows are sent, to save bandwidth over ssh."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._size = ConsoleDimensions(0, 0)
        self._shown: dict[int, list[Segment]] = {}

    def show(self, picture: RenderableType) -> None:
        size = self._console.size
        rows = self._console.render_lines(picture, self._console.options.update_dimensions(*size))
        if size != self._size:
            self._shown = {}
        with self._console:  # sends all rows together
            for number, row in enumerate(rows):
                if row != self._shown.get(number):
                    self._console.update_screen_lines([row], y=number)
        self._size, self._shown = size, dict(enumerate(rows))

    def redraw(self) -> None:
        """Send the whole picture next time."""
        self._shown = {}


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

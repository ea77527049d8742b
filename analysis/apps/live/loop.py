"""Main loop of `rig live`: data to the view, the view to the terminal, and keys to the controls."""

from __future__ import annotations

import json
import os
import re
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from types import FrameType
from typing import Protocol, TextIO

from rich.console import Console, ConsoleDimensions, RenderableType
from rich.segment import Segment

from analysis.apps.live.controls import Action, LiveControls
from analysis.apps.live.figures import figures, plain_line
from analysis.apps.live.screen import LiveScreen
from analysis.apps.live.view import LiveView, Update
from analysis.cli.plain_console import PlainConsole

_TICK_S = 0.1
_LINE_S = 1.0


class LiveSource(Protocol):
    def updates(self) -> Sequence[Update]: ...
    def handle_action(self, action: Action) -> str:
        """Execute the action of a key, and give a notice."""

    @property
    def ended(self) -> bool: ...


def watch(source: LiveSource, view: LiveView, zero_mm: tuple[float, float] = (0.0, 0.0)) -> None:
    controls = LiveControls(zero_mm=zero_mm)
    console = PlainConsole(follows_window=True)
    shown = ChangingPicture(console)
    with _ends_in_order(), suppress(KeyboardInterrupt), keys_of(sys.stdin) as keys, console.screen():
        while True:
            before, (view, notice) = view, _advanced(view, source)
            controls = controls.with_notice(notice, before, view)
            shown.show(LiveScreen(view, controls))
            for key in keys.read_keys(_TICK_S):
                controls, action = controls.pressed(key, view.readings)
                match action:
                    case "quit":
                        return
                    case "restart":
                        view = view.restarted()
                    case "redraw":
                        shown.redraw()
                    case None:
                        pass
                    case _:
                        controls = replace(controls, message=source.handle_action(action))


def print_lines(source: LiveSource, view: LiveView, say: Callable[[str], None], *, as_json: bool) -> None:
    controls = LiveControls()
    with suppress(KeyboardInterrupt):
        while True:
            view, _ = _advanced(view, source)
            if view.cell is not None or view.lost:  # the daemon has responded, or cannot
                say(json.dumps(figures(view)) if as_json else plain_line(view, controls.units))
                sys.stdout.flush()
            if source.ended:
                return
            time.sleep(_LINE_S)


def _advanced(view: LiveView, source: LiveSource) -> tuple[LiveView, str]:
    notice = ""
    for update in source.updates():
        view, notice = view.after(update), update.notice or notice
    return view, notice


@contextmanager
def _ends_in_order() -> Iterator[None]:
    def end(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = {
        number: signal.signal(number, end)
        for number in [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


# ----------------------------------------------------------------------------------------------------------------------
# The terminal. Without POSIX there are no keys, and Ctrl-C ends the program.

_NO_CHARACTER = re.compile(r"\x1b(\[[0-?]*[ -/]*[@-~]|O.)")
"""Sequences of arrow and similar keys (ECMA-48, section 5.4, and the keypad)."""


class ChangingPicture:
    """Picture on the whole screen; only changed rows are sent, to save bandwidth over ssh."""

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

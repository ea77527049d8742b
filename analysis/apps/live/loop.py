"""Main loop of `rig live`: data to the view, the view to the terminal, and keys to the controls."""

from __future__ import annotations

import json
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from types import FrameType
from typing import Protocol

from analysis.apps.live.controls import Action, LiveControls
from analysis.apps.live.figures import figures, plain_line
from analysis.apps.live.played_run import SPEEDS, PlayedRun
from analysis.apps.live.screen import LiveScreen
from analysis.apps.live.terminal import ChangingPicture, keys_of
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


class RunPlayer:
    """Recorded runs played in real time, in sequence."""

    def __init__(self, runs: Sequence[PlayedRun], clock: Callable[[], float] = time.monotonic) -> None:
        self._run, *self._next = runs
        self._clock = clock
        self._at_s = clock()

    @property
    def ended(self) -> bool:
        return self._run.ended and not self._next

    def updates(self) -> Sequence[Update]:
        now_s = self._clock()
        begun: list[Update] = []
        if self._run.ended and self._next:
            self._run, update = self._run.followed_by(self._next.pop(0))
            begun = [update]
        self._run, update = self._run.after(now_s - self._at_s)
        self._at_s = now_s
        return [*begun, update]

    def handle_action(self, action: Action) -> str:
        match action:
            case "pause":
                self._run = replace(self._run, paused=not self._run.paused)
            case "faster" | "slower":
                speed = self._run.speed * (2.0 if action == "faster" else 0.5)
                self._run = replace(self._run, speed=min(max(speed, SPEEDS[0]), SPEEDS[1]))
            case _:
                return "a played run cannot be recorded"
        return ""


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
    """Print a line each second until the end or Ctrl-C."""
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
    """Restore the terminal even if a signal ends the program."""

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

"""Main loop of `rig live`: moves data to the view, the view to the terminal, and keys to the controls."""

from __future__ import annotations

import json
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from types import FrameType
from typing import TYPE_CHECKING, Protocol

from analysis.apps.live.controls import Action, Controls, Pause, Quit, Redraw, Restart, Speed, Start, Stop
from analysis.apps.live.figures import figures, plain_line
from analysis.apps.live.played_run import PlayedRun
from analysis.apps.live.screen import screen
from analysis.apps.live.terminal import Painter, keys_of, size_of
from analysis.apps.live.view import LiveView, Update

if TYPE_CHECKING:
    from analysis.apps.live.daemon_source import DaemonSource

_TICK_S = 0.1
_LINE_S = 1.0


class Source(Protocol):
    """Source of updates and receiver of user actions."""

    def updates(self) -> Sequence[Update]:
        """Return the updates since the last call."""

    def done(self, action: Action) -> str:
        """Execute the action of a key and return a notice."""

    @property
    def ended(self) -> bool:
        """True if the data has ended."""


class DaemonPlayer:
    """A running daemon as a source."""

    ended = False

    def __init__(self, source: DaemonSource) -> None:
        self._source = source

    def updates(self) -> Sequence[Update]:
        """Return the updates since the last call."""
        return self._source.updates()

    def done(self, action: Action) -> str:
        """Start or stop a recording. The response follows as a notice."""
        match action:
            case Start(label):
                self._source.request("record_start", action.request(), lambda answer: f"recording to {answer['run']}")
                return f"starting {label}"
            case Stop():
                self._source.request("record_stop", {}, lambda answer: f"ended: {answer['run']}")
                return "ending the recording"
            case Pause() | Speed():
                return "only played runs can be paused: rig live --run RUN"
        return ""


class RunPlayer:
    """Recorded runs played in real time, in sequence."""

    def __init__(self, runs: Sequence[PlayedRun], clock: Callable[[], float] = time.monotonic) -> None:
        self._run, *self._next = runs
        self._clock = clock
        self._at_s = clock()

    @property
    def ended(self) -> bool:
        """True if all runs have been shown."""
        return self._run.ended and not self._next

    def updates(self) -> Sequence[Update]:
        """Return the updates since the last call."""
        now_s = self._clock()
        begun: list[Update] = []
        if self._run.ended and self._next:
            self._run, update = self._run.followed_by(self._next.pop(0))
            begun = [update]
        self._run, update = self._run.after(now_s - self._at_s)
        self._at_s = now_s
        return [*begun, update]

    def done(self, action: Action) -> str:
        """Pause, continue or change the speed."""
        match action:
            case Pause():
                self._run = replace(self._run, paused=not self._run.paused)
            case Speed(factor):
                self._run = self._run.sped(factor)
            case Start() | Stop():
                return "a played run cannot be recorded"
        return ""


def watch(source: Source, view: LiveView, zero_mm: tuple[float, float] = (0.0, 0.0)) -> None:
    """Show a source on the terminal, relative to the zeros of the gauges, until the user quits."""
    controls = Controls(zero_mm=zero_mm)
    with _ends_in_order(), suppress(KeyboardInterrupt), keys_of(sys.stdin) as keys, Painter(sys.stdout) as painter:
        while True:
            before, (view, notice) = view, _advanced(view, source)
            controls = controls.told(notice, before, view)
            painter.paint(screen(view, controls, *size_of(sys.stdout)))
            for key in keys.within(_TICK_S):
                controls, action = controls.pressed(key, view.readings)
                match action:
                    case Quit():
                        return
                    case Restart():
                        view = view.restarted()
                    case Redraw():
                        painter.forget()
                    case None:
                        pass
                    case _:
                        controls = replace(controls, message=source.done(action))


def print_lines(source: Source, view: LiveView, say: Callable[[str], None], *, as_json: bool) -> None:
    """Print a line each second until the source ends or the user interrupts."""
    controls = Controls()
    with suppress(KeyboardInterrupt):
        while True:
            view, _ = _advanced(view, source)
            if view.cell is not None or view.lost:  # the daemon has responded, or cannot
                say(json.dumps(figures(view)) if as_json else plain_line(view, controls.units))
                sys.stdout.flush()
            if source.ended:
                return
            time.sleep(_LINE_S)


def _advanced(view: LiveView, source: Source) -> tuple[LiveView, str]:
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

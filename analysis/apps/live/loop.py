"""Main loop of `rig live`: data to the view, and the view to the terminal or to lines."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Protocol

from rich.live import Live

from analysis.apps.live.figures import figures, plain_line
from analysis.apps.live.screen import LiveScreen
from analysis.apps.live.view import LiveView, Update
from analysis.cli.plain_console import PlainConsole

_TICK_S = 0.2
_LINE_S = 1.0


class LiveSource(Protocol):
    def updates(self) -> Sequence[Update]: ...

    @property
    def ended(self) -> bool: ...


def watch(source: LiveSource, view: LiveView, zero_mm: tuple[float, float] = (0.0, 0.0)) -> None:
    console = PlainConsole(follows_window=True)
    with _ends_in_order(), suppress(KeyboardInterrupt), Live(console=console, screen=True, auto_refresh=False) as live:
        while True:
            view = _advanced(view, source)
            live.update(LiveScreen(view, zero_mm), refresh=True)
            time.sleep(_TICK_S)


def print_lines(source: LiveSource, view: LiveView, say: Callable[[str], None], *, as_json: bool) -> None:
    with suppress(KeyboardInterrupt):
        while True:
            view = _advanced(view, source)
            if view.cell is not None or view.lost:  # the daemon has responded, or cannot
                say(json.dumps(figures(view)) if as_json else plain_line(view))
                sys.stdout.flush()
            if source.ended:
                return
            time.sleep(_LINE_S)


def _advanced(view: LiveView, source: LiveSource) -> LiveView:
    for update in source.updates():
        view = view.after(update)
    return view


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


def is_terminal() -> bool:
    return sys.stdout.isatty() and os.environ.get("TERM") != "dumb"

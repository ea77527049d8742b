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
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Protocol, TextIO

import numpy as np
from rich.console import Console, ConsoleDimensions, RenderableType
from rich.segment import Segment

from analysis.apps.live.controls import Action, LiveControls
from analysis.apps.live.figures import figures, plain_line
from analysis.apps.live.live_rows import LiveCell, LiveRows, cell_of
from analysis.apps.live.screen import LiveScreen
from analysis.apps.live.view import GaugeReading, LiveView, Played, Update
from analysis.cli.plain_console import PlainConsole
from analysis.runs.align import align
from analysis.runs.tables import CircleTable, table_from
from daq.store import read_run
from rigs.errors import FileError
from rigs.load import parse
from rigs.schema.vocabulary import Direction, TestName

_TICK_S = 0.1
_LINE_S = 1.0


class LiveSource(Protocol):
    def updates(self) -> Sequence[Update]: ...
    def handle_action(self, action: Action) -> str:
        """Execute the action of a key, and give a notice."""

    @property
    def ended(self) -> bool: ...


class RunPlayer:
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


_MOST_HZ = 100.0
"""Rows shown per second. A screen shows ten."""
_BETWEEN_S = 1.0
"""Pause between two runs in the view."""
SPEEDS = (0.125, 64.0)
"""Slowest and fastest playback."""


@dataclass(frozen=True)
class PlayedRun:
    name: str
    test: TestName
    direction: Direction | None
    cell: LiveCell
    rig_sha256: str
    rows: LiveRows
    speed: float
    zero_mm: tuple[float, float] = (0.0, 0.0)
    begins_s: float = 0.0
    at_s: float = 0.0
    shown: int = 0
    paused: bool = False

    @property
    def ended(self) -> bool:
        return self.shown >= len(self.rows)

    def followed_by(self, following: PlayedRun) -> tuple[PlayedRun, Update]:
        """Switch to another run at the same time, speed and pause."""
        begins_s = self.begins_s + float(self.rows.t_s[-1]) + _BETWEEN_S
        cell = following.cell if following.rig_sha256 != self.rig_sha256 else None
        begun = Update(cell=cell, label=(following.name, following.test, following.direction))
        return replace(following, begins_s=begins_s, speed=self.speed, paused=self.paused), begun

    def begun(self) -> LiveView:
        return LiveView(self.cell).labelled(self.name, self.test, self.direction)

    def after(self, seconds: float) -> tuple[PlayedRun, Update]:
        at_s = self.at_s if self.paused or self.ended else self.at_s + self.speed * seconds
        until = int(np.searchsorted(self.rows.t_s, at_s, side="right"))
        at_s = min(at_s, float(self.rows.t_s[-1]))
        new = self.rows.select_rows(slice(self.shown, until))
        new = replace(new, t_s=new.t_s + self.begins_s)
        run = replace(self, at_s=at_s, shown=max(until, self.shown))
        played = Played(self.name, at_s, float(self.rows.t_s[-1]), self.speed, self.paused, run.ended)
        last = self.rows.g_mm[run.shown - 1] if run.shown else ()
        readings = {f"g{k}": GaugeReading(float(mm), 0.0) for k, mm in enumerate(last, start=1) if np.isfinite(mm)}
        return run, Update(rows=new, readings=readings, played=played)


def played_run(path: Path, speed: float) -> PlayedRun:
    run = read_run(path)
    rig = parse(run.manifest.rig_text, f"{path}, rig file")
    if run.table is None:
        aligned = align(path, run.streams, run.manifest.test, rig)
        t_s, q, readings = aligned.t_s, aligned.q, aligned.g_mm
    else:
        table = table_from(run.table, run.manifest.test, run.manifest.direction, str(path))
        if not isinstance(table, CircleTable):
            problem = f"is a {run.manifest.test} table, which has targets but no motion"
            raise FileError(str(path), problem, "give a circle run, or a run recorded by rigd", code="run.no_motion")
        t_s, q, readings = table.t_s, table.q, table.g_mm
    g_mm = np.full((len(readings), 2), np.nan)  # nan for an unused gauge
    g_mm[:, : readings.shape[1]] = readings
    rows = LiveRows(t_s, g_mm, q)
    step = max(1, int(np.ceil(len(rows) / max(float(np.ptp(rows.t_s)), 1e-9) / _MOST_HZ)))
    rows = rows.select_rows(slice(None, None, step))
    rows = replace(rows, t_s=rows.t_s - rows.t_s[0])
    manifest, cell = run.manifest, cell_of(rig)
    return PlayedRun(
        manifest.name, manifest.test, manifest.direction, cell, manifest.rig_sha256, rows, speed,
        manifest.view_zero_mm or (0.0, 0.0),
    )  # fmt: skip

"""Playback of recorded runs, aligned as in `rig analyse`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.apps.live.live_rows import LiveCell, LiveRows, cell_of
from analysis.apps.live.view import GaugeReading, LiveView, Played, Update
from analysis.runs.align import align
from analysis.runs.tables import CircleTable, table_from
from daq.store import read_run
from rigs.errors import FileError
from rigs.load import parse
from rigs.schema.vocabulary import Direction, TestName

_MOST_HZ = 100.0
"""Rows shown per second. A screen shows ten."""
_BETWEEN_S = 1.0
"""Pause between two runs in the view."""


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

    @property
    def ended(self) -> bool:
        return self.shown >= len(self.rows)

    def followed_by(self, following: PlayedRun) -> tuple[PlayedRun, Update]:
        begins_s = self.begins_s + float(self.rows.t_s[-1]) + _BETWEEN_S
        cell = following.cell if following.rig_sha256 != self.rig_sha256 else None
        begun = Update(cell=cell, label=(following.name, following.test, following.direction))
        return replace(following, begins_s=begins_s, speed=self.speed), begun

    def begun(self) -> LiveView:
        return LiveView(self.cell).labelled(self.name, self.test, self.direction)

    def after(self, seconds: float) -> tuple[PlayedRun, Update]:
        at_s = self.at_s if self.ended else self.at_s + self.speed * seconds
        until = int(np.searchsorted(self.rows.t_s, at_s, side="right"))
        at_s = min(at_s, float(self.rows.t_s[-1]))
        new = self.rows.select_rows(slice(self.shown, until))
        new = replace(new, t_s=new.t_s + self.begins_s)
        run = replace(self, at_s=at_s, shown=max(until, self.shown))
        played = Played(self.name, at_s, float(self.rows.t_s[-1]), self.speed, run.ended)
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
            raise FileError(
                str(path), problem, "give a circle run, or a run recorded by rigd", code="readings.unsuitable"
            )
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

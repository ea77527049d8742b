"""Polls a daemon ten times a second in a thread, so that keys and screen never wait, also while it is lost.

Responses are limited in size (`daq.service.daemon`), so the readers hardly notice.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from analysis.apps.live.live_rows import GAUGES, NO_TRACKS, ROBOT, Joiner, LiveTrack, cell_of
from analysis.apps.live.view import GaugeReading, Update
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import joint_columns
from daq.service.client import Client
from rigs.errors import CellError, RigError
from rigs.load import parse
from rigs.schema.vocabulary import FURTHER

_ASK_S, _STATE_S = 0.1, 0.5
_RETRY_S = 0.5
_MOST_WAITING = 100
"""Queued updates while the screen is blocked."""
_JOINTS = joint_columns(6)


class Asking:
    def __init__(self, client: Client, rig_lines: list[str] | None = None, signs: Sequence[int] = (1, 1)) -> None:
        """rig_lines, signs: rig file and signs of the gauges of the previous connection, reused if equal."""
        self._client, self.rig_lines, self.signs = client, rig_lines, signs
        self._after: dict[str, int] = {}
        self._joiner: Joiner = NO_TRACKS
        self._further: dict[str, tuple[float, float]] = {}
        """Time in s and reading in mm of the last sample of each additional gauge."""
        self._knows_rig = False
        self._state_due_s = 0.0

    def update(self, now_s: float) -> Update:
        answer = self._client.ask("samples", after=self._after, rig=not self._knows_rig)
        self._after = {name: stream["newest"] for name, stream in answer["streams"].items()}
        cell, notice = None, ""
        if not self._knows_rig and answer["rig_lines"] != self.rig_lines:
            try:
                cell = cell_of(parse("\n".join(answer["rig_lines"]), "the rig file of rigd"))
            except RigError as error:
                notice = f"circle and angle are not available: {error}"
            self.rig_lines, self.signs = answer["rig_lines"], cell.signs if cell else (1, 1)
        self._knows_rig = True
        state = None
        if now_s >= self._state_due_s:
            state, self._state_due_s = self._client.ask("status"), now_s + _STATE_S
        self._joiner, rows = self._joiner.joined(tracks_of(answer["streams"], self.signs))
        now_ns = answer["now_ns"]
        readings = {
            name: GaugeReading(float(track.values[-1, 0]), max(0.0, now_ns / 1e9 - float(track.t_s[-1])))
            for name, track in self._joiner.tracks.items()
            if name in GAUGES
        }
        # Additional gauges show the last reading; rows do not wait for them.
        for stream in answer["streams"].values():
            for place, column in enumerate(stream["columns"], start=1):
                name = column.removesuffix("_mm")
                last = next((row for row in reversed(stream["rows"]) if row[place] is not None), None)
                if name in FURTHER and last is not None and np.isfinite(last[place]):
                    self._further[name] = (last[0] / 1e9, float(last[place]))
        readings |= {name: GaugeReading(mm, max(0.0, now_ns / 1e9 - t_s)) for name, (t_s, mm) in self._further.items()}
        return Update(rows=rows, readings=readings, state=state, cell=cell, notice=notice)


class DaemonSource:
    ended = False

    def __init__(self, socket: Path | Callable[[], Path]) -> None:
        """socket: path of the socket, or a function that returns it or raises CellError."""
        self._find = socket if callable(socket) else lambda: socket
        self._updates: SimpleQueue[Update] = SimpleQueue()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._ask, name="ask rigd", daemon=True)
        self._heard_s = time.monotonic()

    def __enter__(self) -> DaemonSource:
        with Client(self._find()):
            pass
        return self.begun()

    def __exit__(self, *_: object) -> None:
        self.end()

    def begun(self) -> DaemonSource:
        """Start polling, even before the daemon responds."""
        self._thread.start()
        return self

    def end(self) -> None:
        self._ended.set()

    def updates(self) -> list[Update]:
        """Data since the last call, or a report of some seconds of silence."""
        updates: list[Update] = []
        with suppress(Empty):
            while True:
                updates.append(self._updates.get_nowait())
        now_s = time.monotonic()
        if updates:
            self._heard_s = now_s
        elif now_s - self._heard_s > 2.0:
            return [Update(lost=f"rigd has not answered for {now_s - self._heard_s:.0f} s")]
        return updates

    def _ask(self) -> None:
        rig_lines: list[str] | None = None
        signs: Sequence[int] = (1, 1)
        while not self._ended.is_set():
            try:
                with Client(self._find()) as client:
                    asking = Asking(client, rig_lines, signs)
                    while not self._ended.wait(_ASK_S):
                        if self._updates.qsize() > _MOST_WAITING:  # the terminal is blocked, for example by Ctrl-S
                            continue
                        self._updates.put(asking.update(time.monotonic()))
                        rig_lines, signs = asking.rig_lines, asking.signs
            except CellError as error:
                self._updates.put(Update(lost=f"waiting for rigd: {error.what}"))
            except RigError as error:
                self._updates.put(Update(lost=f"{error.what}: this rigd is older than rig live; restart rigd"))
            self._ended.wait(_RETRY_S)


def tracks_of(streams: Mapping[str, Any], signs: Sequence[int] = (1, 1)) -> dict[str, LiveTrack]:
    """Samples of a `samples` response by instrument, in mm and rad. signs: of the readings of each gauge."""
    tracks = {}
    for stream in streams.values():
        if not stream["rows"]:
            continue
        values = np.array(stream["rows"], dtype=float)
        columns = dict(zip(stream["columns"], values.T[1:], strict=True))
        for name, sign in zip(GAUGES, signs, strict=False):
            if f"{name}_mm" in columns:
                tracks[name] = _track(values[:, 0], sign * columns[f"{name}_mm"][:, None])
        if all(joint in columns for joint in _JOINTS):
            tracks[ROBOT] = _track(values[:, 0], np.radians(np.stack([columns[joint] for joint in _JOINTS], axis=1)))
    return {name: track for name, track in tracks.items() if len(track.t_s)}


def _track(t_ns: Array, values: Array) -> LiveTrack:
    complete = np.isfinite(values).all(axis=1)
    return LiveTrack(t_ns[complete] / 1e9, values[complete])

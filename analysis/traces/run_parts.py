"""The streams of a long run part by part: rows of all of them that came in the same time, in memory of a few chunks.

A part is evaluated like a run of its own. What is seen only from before and after, as whether an instrument waited or a
computer was held up for a second, is seen of the rows near its ends as well: a part has some seconds more on either
side, which belong to its neighbours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.traces.clocks import Columns
from daq.store import Manifest, chunks_of
from rigs.errors import FileError

_ROWS = 300_000
"""Rows of gauge 1 in a part: 75 s at 4 kHz, over which a clock is a straight line (`lower_hull.WINDOW_S`)."""
_MARGIN_NS = 6e9
"""What a part has of its neighbours. `steady_pace` sees within four seconds whether lateness stays."""


@dataclass(frozen=True)
class Part:
    """The rows of some streams that came in [begin_ns, end_ns), and those of a few seconds before and after."""

    streams: dict[str, Columns]
    begin_ns: float
    end_ns: float


def rows_of_gauge(manifest: Manifest) -> int:
    """How many rows gauge 1 has in a recorded run; 0 where it has none."""
    first = _stream_of(manifest, "g1_mm")
    return sum(chunk.rows for chunk in manifest.chunks_of(first)) if first else 0


def is_long(manifest: Manifest) -> bool:
    """Whether a recorded run has more rows than one part."""
    return rows_of_gauge(manifest) > _ROWS


def parts_of(path: Path, manifest: Manifest) -> Iterator[Part]:
    """The streams of gauges and robot, part by part, in order of time.

    Raises FileError for a chunk that is missing or damaged, and where stamps go back: such a run is refused as a whole.
    """
    read = {
        name: _Window(path, chunks_of(path, manifest, name))
        for name, columns in manifest.streams.items()
        if {"g1_mm", "g2_mm", "q1_deg"} & set(columns)
    }
    first, begin_ns = read[_stream_of(manifest, "g1_mm")], -math.inf
    while begin_ns < math.inf:
        end_ns = first.time_after(begin_ns, _ROWS)
        streams = {name: window.between(begin_ns - _MARGIN_NS, end_ns + _MARGIN_NS) for name, window in read.items()}
        yield Part(streams, begin_ns, end_ns)
        begin_ns = end_ns


def _stream_of(manifest: Manifest, column: str) -> str:
    return next((name for name, columns in manifest.streams.items() if column in columns), "")


class _Window:
    """The rows of a stream in a stretch of time that moves on."""

    def __init__(self, path: Path, chunks: Iterator[Columns]) -> None:
        self._path = path
        self._chunks = chunks
        self._kept: list[Columns] = []

    def between(self, begin_ns: float, end_ns: float) -> Columns:
        """The rows that came in [begin_ns, end_ns), and no earlier than those of the call before."""
        while self._last_ns() < end_ns and self._reads_on():
            pass
        self._kept = [chunk for chunk in self._kept[:-1] if chunk["last_byte_ns"][-1] >= begin_ns] + self._kept[-1:]
        pieces = []
        for chunk in self._kept:
            rows = slice(*np.searchsorted(chunk["last_byte_ns"], (begin_ns, end_ns), side="left"))
            if rows.start < rows.stop:
                pieces.append({name: column[rows] for name, column in chunk.items()})
        return {name: _joined([piece[name] for piece in pieces]) for name in (pieces[0] if pieces else ())}

    def time_after(self, begin_ns: float, rows: int) -> float:
        """When the row came that is so many behind the first from begin_ns on; inf where hardly half as many more are
        left from there."""
        most = rows + rows // 2
        while True:
            came_ns = [chunk["last_byte_ns"] for chunk in self._kept]
            first = [int(np.searchsorted(stamps, begin_ns, side="left")) for stamps in came_ns]
            if sum(len(stamps) for stamps in came_ns) - sum(first) > most:
                return float(np.concatenate([stamps[k:] for stamps, k in zip(came_ns, first, strict=True)])[rows])
            if not self._reads_on():
                return math.inf

    def _last_ns(self) -> float:
        return float(self._kept[-1]["last_byte_ns"][-1]) if self._kept else -math.inf

    def _reads_on(self) -> bool:
        """Read the next chunk, if there is any."""
        chunk = next(self._chunks, None)
        if chunk is None:
            return False
        stamps = chunk["last_byte_ns"]
        if len(stamps):
            if stamps[0] < self._last_ns() or not (stamps[1:] >= stamps[:-1]).all():
                raise FileError(str(self._path), "has stamps that go back", "restore the run from a copy")
            self._kept.append(chunk)
        return True


def _joined(pieces: list[NDArray[Any]]) -> NDArray[Any]:
    """The pieces of a column as one; of those that hold one value a view of it, as `daq.store` reads them."""
    first = pieces[0]
    if all(piece.strides == (0,) and piece[:1].tobytes() == first[:1].tobytes() for piece in pieces):
        return np.broadcast_to(first[0], (sum(len(piece) for piece in pieces),))
    return np.concatenate(pieces)

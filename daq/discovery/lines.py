"""What a controller's program prints, guessed from some of its lines: separator, clock, six angles.

Only what the numbers show is taken: a column that grows at the host's own pace is the clock. Whether angles are
degrees or radians shows only where one is larger than a turn in radians; otherwise a person is asked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from daq.protocol.conversation import Arrival
from daq.protocol.framing import Lines, Message
from daq.protocol.numerals import number

_SEPARATORS = (",", ";", " ")
_FEWEST_LINES = 5
_CLOCKS = {"t_s": 1.0, "t_ms": 1e3, "t_us": 1e6}
_PACE = 0.25
"""How far, as a share, a clock's pace may be from the host's in half a second of lines."""


@dataclass(frozen=True)
class Layout:
    """The layout of a line: `fields` and `separator` as a rig file has them; sure: whether the unit is certain."""

    fields: tuple[str, ...]
    separator: str
    sure: bool


def layout_of(arrivals: Sequence[Arrival]) -> Layout | None:
    """Return the layout of the lines in what arrived; None where they are not lines of at least six numbers."""
    frames = Lines(b"\n", joined_midway=True)
    lines = [
        (message.data.decode("ascii", "replace").strip(), message.last_byte_ns / 1e9)
        for data, at_ns in arrivals
        for message in frames.feed(data, at_ns)
        if isinstance(message, Message)
    ]
    for separator in _SEPARATORS:
        rows = [[number(part.strip()) for part in _split(text, separator)] for text, _ in lines]
        if len(rows) >= _FEWEST_LINES and len(rows[0]) >= 6 and len({len(row) for row in rows}) == 1:
            columns = [list(column) for column in zip(*rows, strict=True)]
            return _layout(columns, [at_s for _, at_s in lines], separator)
    return None


def _split(text: str, separator: str) -> list[str]:
    return text.split(None if separator == " " else separator)


def _layout(columns: list[list[float | None]], at_s: list[float], separator: str) -> Layout | None:
    clocks = {place: name for place, column in enumerate(columns) if (name := _clock(column, at_s))}
    clock = next(iter(clocks), None)
    numbers = [
        place for place, column in enumerate(columns) if place != clock and all(value is not None for value in column)
    ]
    if len(numbers) < 6:
        return None
    joints = numbers[:6]
    largest = max(abs(value) for place in joints for value in columns[place] if value is not None)
    names = {place: f"q{axis}_deg" for axis, place in enumerate(joints, 1)}
    if clock is not None:
        names[clock] = clocks[clock]
    fields = tuple(names.get(place, "_") for place in range(len(columns)))
    return Layout(fields, separator, largest > 2 * math.pi)


def _clock(column: list[float | None], at_s: list[float]) -> str | None:
    """The name of the clock that a column is, by how it keeps pace with the host's."""
    lasted_s = at_s[-1] - at_s[0]
    values = [value for value in column if value is not None]
    rises = len(values) == len(column) and all(b >= a for a, b in pairwise(values))
    if not rises or lasted_s <= 0:
        return None
    pace = (values[-1] - values[0]) / lasted_s
    return next((name for name, rate in _CLOCKS.items() if abs(pace / rate - 1) < _PACE), None)

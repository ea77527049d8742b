"""The streams of a rig: one for each link, with the columns that its samples fill."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from daq import feedback, gauges
from daq.protocol.conversation import Conversation
from rigs.links import Line
from rigs.rig import Rig

ROBOT = "robot"
JOINTS = tuple(f"q{axis}_deg" for axis in range(1, 7))
_NO_LINE = Line(baud=9600, bits=8, parity="N", stop=1)
"""Robots are reached over TCP, which has no line settings."""


@dataclass(frozen=True)
class Stream:
    """One link: what it is called, where it is, what its samples hold, and who speaks on it."""

    name: str
    columns: tuple[str, ...]
    port: str
    line: Line
    host: Callable[[], Conversation]


def gauge_groups(rig: Rig) -> list[tuple[str, ...]]:
    """Names of the gauges, those on one port together."""
    by_port: dict[str, list[str]] = {}
    for name, gauge in rig.gauges:
        by_port.setdefault(gauge.port, []).append(name)
    return [tuple(names) for names in by_port.values()]


def streams_of(rig: Rig) -> list[Stream]:
    """All streams of a rig, the robot last."""
    members = dict(rig.gauges)
    found = []
    for names in gauge_groups(rig):
        group = [members[name] for name in names]
        columns = tuple(f"{name}_mm" for name in names)
        found.append(Stream("_".join(names), columns, group[0].port, group[0].line, partial(gauges.host, group)))
    robot = rig.feedback
    found.append(Stream(ROBOT, JOINTS, robot.port, _NO_LINE, partial(feedback.host, robot)))
    return found

"""Streams of a rig: one per link, with the columns of the samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from daq import feedback, gauges
from daq.protocol.conversation import Host
from daq.wire.links import DEAD_S, Link, open_link
from rigs.errors import CellError
from rigs.rig import Rig
from rigs.schema.feedback import Feedback, LineFeed, NoFeedback, columns_beside_joints
from rigs.schema.links import Line, ModemLines

ROBOT = "robot"
JOINTS = tuple(f"q{axis}_deg" for axis in range(1, 7))
NO_LINE = Line(baud=9600, bits=8, parity="N", stop=1)
"""Line settings of robots connected by a network or printing lines to a serial port."""
_PATIENCE = 3


@dataclass(frozen=True)
class Stream:
    """A link with its sample columns and conversation. dead_s, listens, modem: as in `daq.wire.links.open_link`."""

    name: str
    columns: tuple[str, ...]
    port: str
    line: Line
    host: Callable[[], Host]
    dead_s: float = DEAD_S
    listens: bool = False
    modem: ModemLines | None = None
    opening: Callable[..., Link] = open_link

    def open(self) -> Link:
        return self.opening(self.name, self.port, self.line, dead_s=self.dead_s, listens=self.listens, modem=self.modem)


def gauge_groups(rig: Rig) -> list[tuple[str, ...]]:
    by_port: dict[str, list[str]] = {}
    for name, gauge in rig.gauges.recorded.items():
        by_port.setdefault(gauge.port, []).append(name)
    return [tuple(names) for names in by_port.values()]


def streams_of(rig: Rig) -> list[Stream]:
    if isinstance(rig.feedback, NoFeedback):
        problem = "has neither gauges nor feedback to read"
        remedy = "add feedback to the rig file, and gauges for circles; poses of a tracker are imported: rig import"
        raise CellError(rig.name, problem, remedy, code="rig_file.invalid")
    members = rig.gauges.recorded
    streams = []
    for names in gauge_groups(rig):
        group = [members[name] for name in names]
        columns, first = tuple(f"{name}_mm" for name in names), group[0]
        host = partial(gauges.host, group)
        dead_s = _dead_s(max(gauge.timeout_s for gauge in group))
        streams.append(Stream("_".join(names), columns, first.port, first.line, host, dead_s, modem=first.modem))
    return [*streams, robot_stream(rig.feedback)]


def robot_stream(robot: Feedback) -> Stream:
    """Stream of a robot. Its interface may need a package that is not installed."""
    feedback.load(robot)  # now, before other streams are read
    columns, host = (*JOINTS, *columns_beside_joints(robot)), partial(feedback.host, robot)
    line = robot.line if isinstance(robot, LineFeed) else NO_LINE
    return Stream(ROBOT, columns, robot.port, line, host, _dead_s(robot.timeout_s), robot.listens)


def _dead_s(timeout_s: float) -> float:
    return max(DEAD_S, _PATIENCE * timeout_s)

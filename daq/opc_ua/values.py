"""Conversion of the node values of a robot into samples of all axes and faults.

A server samples each axis separately, and a message may contain several samples of an axis, or only some of the axes.
Samples with adjacent stamps form a position. An axis with no new sample has not moved.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from asyncua import ua

from daq.opc_ua.channel import NO_STAMP
from daq.opc_ua.nodes import RobotNodes, condition_of, read_request
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Item
from daq.protocol.framing import Message
from daq.protocol.numerals import are_angles
from rigs.schema.feedback import OPCUARobotics, condition_columns

_AXES = 6


@dataclass(frozen=True, slots=True)
class AxisValue:
    """Value of an axis 0 … 5."""

    axis: int
    angle_deg: float
    """nan if the server marks it bad."""
    clock_s: float
    """nan without a stamp."""
    status: int = 0


@dataclass(frozen=True, slots=True)
class ArmPosition:
    """Position of all axes. apart_s: spread of the stamps."""

    angles_deg: tuple[float, ...]
    clock_s: float
    status: int
    apart_s: float


class Together:
    def __init__(self, together_s: float) -> None:
        self._together_s = together_s
        self._known: dict[int, AxisValue] = {}
        self._open: dict[int, AxisValue] = {}

    def take(self, values: Iterable[AxisValue]) -> Iterator[ArmPosition]:
        ordered = sorted(values, key=lambda value: value.clock_s)
        if any(math.isnan(value.clock_s) for value in ordered):
            # it is unknown which values belong together
            ordered = list({value.axis: value for value in ordered}.values())
        for value in ordered:
            since_s = value.clock_s - min((begun.clock_s for begun in self._open.values()), default=value.clock_s)
            if value.axis in self._open or since_s > self._together_s:
                yield from self.end()
            self._open[value.axis] = value
            if len(self._open) == _AXES:
                yield from self.end()

    def end(self) -> Iterator[ArmPosition]:
        if not self._open:
            return
        stamps_s = [value.clock_s for value in self._open.values()]
        self._known |= self._open
        self._open = {}
        angles_deg = tuple(self._known[axis].angle_deg for axis in range(_AXES) if axis in self._known)
        if len(angles_deg) == _AXES and not any(map(math.isnan, angles_deg)):
            status = max(value.status for value in self._known.values())
            first_s, last_s = min(stamps_s), max(stamps_s)
            yield ArmPosition(angles_deg, (first_s + last_s) / 2, status, last_s - first_s)


_TOGETHER = 0.5
_APART_S = 1e-3
"""Spread of stamps above which a fault is reported: at 50 deg/s the axes are then off by 0.05 deg."""
_UNCERTAIN, _SEVERITY, _CODE = 1, 30, 0xFFFF0000
"""Status codes: two bits of severity (0 good, 1 uncertain) and the code in the upper half (OPC 10000-4, 7.39)."""
_OVERFLOW = 0x480
"""Status bits of a data value after an overflow of the server queue."""


class RobotValues:
    def __init__(self, feedback: OPCUARobotics, nodes: RobotNodes) -> None:
        self._nodes = nodes
        self._columns = condition_columns(feedback)
        self._names = list(nodes.condition)
        self._shown: dict[str, Any] = {}
        self._together = Together(_TOGETHER / feedback.rate_hz)
        self._last_number = self._notes = self._positions = 0
        self._apart_reported = False

    def request(self) -> Any:
        return read_request(self._nodes.all)

    def stand_still(self, note: Any) -> bool:
        """True if the stamps stand still: no new data arrives after the first position."""
        return bool(self._notes) and self._positions < 2 and not note.NotificationData

    def published(self, note: Any, message: Message) -> Iterator[Item]:
        if not note.NotificationData:
            yield from self._samples(self._together.end(), NO_TIME, message)
            return
        # A message with data has the next sequence number. A keep-alive repeats the number of the following message.
        missing, self._last_number = note.SequenceNumber - self._last_number - 1, note.SequenceNumber
        if missing > 0 and self._notes:
            yield message.fault(FaultKind.SKIPPED, "messages of the subscription are missing", missing)
        self._notes += 1
        values = list[AxisValue]()
        for data in note.NotificationData:
            if isinstance(data, ua.DataChangeNotification):
                for item in data.MonitoredItems or ():
                    yield from self._take(item.ClientHandle, item.Value, values, message)
        yield from self._samples(self._together.take(values), NO_TIME, message)

    def polled(self, results: Sequence[Any], asked_ns: int, message: Message) -> Iterator[Item]:
        values = list[AxisValue]()
        for place, value in enumerate(results):
            yield from self._take(place, value, values, message)
        together = Together(math.inf)
        unstamped = (replace(value, clock_s=math.nan) for value in values)
        yield from self._samples(together.take(unstamped), asked_ns, message)

    def _take(self, place: int, value: Any, values: list[AxisValue], message: Message) -> Iterator[Fault]:
        code = value.StatusCode.value if value.StatusCode else 0
        severity, plain = code >> _SEVERITY, None if value.Value is None else value.Value.Value
        axes = len(self._nodes.axes)
        if axes <= place < axes + len(self._names):
            text = plain.Text if isinstance(plain, ua.LocalizedText) else plain
            self._shown[self._names[place - axes]] = text if severity <= _UNCERTAIN else None
        elif place < axes:
            angle = math.nan
            if isinstance(plain, float | int) and not isinstance(plain, bool) and severity <= _UNCERTAIN:
                angle = float(plain)
            if math.isnan(angle):
                why = ua.StatusCode(code).name if severity > _UNCERTAIN else f"{plain!r}"[:60]
                yield message.fault(FaultKind.DEVICE_ERROR, f"axis {place + 1}: {why} instead of an angle")
            if code & _OVERFLOW == _OVERFLOW:
                detail = f"axis {place + 1}: values were lost because the server's queue was full"
                yield message.fault(FaultKind.SKIPPED, detail)
            status = code & _CODE if severity == _UNCERTAIN else 0
            stamps = [
                stamp for stamp in (value.SourceTimestamp, value.ServerTimestamp) if stamp not in (None, NO_STAMP)
            ]
            clock_s = float(stamps[0].timestamp()) if stamps else math.nan
            values.append(AxisValue(place, angle * self._nodes.deg_per_unit[place], clock_s, status))

    def _samples(self, positions: Iterable[ArmPosition], asked_ns: int, message: Message) -> Iterator[Item]:
        shown = condition_of(self._shown)
        condition = tuple(shown[name] for name in self._columns)
        for position in positions:
            self._positions += 1
            if not are_angles(position.angles_deg):
                yield message.fault(FaultKind.GARBLED, f"angles {position.angles_deg} deg; ignored")
                continue
            if position.apart_s > _APART_S and not self._apart_reported:
                self._apart_reported = True
                detail = f"the server stamps the axes of a position up to {1e3 * position.apart_s:.1f} ms apart"
                yield message.fault(FaultKind.DOUBTFUL, f"{detail}; the midpoint is used")
            values = (*position.angles_deg, *condition)
            yield message.sample(values, position.clock_s, requested_ns=asked_ns, status=position.status)

"""What a search found: values that a person reads, and that a rig file is written from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from daq.acquisition.stream_buffer import size_of
from daq.discovery.attempts import STAND_IN, Sends, missing_keys
from daq.protocol.conversation import Fault, FaultKind, Item
from rigs.schema.feedback import Feedback
from rigs.schema.gauges import Gauge

ENOUGH = 3
"""Readings in a row that are hardly an accident: a Micro-Epsilon value is met by one in 64 random triples."""
OF_THE_INSTRUMENT = {FaultKind.MISSING, FaultKind.DEVICE_ERROR}
"""Faults in the instrument's own words, which show that its protocol is spoken."""


@dataclass(frozen=True)
class Evidence:
    """How well what came fits a protocol: readings, the longest row of them, and what was not understood."""

    readings: int
    in_a_row: int
    not_understood: int

    @property
    def enough(self) -> bool:
        """Whether it is hardly an accident."""
        return self.in_a_row >= ENOUGH

    @property
    def rank(self) -> tuple[bool, float, int]:
        """What orders candidates, the best highest."""
        return self.enough, self.readings / max(1, self.readings + self.not_understood), self.readings


def evidence_of(items: Iterable[Item]) -> Evidence:
    """Return the evidence in what a conversation made of what came."""
    readings = row = longest = faults = 0
    for item in items:
        if not isinstance(item, Fault):
            row, readings = row + size_of(item), readings + size_of(item)
            longest = max(longest, row)
        elif item.kind not in OF_THE_INSTRUMENT:
            row, faults = 0, faults + item.count
    return Evidence(readings, longest, faults)


@dataclass(frozen=True)
class FoundGauge:
    """A gauge that answers: as a rig file names it, its last reading, its pace, and what may be sent to it.

    also: other interfaces that fit as well.
    """

    gauge: Gauge
    reading_mm: float
    rate_hz: float
    sends: Sends
    also: tuple[str, ...] = ()

    @property
    def place(self) -> str:
        """Its port, with the channel where its instrument has several."""
        return f"{self.gauge.port}#{self.gauge.channel}" if self.gauge.shares else self.gauge.port

    @property
    def lacks(self) -> tuple[str, ...]:
        """Keys that its owner still has to give; until then a reading is a percentage of the range."""
        if self.sends == "all":  # named by a person, with its keys
            return ()
        return tuple(key for key in missing_keys(self.gauge.interface) if key in STAND_IN)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        plain = self.gauge.model_dump(mode="json", exclude_defaults=True, exclude={"offset_mm", *self.lacks})
        fields = {"interface": self.gauge.interface, "line": str(self.gauge.line), **plain}
        unit = "reading_percent" if self.lacks else "reading_mm"
        return {
            "place": self.place,
            "gauge": fields,
            unit: self.reading_mm,
            "rate_hz": round(self.rate_hz, 1),
            "lacks": list(self.lacks),
            "also": list(self.also),
        }


@dataclass(frozen=True)
class PortReport:
    """What is on a port: its gauges, or why none was found and what to do about it."""

    port: str
    description: str = ""
    gauges: tuple[FoundGauge, ...] = ()
    problem: str = ""
    remedy: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {**asdict(self), "gauges": [gauge.to_dict() for gauge in self.gauges]}


@dataclass(frozen=True)
class RobotReport:
    """What is at a robot's address: how its joints are read and where they stand, or why not.

    units_sure: False where angles come as bare numbers that could be degrees or radians. reported: the controller's own
    last warning.
    """

    address: str
    feedback: Feedback | None = None
    joints_deg: tuple[float, ...] = ()
    rate_hz: float = 0.0
    units_sure: bool = True
    reported: str = ""
    problem: str = ""
    remedy: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        feedback = self.feedback.model_dump(mode="json", exclude_defaults=True) if self.feedback else None
        return {**vars(self), "feedback": feedback}

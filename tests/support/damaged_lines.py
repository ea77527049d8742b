"""Sessions of gauges that print numbers, over lines that damage answers, in simulated time.

The damage is that of cables, adapters and ports, and shares nothing with the checks of `daq.protocol.numerals`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from random import Random
from typing import Any

import daq.gauges
from daq.emulators.simulated_cell import SimulatedLine
from daq.emulators.simulated_clock import SimulatedClock
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Item, Sample
from daq.wire.conversation_loop import run_conversation
from tests.support.drivers import GAUGES

PRINTING = {
    name: (list(gauges), resolution_mm)
    for name, gauges, resolution_mm in GAUGES
    if gauges[0].interface not in {"modbus_map", "micro_epsilon_ild1420", "solartron_orbit"}
}
"""Gauges of a link and their resolution, for all configurations of the drivers that print their readings."""
_DOUBTS = {FaultKind.DOUBTFUL, FaultKind.UNIT_CHANGED, FaultKind.LATE}
"""Faults about readings that are kept."""
_MARKED_WITHIN_NS = 3_000_000_000
"""Time until a doubt about a kept reading must follow."""


Damage = Callable[[Random, bytes, int], bytes]
"""Damages an answer, in most cases at a place."""


def _flip(dice: Random, data: bytes, k: int) -> bytes:
    return data[:k] + bytes([data[k] ^ 1 << dice.randrange(7)]) + data[k + 1 :]


def _overwrite(dice: Random, data: bytes, k: int) -> bytes:
    return data[:k] + bytes([dice.choice(b"0123456789+- .")]) + data[k + 1 :]


def _insert(dice: Random, data: bytes, k: int) -> bytes:
    return data[:k] + bytes([dice.choice(b"0123456789.+- \x00\xff")]) + data[k:]


def _echo(dice: Random, data: bytes, k: int) -> bytes:
    return dice.choice([b"?\r", b"R\r\n", b"M\r", b"1\r", b"M0\r\n", b"\x02", b"M1?\r"]) + data


LOSSES: dict[str, Damage] = {
    "a character lost": lambda dice, data, k: data[:k] + data[k + 1 :],
    "several lost": lambda dice, data, k: data[:k] + data[k + dice.randint(2, 6) :],
    "start lost": lambda dice, data, k: data[max(1, k) :],
    "end lost": lambda dice, data, k: data.rstrip(b"\r\n") + data[len(data) - dice.randrange(2) :],
    "minus lost": lambda dice, data, k: data.replace(b"-", b"", 1),
    "point lost": lambda dice, data, k: data.replace(b".", b"", 1),
    "doubled": lambda dice, data, k: data[: k + 1] + data[k:],
    "inserted": _insert,
    "echo": _echo,
}
"""Damages that change the length of an answer."""
DAMAGES: dict[str, Damage] = LOSSES | {
    "two joined": lambda dice, data, k: b"",
    "sent twice": lambda dice, data, k: data,
    "bit flipped": _flip,
    "overwritten": _overwrite,
}


@dataclass
class _Line:
    """A line on which, on average, one of `one_in` answers is damaged.

    has_parity: a character with a flipped bit arrives as NUL (`daq.wire.serial_port`).
    """

    dice: Random
    damage: str
    one_in: float
    has_parity: bool
    damaged: int = 0
    _before: bytes = b""
    """Answer before, or part of an answer that is held up and arrives with the next."""

    def change(self, data: bytes) -> tuple[bytes, int]:
        answer = data
        if self.damage == "two joined":
            answer, self._before = self._before + data, b""
        is_damaged = bool(data) and self.dice.random() * self.one_in < 1
        changed = self._damaged(answer) if is_damaged else answer
        self.damaged += changed != data
        if self.damage != "two joined":
            self._before = data
        return changed, 0

    def _damaged(self, data: bytes) -> bytes:
        k = self.dice.randrange(len(data))
        if self.damage == "two joined":
            self._before = data.rstrip(b"\r\n") if self.dice.random() < 0.5 else data[:k]
        if self.damage == "sent twice":
            return self._before + data
        if self.damage == "bit flipped" and self.has_parity:
            return data[:k] + b"\0" + data[k + 1 :]
        return DAMAGES[self.damage](self.dice, data, k)


@dataclass
class Recorded:
    """Readings of a session on a damaged line. sent, damaged: answers of the gauge."""

    gauge: str
    damage: str
    sent: int = 0
    damaged: int = 0
    right: int = 0
    marked: int = 0
    """Wrong readings that a later fault doubts."""
    last: list[str] = field(default_factory=list)
    """Wrong readings without a fault among the last two of the session, which nothing can doubt any more."""
    near_mm: list[float] = field(default_factory=list)
    """Deviations of wrong readings without a fault that are within the usual motion between readings."""
    wrong: list[str] = field(default_factory=list)
    """Other wrong readings without a fault."""
    faults: Counter[str] = field(default_factory=Counter)


def _motion(dice: Random) -> Callable[[float], float]:
    """Position in mm of a gauge at a time in s: near zero, near 10 mm or elsewhere; at rest, slow or fast."""
    middle_mm = dice.choice([0.0, 0.0, 10.0, -10.0, 1.0, -1.0, dice.uniform(-20, 20)])
    swing_mm = dice.choice([0.0, 0.0, 0.002, 0.05, 0.5, 3.0])
    rate, phase, scatter_mm = dice.uniform(0.2, 1.2), dice.uniform(-3, 3), dice.choice([0.0, 0.0002])
    return lambda t_s: middle_mm + swing_mm * math.sin(rate * t_s + phase) + scatter_mm * math.sin(9e4 * t_s)


@dataclass(frozen=True)
class _Shown:
    """What the displays of the gauges of a link showed when they answered."""

    at_ns: int
    values_mm: tuple[float, ...]


def recorded(gauge: str, damage: str, seed: int, *, answers: int = 100, one_in: float = 12.0) -> Recorded:
    """Readings of a gauge over a line on which, on average, one of `one_in` answers is damaged."""
    gauges, resolution_mm = PRINTING[gauge]
    dice = Random(f"{gauge} {damage} {seed}")
    position_mm, shown, items = _motion(dice), list[_Shown](), list[Item]()

    def read(now_ns: int) -> Sequence[float]:
        shown.append(_Shown(now_ns, tuple(position_mm(now_ns / 1e9 + k) for k in range(len(gauges)))))
        return shown[-1].values_mm

    settings: Any = gauges[0].line
    line, faulty = SimulatedLine(gauge, settings.character_ns), _Line(dice, damage, one_in, settings.parity != "N")
    line.change = faulty.change
    with SimulatedClock(seed + 1).running() as time:
        with time.process("instrument"):
            line.serve(lambda: daq.gauges.device(gauges, read), [])
        run_conversation(line.open(), daq.gauges.host(gauges), items.extend, lambda: len(shown) > answers)
    return _judged(Recorded(gauge, damage, len(shown), faulty.damaged), items, shown, resolution_mm)


def _judged(result: Recorded, items: list[Item], shown: list[_Shown], resolution_mm: float) -> Recorded:
    samples = [item for item in items if isinstance(item, Sample)]
    faults = [item for item in items if isinstance(item, Fault)]
    doubts = [fault for fault in faults if fault.kind in _DOUBTS]
    result.faults = Counter(str(fault.kind) for fault in faults)
    for number, sample in enumerate(samples, 1):
        away_mm, step_mm = _deviation_mm(sample, shown), _usual_step_mm(sample, shown)
        if away_mm <= resolution_mm:
            result.right += 1
        elif any(_is_about(doubt, number, sample, samples) for doubt in doubts):
            result.marked += 1
        elif away_mm <= 3 * (step_mm + resolution_mm):
            result.near_mm.append(away_mm)
        else:
            group = result.last if number > len(samples) - 2 else result.wrong
            group.append(f"{sample.values} instead of {_possible(sample, shown)}")
    return result


def _possible(sample: Sample, shown: list[_Shown]) -> list[tuple[float, ...]]:
    """Readings from which an answer can come: those since the request, or the last ones of a stream."""
    if sample.requested_ns != NO_TIME:
        return [one.values_mm for one in shown if sample.requested_ns <= one.at_ns <= sample.last_byte_ns]
    return [one.values_mm for one in shown if one.at_ns <= sample.last_byte_ns][-3:]


def _deviation_mm(sample: Sample, shown: list[_Shown]) -> float:
    """Deviation of a sample from what the gauges showed; a gauge in error has none."""
    away_mm = [
        max((abs(v - mm) for v, mm in zip(sample.values, values_mm, strict=True) if not math.isnan(v)), default=0.0)
        for values_mm in _possible(sample, shown)
    ]
    return min(away_mm, default=math.inf)


def _usual_step_mm(sample: Sample, shown: list[_Shown]) -> float:
    """Largest step between the readings near a sample."""
    near = sorted(pairwise(shown), key=lambda pair: abs(pair[0].at_ns - sample.last_byte_ns))[:12]
    steps = (zip(one.values_mm, other.values_mm, strict=True) for one, other in near)
    return max((abs(b - a) for step in steps for a, b in step), default=0.0)


def _is_about(doubt: Fault, number: int, sample: Sample, samples: Sequence[Sample]) -> bool:
    """True if a doubt names the first readings up to this one, or follows the reading soon."""
    earlier = sum(one.last_byte_ns <= doubt.at_ns for one in samples)
    return number <= doubt.count < earlier or 0 <= doubt.at_ns - sample.last_byte_ns <= _MARKED_WITHIN_NS

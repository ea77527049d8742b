"""The form of the window that starts a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import get_args

from analysis.apps.live.view import GaugeReading
from rigs.errors import UseError
from rigs.schema.vocabulary import CIRCLES, OF_ISO9283, Direction, TestName

_TESTS = tuple(test for test in get_args(TestName) if test not in OF_ISO9283)
_REMEDY = f"type for example: monday yaw acw; tests: {', '.join(_TESTS)}"


@dataclass(frozen=True)
class RecordingLabel:
    name: str
    test: str
    direction: Direction | None

    @classmethod
    def typed(cls, text: str) -> RecordingLabel:
        """Parse a typed label, except the name, which the daemon checks."""
        name, test, direction, *more = [*text.split(), "", "", ""]
        if not test or test not in _TESTS:
            raise UseError("label", f"{text!r} is not NAME TEST [acw or cw]", _REMEDY)
        way: Direction | None = next((way for way in get_args(Direction) if way == direction), None)
        if any(more) or (test in CIRCLES) != (way is not None) or bool(direction) != (way is not None):
            rule = "needs a direction, acw or cw" if test in CIRCLES else "does not have a direction"
            raise UseError("label", f"a {test} test {rule}", _REMEDY)
        return cls(name, test, way)

    def fields(self) -> dict[str, str | None]:
        return {"name": self.name, "test": self.test, "direction": self.direction}


@dataclass(frozen=True)
class StartRecording:
    label: RecordingLabel
    zero_mm: tuple[float, float] = (0.0, 0.0)

    def request(self) -> dict[str, object]:
        return {**self.label.fields(), **({"view_zero_mm": self.zero_mm} if any(self.zero_mm) else {})}


def zeros_at(readings: Mapping[str, GaugeReading]) -> tuple[float, float]:
    g1, g2 = (readings[name].mm if name in readings else 0.0 for name in ("g1", "g2"))
    return g1, g2

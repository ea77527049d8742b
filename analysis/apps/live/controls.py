"""Keyboard controls: pure transitions from a key to the next state and an action."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

from analysis.apps.live.view import GaugeReading, LiveView
from rigs.errors import UseError
from rigs.schema.vocabulary import CIRCLES, OF_ISO9283, Direction, TestName

_ESCAPE = "\x1b"
_LONGEST_PROMPT = 200


@dataclass(frozen=True)
class Units:
    """Unit of length with the decimals of a reading, for a resolution of up to 0.1 µm."""

    name: str
    per_mm: float
    decimals: int


UNITS = (Units("mm", 1.0, 4), Units("µm", 1000.0, 1), Units("inch", 1 / 25.4, 6))
KEYS = (
    ("s", "start a recording (the label is asked only once)"),
    ("e", "end the recording"),
    ("l", "label: name, test, direction"),
    ("z  Z", "zero both gauges in this view; show absolute readings"),
    ("u", "units: mm, µm, inch"),
    ("r", "restart min, max, curves and reversals"),
    ("space", "pause and continue a played run"),
    ("+  -", "play faster, slower"),
    ("?  h", "this help"),
    ("q", "quit"),
)
_TESTS = tuple(test for test in get_args(TestName) if test not in OF_ISO9283)
_ZEROED = "zero: an offset of this view, stored in a run started with s; recorded readings are unchanged"
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
            raise UseError("label", f"{text!r} is not NAME TEST [acw or cw]", _REMEDY, code="live.label")
        way: Direction | None = next((way for way in get_args(Direction) if way == direction), None)
        if any(more) or (test in CIRCLES) != (way is not None) or bool(direction) != (way is not None):
            rule = "needs a direction, acw or cw" if test in CIRCLES else "does not have a direction"
            raise UseError("label", f"a {test} test {rule}", _REMEDY, code="live.label")
        return cls(name, test, way)

    def fields(self) -> dict[str, str | None]:
        return {"name": self.name, "test": self.test, "direction": self.direction}

    def __str__(self) -> str:
        return " ".join(filter(None, (self.name, self.test, self.direction)))


@dataclass(frozen=True)
class StartRecording:
    label: RecordingLabel
    zero_mm: tuple[float, float] = (0.0, 0.0)

    def request(self) -> dict[str, object]:
        return {**self.label.fields(), **({"view_zero_mm": self.zero_mm} if any(self.zero_mm) else {})}


Action = StartRecording | Literal["quit", "stop", "restart", "redraw", "pause", "faster", "slower"]
_CTRL_L = "\x0c"
_ACTIONS: dict[str, Action] = {
    "q": "quit", "e": "stop", "r": "restart", " ": "pause", "+": "faster", "-": "slower", _CTRL_L: "redraw",
}  # fmt: skip


def zeros_at(readings: Mapping[str, GaugeReading]) -> tuple[float, float]:
    g1, g2 = (readings[name].mm if name in readings else 0.0 for name in ("g1", "g2"))
    return g1, g2


@dataclass(frozen=True)
class LiveControls:
    units: Units = UNITS[0]
    zero_mm: tuple[float, float] = (0.0, 0.0)
    shows_help: bool = False
    prompt: str | None = None
    """Partially typed label; None if not typing."""
    starts: bool = False
    """Whether a recording starts after the input."""
    label: RecordingLabel | None = None
    message: str = ""

    def pressed(self, key: str, readings: Mapping[str, GaugeReading]) -> tuple[LiveControls, Action | None]:
        if self.prompt is not None:
            return self._typed(key, self.prompt)
        controls = replace(self, message="", shows_help=False)
        match key:
            case "s" if self.label is not None:
                return controls, StartRecording(self.label, self.zero_mm)
            case "s" | "l":
                controls = replace(controls, prompt=str(self.label or ""), starts=key == "s")
            case "u":
                controls = replace(controls, units=UNITS[(UNITS.index(self.units) + 1) % len(UNITS)])
            case "z":
                controls = replace(controls, zero_mm=zeros_at(readings), message=_ZEROED)
            case "Z":
                controls = replace(controls, zero_mm=(0.0, 0.0))
            case "?" | "h":
                controls = replace(controls, shows_help=not self.shows_help)
        return controls, _ACTIONS.get(key)

    def with_notice(self, notice: str, before: LiveView, view: LiveView) -> LiveControls:
        """Controls with a notice as the message; without one, drop a message that a change of daemon or recording
        outdates."""
        if notice:
            return replace(self, message=notice)
        changed = (bool(before.lost), before.name) != (bool(view.lost), view.name)
        return replace(self, message="") if changed else self

    def _typed(self, key: str, prompt: str) -> tuple[LiveControls, Action | None]:
        match key:
            case _ if key == _ESCAPE:
                return replace(self, prompt=None, message=""), None
            case "\r" | "\n":  # Enter
                try:
                    label = RecordingLabel.typed(prompt)
                except UseError as error:
                    return replace(self, message=str(error)), None
                entered = replace(self, prompt=None, label=label, message="")
                return entered, StartRecording(label, self.zero_mm) if self.starts else None
            case "\x7f" | "\b":  # Backspace
                return replace(self, prompt=prompt[:-1]), None
        typed = prompt + key if key.isprintable() and len(prompt) < _LONGEST_PROMPT else prompt
        return replace(self, prompt=typed, message=""), None

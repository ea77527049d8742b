"""What every effect has: its keys and physics, where it may sit, its words, its remedy, how a controller corrects it.

An effect is one class in one file of `rigs/effects/`; nothing else names it. A parameter's unit is in its name; its
bounds, and the size that a healthy arm shows anyway, are its field's. The size scales an effect and is zero for none;
shapes say how it looks and need a size to be seen. A wave has a `phase_deg`; a gear's errors have an `order`.
"""

from __future__ import annotations

import datetime as dt
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self, TypeVar

import numpy as np
from pydantic import Field

from rigs.schema.part import Part
from rigs.schema.scene import Array, S, Stage
from rigs.schema.vocabulary import FEWEST_AXES, MOST_AXES, Build

Gauge = Literal["g1", "g2"]
PartKind = Literal["constants", "gravity", "curve", "reversal", "warming", "gauges", "clocks"]
"""Which part of an arm's error an effect belongs to, as a person thinks of it: link constants and zeros, what yields
under load, the angle error of a joint over its angle, what happens where a joint turns back, heat, the measuring
instruments, and the times of readings."""
_PART_OF: dict[Stage, PartKind] = {
    "time": "clocks",
    "arm": "constants",
    "joint": "reversal",
    "tool": "gravity",
    "setup": "gauges",
    "gauge": "gauges",
}
Use = Literal["joint zero", "link constant", "targets only", "none"]
Deed = Literal["repair", "remaster", "enter", "mount", "wait"]
"""What a hand does about an effect: repair a part of the arm, re-master a joint, enter a number, mount ball or gauges
again, or wait until it is warm."""
PHASE = "phase_deg"
"""Parameter that makes an effect a wave."""
_OF_A_WAVE = 0.1
"""Part of a wave to which an order is a whole number: no gear has 8.001 teeth."""
SEATS = ("axis", "field", "gauge", "from_axis", "to_axis", "way")
"""Parameters that say where an effect sits."""


def size(bound: float, healthy: float, *, least: float | None = None) -> Any:
    """A size: between -bound (or least) and bound, zero has no effect; `healthy` is its spread over good arms."""
    return Field(default=0.0, ge=-bound if least is None else least, le=bound, json_schema_extra={"healthy": healthy})


def shape(low: float, high: float, default: float) -> Any:
    """A shape, which may be from low to high."""
    return Field(default=default, ge=low, le=high)


class Found(Part):
    """Where an effect of a rig file came from: when, from which runs, how sure, and the gap that it closed."""

    date: dt.date
    runs: tuple[str, ...]
    sd: dict[str, float] = Field(default_factory=dict)
    """Standard uncertainty of each fitted parameter, in its own unit."""
    gap_um: tuple[float, float] | None = None
    """Root mean square of what was unexplained, before and after, in µm of the readings."""
    correlation: dict[str, float] = Field(default_factory=dict)
    """Correlation of the size with those of other effects of the same fit, by their names."""
    together: tuple[str, ...] = ()
    """Effects of the same fit that look like this one: only what they make up together is known."""
    rivals: tuple[str, ...] = ()
    """Effects that the same runs may show instead of this one: measure what separates them before it is corrected."""
    joints_deg: tuple[tuple[float, float], ...] | None = Field(
        default=None, min_length=FEWEST_AXES, max_length=MOST_AXES
    )
    """The lowest and the highest angle of each joint in those runs."""


@dataclass(frozen=True)
class Scope:
    """What runs can show of effects. timed: joints turn while they are read (circles); gauges that are read;
    twist_deg (axes): the arm's alpha; turned (axes): by how much of a turn each joint turns while it is read."""

    timed: bool
    gauges: tuple[Gauge, ...]
    twist_deg: tuple[float, ...]
    turned: tuple[float, ...]
    rail: bool = False
    """Whether a rail carries the arm, and stood in different places."""
    payload_kg: float = 0.0
    """What the rig file states to hang at the flange, 0 where it does not."""

    @property
    def axes(self) -> range:
        """The axes of the arm, from 1."""
        return range(1, len(self.twist_deg) + 1)


@dataclass(frozen=True)
class FreeShape:
    """A shape that is fitted with the size: what is expected, and how far it may be off. tried: the values at which a
    search looks for it; none where a search does not. stated: whether what is expected was stated, and so holds unless
    readings say otherwise: a fit that begins elsewhere may be as far off as it begins. low: a fit takes it no lower."""

    field: str
    expected: float
    spread: float
    tried: tuple[float, ...] = ()
    stated: bool = False
    low: float = -math.inf

    def spread_from(self, begin: float) -> float:
        """Return its spread in a fit that begins at a value."""
        return max(self.spread, abs(begin - self.expected)) if self.stated else self.spread


@dataclass(frozen=True)
class StretchedShape:
    """A shape that is fitted from where one of the forms has it, and may be off by a share of that, or by least; a fit
    takes it no lower than low."""

    field: str
    share: float
    least: float = 0.0
    low: float = 0.0


@dataclass(frozen=True)
class Departures:
    """How nature departs from the page: what may stand beside an effect, because no gear, ball or brake is ideal.

    beside: effects and the share of each that is one standard deviation; alike: combinations of effects, each with its
    shares, that are one standard deviation each and resemble the effect so much that it is first fitted without them;
    gap: a joint and half its play in degrees, since it is unknown where in it a run began; jolt: a joint, by how many
    degrees it may be off about each of its turns, and in how many seconds that fades, 0 at once; stick: a gauge and by
    how many mm it may be off at a target, since it is unknown how the plunger came there; fades: whether it fades while
    the robot stands at a target, since it is unknown how long it stood.
    """

    beside: tuple[tuple[float, Effect], ...] = ()
    alike: tuple[tuple[tuple[float, Effect], ...], ...] = ()
    gap: tuple[int, float] | None = None
    jolt: tuple[int, float, float] | None = None
    stick: tuple[Gauge, float] | None = None
    fades: bool = False


@dataclass(frozen=True)
class Compensation:
    """How a controller can make up for an effect. why_not: where it cannot; constant: the axis (from 1) and the key of
    the number in its rig file, mm or degrees, where it is one; `q_deg` is the joint's angle itself."""

    use: Use
    why_not: str = ""
    constant: tuple[int, str] | None = None


OF_THE_GAUGES = Compensation("none", "belongs to the gauges, which the robot's controller cannot correct")
OF_THE_CLOCKS = Compensation("none", "belongs to the clocks, which the robot's controller cannot correct")
BY_TARGETS = Compensation("targets only")


@dataclass(frozen=True)
class Place:
    """How a person writes where an effect sits. pattern: with a group for each parameter; example; every: what a
    parameter left out stands for."""

    pattern: str
    example: str
    every: Mapping[str, Sequence[str]] = field(default_factory=lambda: MappingProxyType({}))


NUMBER = r"\d+(?:\.\d+)?"
NOWHERE = Place("", "")
EVERY_AXIS = "1234567"
"""What an axis left out stands for, as far as the arm has these."""
AT_AXIS = Place("(?P<axis>[1-7])?", "1", {"axis": EVERY_AXIS})
AT_GAUGE = Place("(?P<gauge>g[12])?", "g1", {"gauge": ("g1", "g2")})


class Effect(Part, ABC):
    """One effect. `found`: where it came from, None where a person wrote it."""

    effect: str
    found: Found | None = None

    STAGE: ClassVar[Stage]
    PLACE: ClassVar[Place] = NOWHERE
    STRAIGHT: ClassVar[float] = 1.0
    """Healthy sizes up to which twice the size does twice as much. 0: never, as in a play."""
    NEEDS_REPEATS: ClassVar[bool] = False
    """Whether it shows only in what changes from lap to lap or from run to run: a single lap each way has slow noise
    that looks like it."""
    PART: ClassVar[PartKind | None] = None
    """The part of an arm's error that it belongs to, where its stage does not say that."""
    FORM_U: ClassVar[float] = 0.0
    """Standard uncertainty of the size, as a share of it, that comes from a form which readings hardly show."""
    FREE: ClassVar[tuple[FreeShape, ...]] = ()
    STRETCHED: ClassVar[tuple[StretchedShape, ...]] = ()
    DEED: ClassVar[Deed] = "repair"
    """What a hand does about it."""
    MOST: ClassVar[float] = 120.0
    """The largest size that a fit may find, in healthy sizes: faults are at most 100, and the simulator was not tested
    far beyond."""

    @abstractmethod
    def apply(self, scene: S) -> S:
        """The scene with the effect in it, over the whole trace; a size of zero is the identity."""

    @classmethod
    @abstractmethod
    def forms(cls, scope: Scope) -> list[list[Self]]:
        """A list for each place where it may sit in the runs of a scope, of the forms that it may have there, at size
        zero. Callers add the second phase of a wave."""

    @abstractmethod
    def plain(self, joint: str) -> str:
        """What a person calls it; joint: its joint in words, `axis 1 (Theta)`, where it has one."""

    @abstractmethod
    def remedy(self) -> str:
        """What a person should do, in the imperative, with the size where it is to be entered somewhere."""

    @abstractmethod
    def compensation(self) -> Compensation:
        """Whether and how a controller can make up for it."""

    @classmethod
    def free(cls, payload_kg: float) -> tuple[FreeShape, ...]:
        """The shapes that are fitted with it, where the rig file states a payload, 0 for none."""
        return cls.FREE

    @property
    def part(self) -> PartKind:
        """The part of an arm's error that it belongs to."""
        return self.PART or _PART_OF[self.STAGE]

    @property
    def healthy(self) -> float:
        """What a healthy arm shows of it anyway, in the unit of its size."""
        return float(_extra(type(self), size_field(self))["healthy"])

    def usual_times(self, build: Build) -> float:
        """How many times the healthy size an arm of a build shows without a fault."""
        return 1.0

    @property
    def seat(self) -> str:
        """Where it sits, as answers write it."""
        return str(getattr(self, "axis", getattr(self, "gauge", "")))

    @property
    def symbol(self) -> str:
        """The field's own name of the number that it changes; empty where that has none."""
        return ""

    @property
    def idle(self) -> str:
        """The reason why a test that does not move it shows nothing of it."""
        return "nothing in these tests moves it"

    def unit(self, parameter: str) -> str:
        """The unit of a parameter, deg, mm and the like; empty for a ratio."""
        if "_per_" in parameter:
            return parameter.replace("_per_", "/")
        return parameter.rsplit("_", 1)[-1] if "_" in parameter else {"ppm": "ppm"}.get(parameter, "")

    def departures(self) -> Departures:
        """How nature departs from it."""
        return Departures()

    @classmethod
    def turning(cls, axis: int, angle_deg: float) -> Effect | None:
        """The effect that turns a joint by a constant; None of every class but one."""
        return None

    @classmethod
    def changing(cls, axis: int, key: str, delta: float) -> Effect | None:
        """The effect that changes a constant of an axis, called as in the rig file, by delta mm or degrees; None of
        every class but one."""
        return None

    @classmethod
    def swinging(cls, frequency_hz: float, amplitude_mm: float) -> Effect | None:
        """The effect that is a swing of the link; None of every class but one. Its phase is new in each run, so it is
        looked for in the time of each run, and has no forms."""
        return None


_E = TypeVar("_E", bound=Effect)


def at_each_axis(cls: type[_E], scope: Scope, **values: float) -> list[list[_E]]:
    """One form at each joint."""
    return [[cls.model_validate({"axis": axis, **values})] for axis in scope.axes]


def at_each_gauge(cls: type[_E], scope: Scope) -> list[list[_E]]:
    """One form at each gauge that is read."""
    return [[cls.model_validate({"gauge": gauge})] for gauge in scope.gauges]


def scaled(effect: _E, share: float, **values: float) -> _E:
    """An effect with a share of its size, and with other values."""
    name = size_field(effect)
    return effect.model_copy(update={name: share * getattr(effect, name), **values})


def healthy(effect: _E) -> _E:
    """An effect at the size that a healthy arm shows anyway."""
    return effect.model_copy(update={size_field(effect): effect.healthy})


def identity(effect: _E) -> _E:
    """Which effect it is, whatever its size and shape: only what it has to be given, its place and its form."""
    return type(effect).model_validate(
        {name: getattr(effect, name) for name, info in type(effect).model_fields.items() if info.is_required()}
    )


def name_of(effect: Effect) -> str:
    """What an answer names: the effect and where it sits, `gauge_scale g1`, say."""
    return f"{effect.effect} {effect.seat}".rstrip()


def label_of(effect: Effect) -> str:
    """The name of an effect; gears by order, which are many of one name."""
    order = getattr(effect, "order", None)
    return name_of(effect) if order is None else f"{name_of(effect)} order {whole_order(order):g}"


def whole_order(order: float) -> float:
    """The order of a gear's wave as it is said: the number of teeth, where it is one to a tenth of a wave."""
    return float(round(order)) if abs(order - round(order)) < _OF_A_WAVE and round(order) > 0 else order


def phases(effect: _E) -> tuple[_E, ...]:
    """An effect, and, where it is a wave, the same a quarter on: together they reach every phase."""
    if not is_wave(effect):
        return (effect,)
    return effect, effect.model_copy(update={PHASE: (getattr(effect, PHASE) + 90.0) % 360.0})


def is_wave(effect: Effect) -> bool:
    """Whether its phase is free."""
    return hasattr(effect, PHASE)


def is_play(effect: Effect) -> bool:
    """Whether twice its size never does twice as much."""
    return effect.STRAIGHT == 0


def size_field(effect: Effect) -> str:
    """Name of the parameter that scales an effect and is zero for none."""
    return size_fields(type(effect))[0]


@cache
def size_fields(cls: type[Effect]) -> tuple[str, ...]:
    """Names of the keys that are declared by `size`: one of every effect that is whole."""
    return tuple(str(name) for name in cls.model_fields if "healthy" in _extra(cls, name))


def _extra(cls: type[Effect], name: str) -> dict[str, Any]:
    extra = cls.model_fields[name].json_schema_extra
    return extra if isinstance(extra, dict) else {}


def bounds(effect: Effect, name: str) -> tuple[float, float]:
    """Lowest and highest value of a parameter, infinite where it has no bound."""
    return _bounds(type(effect), name)


@cache
def _bounds(cls: type[Effect], name: str) -> tuple[float, float]:
    metadata = cls.model_fields[name].metadata
    low = [float(getattr(m, key)) for m in metadata for key in ("ge", "gt") if hasattr(m, key)]
    high = [float(m.le) for m in metadata if hasattr(m, "le")]
    return max(low, default=-math.inf), min(high, default=math.inf)


def one_sided(effect: Effect) -> bool:
    """Whether a size cannot be negative: a width, a softness, an amplitude."""
    return bounds(effect, size_field(effect))[0] == 0


def healthy_size(effect: Effect) -> float:
    """What a healthy arm shows of it anyway, in the unit of its size."""
    return effect.healthy


def size_of(effect: Effect) -> float:
    """The size of an effect in healthy sizes."""
    return float(getattr(effect, size_field(effect))) / healthy_size(effect)


WARMING_S = (60.0, 300.0, 1200.0)
"""Time constants that are tried, s. Chosen: factors of about five apart, since a fit then adjusts them."""
SPECTRUM = (0.2, 0.5, 2.0)
"""Time constants, in those of the effect, with which parts of a real arm may grow: motors and gears warm up faster than
castings. Chosen."""
SPECTRUM_SHARE = 0.25
"""Standard deviation of the share of each part. Chosen: of an arm a quarter of which warms up five times as fast, 5 %
made a growth of 149 ppm one of 120 ± 8."""


def warmed(t_s: Array, time_constant_s: float) -> Array:
    """How much of a growth (n,), as a share, has come at times t_s (n,) after the run began."""
    share: Array = -np.expm1(-np.maximum(t_s, 0) / time_constant_s)
    return share


def warming_parts(effect: Effect) -> tuple[tuple[tuple[float, Effect], ...], ...]:
    """How a growth with a time constant may come faster or slower in part: combinations of effects with shares."""
    tau_s = float(getattr(effect, "time_constant_s"))  # noqa: B009 - of those that grow alone
    others = [effect.model_copy(update={"time_constant_s": ratio * tau_s}) for ratio in SPECTRUM]
    return tuple(((SPECTRUM_SHARE, part), (-SPECTRUM_SHARE, effect)) for part in others)

"""Interface of effects, each a class in a file of `rigs/effects/` that no other file names.

A field has its unit in its name, its bounds, and the size for a healthy arm. The size scales an effect and is zero for
none. Shapes describe the form and are visible only with a size. A wave has a `phase_deg`; gear errors have an `order`.
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
from rigs.schema.reference import Reference
from rigs.schema.scene import Array, S, Stage
from rigs.schema.vocabulary import FEWEST_AXES, MOST_AXES, Build

Gauge = Literal["g1", "g2"]
PartKind = Literal["constants", "gravity", "curve", "reversal", "warming", "gauges", "clocks"]
"""Part of the error of an arm as seen by the user: link constants and zeros, elasticity under load, the angle error of
a joint, behaviour at reversals, heat, measuring instruments, and reading times.
"""
_PART_OF: dict[Stage, PartKind] = {
    "time": "clocks",
    "arm": "constants",
    "joint": "reversal",
    "tool": "gravity",
    "setup": "gauges",
    "gauge": "gauges",
}
Use = Literal["joint zero", "link constant", "targets only", "none"]
Deed = Literal["repair", "remaster", "enter", "mount", "wait", "check"]
"""Repair a part of the arm, re-master a joint, enter a number, remount ball or gauges, wait for thermal equilibrium, or
check a number that the rig file states.
"""
PHASE = "phase_deg"
_OF_A_WAVE = 0.1
"""Tolerance in waves for an integer order: no gear has 8.001 teeth."""
SEATS = ("axis", "field", "gauge", "from_axis", "to_axis", "way")


def size(bound: float, healthy: float, *, least: float | None = None) -> Any:
    """Declare a size parameter limited to [-bound or least, bound], zero for no effect. healthy: over good arms."""
    return Field(default=0.0, ge=-bound if least is None else least, le=bound, json_schema_extra={"healthy": healthy})


def shape(low: float, high: float, default: float) -> Any:
    """Declare a shape parameter limited to [low, high]."""
    return Field(default=default, ge=low, le=high)


class EffectProvenance(Part):
    """Provenance of an effect in a rig file: time, runs, certainty, and the explained part of the error."""

    date: dt.date
    runs: tuple[str, ...]
    sd: dict[str, float] = Field(default_factory=dict)
    """Standard uncertainty of each fitted parameter in the unit of the parameter."""
    gap_um: tuple[float, float] | None = None
    """Unexplained rms before and after, in µm of the readings."""
    correlation: dict[str, float] = Field(default_factory=dict)
    """Correlation of the size with other effects of the fit, by name."""
    together: tuple[str, ...] = ()
    """Other fitted effects with a similar change of the readings: only their sum is known."""
    rivals: tuple[str, ...] = ()
    """Effects that explain the runs equally well. Distinguish them by a measurement before correcting."""
    joints_deg: tuple[tuple[float, float], ...] | None = Field(
        default=None, min_length=FEWEST_AXES, max_length=MOST_AXES
    )
    """Range of each joint angle in the runs."""


@dataclass(frozen=True)
class Payload:
    """Payload at the flange and mass of the arm, by the rig file; 0 if not given."""

    kg: float = 0.0
    arm_kg: float = 0.0


@dataclass(frozen=True)
class Scope:
    timed: bool
    """Joints turn during the readings (circles)."""
    gauges: tuple[Gauge, ...]
    twist_deg: tuple[float, ...]
    """Alpha of each axis of the arm."""
    turned: tuple[float, ...]
    """Range of each joint in turns during the readings."""
    rail: bool = False
    """True if the arm is on a rail with several positions."""
    payload: Payload = Payload()

    @property
    def axes(self) -> range:
        return range(1, len(self.twist_deg) + 1)


@dataclass(frozen=True)
class FreeShape:
    field: str
    expected: float
    spread: float
    tried: tuple[float, ...] = ()
    """Start values of a search; empty if it is not searched."""
    stated: bool = False
    """The user stated the expected value. If the readings contradict it, the fit starts from a different one."""
    low: float = -math.inf

    def spread_from(self, begin: float) -> float:
        """Standard deviation of a fit that starts at a value: its distance from a stated value if larger."""
        return max(self.spread, abs(begin - self.expected)) if self.stated else self.spread


@dataclass(frozen=True)
class StretchedShape:
    """A shape fitted from the value of a form, with a relative uncertainty `share`, at least `least`."""

    field: str
    share: float
    least: float = 0.0
    low: float = 0.0


@dataclass(frozen=True)
class Departures:
    """Deviations of real effects from the ideal form, because gears, balls and brakes are not ideal."""

    beside: tuple[tuple[float, Effect], ...] = ()
    """Additional effects, each with a random share of one standard deviation."""
    alike: tuple[tuple[tuple[float, Effect], ...], ...] = ()
    """Combinations of effects with such shares, added after the first fit because they resemble the effect."""
    gap: tuple[int, float] | None = None
    """A joint and half of its backlash in degrees, whose initial position within the backlash is unknown."""
    jolt: tuple[int, float, float] | None = None
    """A joint, its deviation in degrees at each reversal, and the decay time in s; 0 for none."""
    stick: tuple[Gauge, float] | None = None
    """A gauge and its deviation in mm at a target, if the approach of the plunger is unknown."""
    fades: bool = False
    """True if the effect decays while the robot rests at a target for an unknown time."""


@dataclass(frozen=True)
class Compensation:
    use: Use
    why_not: str = ""
    constant: tuple[int, str] | None = None
    """Axis (from 1) and key in the rig file of a constant; `q_deg` is the joint angle itself."""


OF_THE_GAUGES = Compensation("none", "is a property of the gauges, which the robot's controller cannot correct")
OF_THE_CLOCKS = Compensation("none", "is a property of the clocks, which the robot's controller cannot correct")
BY_TARGETS = Compensation("targets only")


@dataclass(frozen=True)
class SeatNotation:
    pattern: str
    """Regular expression with a group per parameter."""
    example: str
    every: Mapping[str, Sequence[str]] = field(default_factory=lambda: MappingProxyType({}))
    """Meaning of omitted parameters."""


NUMBER = r"\d+(?:\.\d+)?"
NOWHERE = SeatNotation("", "")
EVERY_AXIS = "1234567"
AT_AXIS = SeatNotation("(?P<axis>[1-7])?", "1", {"axis": EVERY_AXIS})
AT_GAUGE = SeatNotation("(?P<gauge>g[12])?", "g1", {"gauge": ("g1", "g2")})


class Effect(Part, ABC):
    """An effect. found: provenance; None if written by a user."""

    effect: str
    found: EffectProvenance | None = None

    STAGE: ClassVar[Stage]
    KIND_NAME: ClassVar[str] = ""
    """Everyday name of the effect without its seat; the identifier if empty."""
    SEAT_NOUN: ClassVar[str] = ""
    """Noun of the seat: axis, link or gauge; empty if the effect has none of these."""
    PLAIN: ClassVar[str] = ""
    """Everyday name of the effect `{e}` at its `{joint}`; by default `KIND_NAME` and the seat."""
    IDLE: ClassVar[str] = "no motion in these tests shows this effect"
    """Reason for being invisible in a test that lacks the required motion or load; `{e}` is the effect."""
    REMEDY: ClassVar[str]
    """Action in the imperative, for classes without a method `remedy` of their own; `{e}` is the effect."""
    PLACE: ClassVar[SeatNotation] = NOWHERE
    STRAIGHT: ClassVar[float] = 1.0
    """Largest size, in healthy sizes, with a linear response; 0 for nonlinear effects such as backlash."""
    NEEDS_REPEATS: ClassVar[bool] = False
    """True if only changes between laps or runs reveal the effect: the slow noise of a single lap looks similar."""
    PART: ClassVar[PartKind | None] = None
    """Part of the error of the arm, unless the stage determines it."""
    FORM_U: ClassVar[float] = 0.01
    """Relative standard uncertainty of the size caused by a form that differs from that of a real part; 0 where the
    form is a definition. Source: 21 faults of an independent world with other forms deviated by 0.0 to 1.7 %.
    """
    FREE: ClassVar[tuple[FreeShape, ...]] = ()
    STRETCHED: ClassVar[tuple[StretchedShape, ...]] = ()
    CORRECTION: ClassVar[Compensation]
    """How a controller corrects the effect, for classes without a method `compensation` of their own."""
    DEED: ClassVar[Deed] = "repair"
    WEARS: ClassVar[bool] = True
    """False for constants of the arm: their difference from a data sheet is no fault, because they do not wear."""
    USUAL_TIMES: ClassVar[dict[Build, float]] = {}
    """Multiple of the healthy size that is normal in arms of a design, 1 if absent."""
    MOST: ClassVar[float] = 120.0
    """Largest size in a fit, in healthy sizes. Faults are at most 100; the simulator is not validated far beyond."""

    @abstractmethod
    def apply(self, scene: S) -> S:
        """Apply the effect to the complete trace. A size of zero is the identity."""

    @classmethod
    def forms(cls, scope: Scope) -> list[list[Self]]:
        """Possible forms at size zero, a list per possible seat in the runs; by default one form per axis or gauge.

        Callers add the second phase of a wave.
        """
        return at_each_axis(cls, scope) if "axis" in cls.model_fields else at_each_gauge(cls, scope)

    @classmethod
    def kind_name(cls, field: str) -> str:
        """Everyday name without the seat; field: the part of the seat after its dot, if any."""
        del field
        return cls.KIND_NAME

    def plain(self, joint: str) -> str:
        """Everyday name; joint: name of the joint, such as `axis 1 (Theta)`, if any."""
        if self.PLAIN:
            return self.PLAIN.format(e=self, joint=joint)
        place = f"gauge {self.seat}" if self.SEAT_NOUN == "gauge" else joint
        return f"{self.KIND_NAME} of {place}" if place else self.KIND_NAME

    def remedy(self) -> str:
        """Action in the imperative, including the size if it must be entered."""
        return self.REMEDY.format(e=self)

    def compensation(self) -> Compensation:
        return self.CORRECTION

    @classmethod
    def free(cls, payload: Payload) -> tuple[FreeShape, ...]:
        return cls.FREE

    def flank_deg(self) -> float | None:
        """Angle error that remains, ±, if each target is approached from one side; None if unknown."""
        return None

    @property
    def part(self) -> PartKind:
        return self.PART or _PART_OF[self.STAGE]

    @property
    def healthy(self) -> float:
        return float(_schema_extra(type(self), size_field(self))["healthy"])

    def usual_times(self, reference: Reference) -> float:
        return self.USUAL_TIMES.get(reference.design, 1.0)

    @property
    def repeats_each_turn(self) -> bool:
        return True

    @property
    def seat(self) -> str:
        return str(next((getattr(self, name) for name in ("axis", "gauge", "way") if hasattr(self, name)), ""))

    @property
    def symbol(self) -> str:
        """Standard symbol of the changed constant; empty if there is none."""
        return ""

    @property
    def idle(self) -> str:
        return self.IDLE.format(e=self)

    def unit(self, parameter: str) -> str:
        if "_per_" in parameter:
            return parameter.replace("_per_", "/")
        return parameter.rsplit("_", 1)[-1] if "_" in parameter else {"ppm": "ppm"}.get(parameter, "")

    def departures(self) -> Departures:
        return Departures()

    @classmethod
    def turning(cls, axis: int, angle_deg: float) -> Effect | None:
        """Effect of a joint turned by a constant; None except by one class."""
        return None

    @classmethod
    def changing(cls, axis: int, key: str, delta: float) -> Effect | None:
        """Effect of a constant (its key in the rig file) changed by delta mm or degrees; None except by one class."""
        return None

    @classmethod
    def swinging(cls, frequency_hz: float, amplitude_mm: float) -> Effect | None:
        """Vibration of the link, by a single class. Its phase changes in each run, so it has no forms."""
        return None


_E = TypeVar("_E", bound=Effect)


def at_each_axis(cls: type[_E], scope: Scope, **values: float) -> list[list[_E]]:
    return [[cls.model_validate({"axis": axis, **values})] for axis in scope.axes]


def at_each_gauge(cls: type[_E], scope: Scope) -> list[list[_E]]:
    return [[cls.model_validate({"gauge": gauge})] for gauge in scope.gauges]


def scaled(effect: _E, share: float, **values: float) -> _E:
    """A copy of an effect with the size multiplied by `share`, and other fields set to `values`."""
    name = size_field(effect)
    return effect.model_copy(update={name: share * getattr(effect, name), **values})


def healthy(effect: _E) -> _E:
    return effect.model_copy(update={size_field(effect): effect.healthy})


def identity(effect: _E) -> _E:
    return type(effect).model_validate(
        {name: getattr(effect, name) for name, info in type(effect).model_fields.items() if info.is_required()}
    )


def name_of(effect: Effect) -> str:
    return f"{effect.effect} {effect.seat}".rstrip()


def label_of(effect: Effect) -> str:
    order = getattr(effect, "order", None)
    return name_of(effect) if order is None else f"{name_of(effect)} order {whole_order(order):g}"


def whole_order(order: float) -> float:
    """Gear order to display: the nearest integer (a number of teeth) if it is within a tenth of a wave."""
    return float(round(order)) if abs(order - round(order)) < _OF_A_WAVE and round(order) > 0 else order


def waves_in_words(order: float) -> str:
    """Order of a gear wave as text: `8 waves per turn`."""
    waves = f"{whole_order(order):.4g}"
    return f"{waves} wave{'s' * (waves != '1')} per turn"


def phases(effect: _E) -> tuple[_E, ...]:
    """An effect, and for a wave also the effect shifted by a quarter. Together they span every phase."""
    if not is_wave(effect):
        return (effect,)
    return effect, effect.model_copy(update={PHASE: (getattr(effect, PHASE) + 90.0) % 360.0})


def is_wave(effect: Effect) -> bool:
    return hasattr(effect, PHASE)


def is_vibration(effect: Effect) -> bool:
    """True if an effect has another phase in each run, so that no model of several runs contains it."""
    return effect.swinging(1.0, 1e-3) is not None


def is_play(effect: Effect) -> bool:
    return effect.STRAIGHT == 0


def size_field(effect: Effect) -> str:
    return size_fields(type(effect))[0]


@cache
def size_fields(cls: type[Effect]) -> tuple[str, ...]:
    return tuple(str(name) for name in cls.model_fields if "healthy" in _schema_extra(cls, name))


def _schema_extra(cls: type[Effect], name: str) -> dict[str, Any]:
    extra = cls.model_fields[name].json_schema_extra
    return extra if isinstance(extra, dict) else {}


def bounds(effect: Effect, name: str) -> tuple[float, float]:
    return _bounds(type(effect), name)


@cache
def _bounds(cls: type[Effect], name: str) -> tuple[float, float]:
    metadata = cls.model_fields[name].metadata
    low = [float(m.ge) for m in metadata if hasattr(m, "ge")]
    low += [math.nextafter(m.gt, math.inf) for m in metadata if hasattr(m, "gt")]
    high = [float(m.le) for m in metadata if hasattr(m, "le")]
    return max(low, default=-math.inf), min(high, default=math.inf)


def one_sided(effect: Effect) -> bool:
    """True if a size cannot be negative: a width, a compliance, an amplitude."""
    return bounds(effect, size_field(effect))[0] == 0


def healthy_size(effect: Effect) -> float:
    return effect.healthy


def size_of(effect: Effect) -> float:
    return float(getattr(effect, size_field(effect))) / healthy_size(effect)


WARMING_S = (60.0, 300.0, 1200.0)
"""Initial time constants in s. Chosen: factors of about five, refined by the fit."""
SPECTRUM = (0.2, 0.5, 2.0)
"""Time constants of parts of a real arm relative to the effect. Chosen: motors warm up faster than castings."""
SPECTRUM_SHARE = 0.25
"""Standard deviation of the share of each part. Chosen: with 5 %, a growth of 149 ppm became 120 ± 8."""


def warmed(t_s: Array, time_constant_s: float) -> Array:
    """Share (n,) of a growth reached at times t_s (n,) in s after the start of the run."""
    share: Array = -np.expm1(-np.maximum(t_s, 0) / time_constant_s)
    return share


def warming_parts(effect: Effect) -> tuple[tuple[tuple[float, Effect], ...], ...]:
    tau_s = float(getattr(effect, "time_constant_s"))  # noqa: B009 - of those that grow alone
    others = [effect.model_copy(update={"time_constant_s": ratio * tau_s}) for ratio in SPECTRUM]
    return tuple(((SPECTRUM_SHARE, part), (-SPECTRUM_SHARE, effect)) for part in others)

"""Interface of effects: parameters, physics, possible seats, wording, remedy, and correction by a controller.

An effect is a class in a file of `rigs/effects/`, and no other file refers to it. The name of a parameter contains the
unit. The field contains the bounds, and for the size also the value of a healthy arm. The size scales an effect, and is
zero for no effect. Shapes describe the form of the effect, and are visible only if the size is not zero. A wave has a
`phase_deg`, and a gear error an `order`.
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
"""Part of an arm's error as displayed to the user.

The parts are link constants and zeros, elasticity under load, the angle error of a joint, behaviour at reversals, heat,
measuring instruments, and reading times.
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
Deed = Literal["repair", "remaster", "enter", "mount", "wait"]
"""Action for an effect.

The actions are to repair a part of the arm, re-master a joint, enter a number, remount ball or gauges,
or wait for equilibrium.
"""
PHASE = "phase_deg"
"""Parameter of waves."""
_OF_A_WAVE = 0.1
"""Largest difference of a gear wave's order from a whole number that is ignored. Gears do not have 8.001 teeth."""
SEATS = ("axis", "field", "gauge", "from_axis", "to_axis", "way")
"""Parameters that determine the seat of an effect."""


def size(bound: float, healthy: float, *, least: float | None = None) -> Any:
    """Declare a size parameter limited to [-bound or least, bound], where zero means no effect.

    healthy: standard deviation of the size over good arms.
    """
    return Field(default=0.0, ge=-bound if least is None else least, le=bound, json_schema_extra={"healthy": healthy})


def shape(low: float, high: float, default: float) -> Any:
    """Declare a shape parameter limited to [low, high]."""
    return Field(default=default, ge=low, le=high)


class Found(Part):
    """Provenance of an effect in a rig file: time, runs, certainty, and the explained error."""

    date: dt.date
    runs: tuple[str, ...]
    sd: dict[str, float] = Field(default_factory=dict)
    """Standard uncertainty of each fitted parameter, in the unit of the parameter."""
    gap_um: tuple[float, float] | None = None
    """Unexplained rms before and after, in µm of the readings."""
    correlation: dict[str, float] = Field(default_factory=dict)
    """Correlation of the size with other effects of the fit, by name."""
    together: tuple[str, ...] = ()
    """Effects of the fit that resemble this one. Only their sum is known."""
    rivals: tuple[str, ...] = ()
    """Effects that may explain the runs instead. Separate them by a measurement before correcting."""
    joints_deg: tuple[tuple[float, float], ...] | None = Field(
        default=None, min_length=FEWEST_AXES, max_length=MOST_AXES
    )
    """Range of each joint angle in the runs."""


@dataclass(frozen=True)
class Scope:
    """Observability of effects in runs.

    timed: True if joints move during the readings (circles). gauges: gauges used. twist_deg (axes): alpha of the arm.
    turned (axes): range of each joint during the readings, in turns.
    """

    timed: bool
    gauges: tuple[Gauge, ...]
    twist_deg: tuple[float, ...]
    turned: tuple[float, ...]
    rail: bool = False
    """True if the arm is on a rail and was measured at several rail positions."""
    payload_kg: float = 0.0
    """Payload at the flange according to the rig file, 0 if not stated."""

    @property
    def axes(self) -> range:
        """Axes of the arm, from 1."""
        return range(1, len(self.twist_deg) + 1)


@dataclass(frozen=True)
class FreeShape:
    """A shape that is fitted together with the size, with expected value and uncertainty (spread).

    tried: start values of a search, empty if there is no search. stated: True if the user stated the expected value,
    which is used unless the readings contradict it. In a fit that starts elsewhere, the uncertainty is then the
    distance. low: lower limit in a fit.
    """

    field: str
    expected: float
    spread: float
    tried: tuple[float, ...] = ()
    stated: bool = False
    low: float = -math.inf

    def spread_from(self, begin: float) -> float:
        """Return the spread in a fit that starts at a value."""
        return max(self.spread, abs(begin - self.expected)) if self.stated else self.spread


@dataclass(frozen=True)
class StretchedShape:
    """A shape that is fitted from its value in a form. The uncertainty is a share of the value, but at least `least`.

    low: lower limit in a fit.
    """

    field: str
    share: float
    least: float = 0.0
    low: float = 0.0


@dataclass(frozen=True)
class Departures:
    """Deviations of real effects from their ideal form. Gears, balls and brakes are not ideal.

    beside: effects, each with a share that is one standard deviation.
    alike: combinations of effects with shares of one standard deviation, too similar to be included in the first fit.
    gap: a joint and half its backlash in degrees, because the initial position in the backlash is unknown.
    jolt: a joint, the deviation in degrees at each reversal, and the decay time in s, 0 for none.
    stick: a gauge and the deviation in mm at a target, because the approach of the plunger is unknown.
    fades: True if the effect decays while the robot stands at a target for an unknown time.
    """

    beside: tuple[tuple[float, Effect], ...] = ()
    alike: tuple[tuple[tuple[float, Effect], ...], ...] = ()
    gap: tuple[int, float] | None = None
    jolt: tuple[int, float, float] | None = None
    stick: tuple[Gauge, float] | None = None
    fades: bool = False


@dataclass(frozen=True)
class Compensation:
    """Correction of an effect by a controller.

    why_not: reason if impossible. constant: axis (from 1) and key of the number in the rig file, in mm or degrees, if
    the effect is a constant; `q_deg` is the joint angle itself.
    """

    use: Use
    why_not: str = ""
    constant: tuple[int, str] | None = None


OF_THE_GAUGES = Compensation("none", "belongs to the gauges, which the robot's controller cannot correct")
OF_THE_CLOCKS = Compensation("none", "belongs to the clocks, which the robot's controller cannot correct")
BY_TARGETS = Compensation("targets only")


@dataclass(frozen=True)
class Place:
    """Notation of a seat.

    pattern: regular expression with a group per parameter. every: values represented by an omitted parameter.
    """

    pattern: str
    example: str
    every: Mapping[str, Sequence[str]] = field(default_factory=lambda: MappingProxyType({}))


NUMBER = r"\d+(?:\.\d+)?"
NOWHERE = Place("", "")
EVERY_AXIS = "1234567"
"""Axes represented by an omitted axis, if the arm has them."""
AT_AXIS = Place("(?P<axis>[1-7])?", "1", {"axis": EVERY_AXIS})
AT_GAUGE = Place("(?P<gauge>g[12])?", "g1", {"gauge": ("g1", "g2")})


class Effect(Part, ABC):
    """An effect. `found`: provenance, None if entered by a user."""

    effect: str
    found: Found | None = None

    STAGE: ClassVar[Stage]
    PLACE: ClassVar[Place] = NOWHERE
    STRAIGHT: ClassVar[float] = 1.0
    """Largest size with a linear response, in healthy sizes, or 0 for nonlinear effects such as backlash."""
    NEEDS_REPEATS: ClassVar[bool] = False
    """True if the effect is visible only in changes between laps or runs. Slow noise of a single lap looks similar."""
    PART: ClassVar[PartKind | None] = None
    """Part of the arm's error. None if the stage determines it."""
    FORM_U: ClassVar[float] = 0.0
    """Relative standard uncertainty of the size due to a form that the readings do not show."""
    FREE: ClassVar[tuple[FreeShape, ...]] = ()
    STRETCHED: ClassVar[tuple[StretchedShape, ...]] = ()
    DEED: ClassVar[Deed] = "repair"
    """Action for this effect."""
    MOST: ClassVar[float] = 120.0
    """Largest size in a fit, in healthy sizes. Faults are at most 100. The simulator is not validated far beyond."""

    @abstractmethod
    def apply(self, scene: S) -> S:
        """Apply the effect to a scene over the complete trace. With size zero, the scene is unchanged."""

    @classmethod
    @abstractmethod
    def forms(cls, scope: Scope) -> list[list[Self]]:
        """Return the possible forms at size zero, as a list for each possible seat in the runs.

        Callers add the second phase of a wave.
        """

    @abstractmethod
    def plain(self, joint: str) -> str:
        """Return the everyday name. joint: name of the joint, such as `axis 1 (Theta)`, if any."""

    @abstractmethod
    def remedy(self) -> str:
        """Return the action in the imperative, with the size if it must be entered."""

    @abstractmethod
    def compensation(self) -> Compensation:
        """Describe the correction of the effect by a controller."""

    @classmethod
    def free(cls, payload_kg: float) -> tuple[FreeShape, ...]:
        """Return the shapes that are fitted with the effect, for a stated payload or 0."""
        return cls.FREE

    @property
    def part(self) -> PartKind:
        """Part of the arm's error."""
        return self.PART or _PART_OF[self.STAGE]

    @property
    def healthy(self) -> float:
        """Size for a healthy arm, in the unit of the size."""
        return float(_extra(type(self), size_field(self))["healthy"])

    def usual_times(self, build: Build) -> float:
        """Return the typical size for a build, as a multiple of the healthy size."""
        return 1.0

    @property
    def repeats_each_turn(self) -> bool:
        """True if a joint angle that differs by a whole turn has the same effect."""
        return True

    @property
    def seat(self) -> str:
        """Seat in the notation of answers."""
        return str(getattr(self, "axis", getattr(self, "gauge", "")))

    @property
    def symbol(self) -> str:
        """Standard symbol of the changed number. Empty if there is none."""
        return ""

    @property
    def idle(self) -> str:
        """Reason why a test without the required motion cannot show the effect."""
        return "nothing in these tests moves it"

    def unit(self, parameter: str) -> str:
        """Return the unit of a parameter, such as deg or mm. Empty for a ratio."""
        if "_per_" in parameter:
            return parameter.replace("_per_", "/")
        return parameter.rsplit("_", 1)[-1] if "_" in parameter else {"ppm": "ppm"}.get(parameter, "")

    def departures(self) -> Departures:
        """Return the deviations of real effects from the ideal form."""
        return Departures()

    @classmethod
    def turning(cls, axis: int, angle_deg: float) -> Effect | None:
        """Return the effect of turning a joint by a constant. Implemented by a single class."""
        return None

    @classmethod
    def changing(cls, axis: int, key: str, delta: float) -> Effect | None:
        """Return the effect of changing an axis constant by delta, in mm or degrees. Implemented by a single class.

        key: name of the constant in the rig file.
        """
        return None

    @classmethod
    def swinging(cls, frequency_hz: float, amplitude_mm: float) -> Effect | None:
        """Return the effect of a vibration of the link. Implemented by a single class.

        The phase changes in each run. The effect is therefore searched in the time of each run, and has no forms.
        """
        return None


_E = TypeVar("_E", bound=Effect)


def at_each_axis(cls: type[_E], scope: Scope, **values: float) -> list[list[_E]]:
    """Return a form for each joint."""
    return [[cls.model_validate({"axis": axis, **values})] for axis in scope.axes]


def at_each_gauge(cls: type[_E], scope: Scope) -> list[list[_E]]:
    """Return a form for each gauge."""
    return [[cls.model_validate({"gauge": gauge})] for gauge in scope.gauges]


def scaled(effect: _E, share: float, **values: float) -> _E:
    """Return an effect with the size multiplied by share, and with other changed values."""
    name = size_field(effect)
    return effect.model_copy(update={name: share * getattr(effect, name), **values})


def healthy(effect: _E) -> _E:
    """Return an effect with the size for a healthy arm."""
    return effect.model_copy(update={size_field(effect): effect.healthy})


def identity(effect: _E) -> _E:
    """Return the identity of an effect: required keys, seat and form, but not size and shapes."""
    return type(effect).model_validate(
        {name: getattr(effect, name) for name, info in type(effect).model_fields.items() if info.is_required()}
    )


def name_of(effect: Effect) -> str:
    """Return the name of an effect with the seat, such as `gauge_scale g1`."""
    return f"{effect.effect} {effect.seat}".rstrip()


def label_of(effect: Effect) -> str:
    """Return the label of an effect, with the order for gear errors."""
    order = getattr(effect, "order", None)
    return name_of(effect) if order is None else f"{name_of(effect)} order {whole_order(order):g}"


def whole_order(order: float) -> float:
    """Return the displayed order of a gear wave: a whole number if the order is within a tenth of a wave of it."""
    return float(round(order)) if abs(order - round(order)) < _OF_A_WAVE and round(order) > 0 else order


def phases(effect: _E) -> tuple[_E, ...]:
    """Return an effect. For a wave also return the effect shifted by a quarter, so that both span all phases."""
    if not is_wave(effect):
        return (effect,)
    return effect, effect.model_copy(update={PHASE: (getattr(effect, PHASE) + 90.0) % 360.0})


def is_wave(effect: Effect) -> bool:
    """Return whether an effect has a free phase."""
    return hasattr(effect, PHASE)


def is_play(effect: Effect) -> bool:
    """Return whether the response of an effect is nonlinear at all sizes."""
    return effect.STRAIGHT == 0


def size_field(effect: Effect) -> str:
    """Return the name of the size parameter."""
    return size_fields(type(effect))[0]


@cache
def size_fields(cls: type[Effect]) -> tuple[str, ...]:
    """Return the keys declared by `size`. A complete effect has exactly one."""
    return tuple(str(name) for name in cls.model_fields if "healthy" in _extra(cls, name))


def _extra(cls: type[Effect], name: str) -> dict[str, Any]:
    extra = cls.model_fields[name].json_schema_extra
    return extra if isinstance(extra, dict) else {}


def bounds(effect: Effect, name: str) -> tuple[float, float]:
    """Return the range of a parameter, infinite if unbounded."""
    return _bounds(type(effect), name)


@cache
def _bounds(cls: type[Effect], name: str) -> tuple[float, float]:
    metadata = cls.model_fields[name].metadata
    low = [float(getattr(m, key)) for m in metadata for key in ("ge", "gt") if hasattr(m, key)]
    high = [float(m.le) for m in metadata if hasattr(m, "le")]
    return max(low, default=-math.inf), min(high, default=math.inf)


def one_sided(effect: Effect) -> bool:
    """Return whether a size cannot be negative: a width, a compliance, an amplitude."""
    return bounds(effect, size_field(effect))[0] == 0


def healthy_size(effect: Effect) -> float:
    """Return the size for a healthy arm, in the unit of the size."""
    return effect.healthy


def size_of(effect: Effect) -> float:
    """Return the size of an effect, in healthy sizes."""
    return float(getattr(effect, size_field(effect))) / healthy_size(effect)


WARMING_S = (60.0, 300.0, 1200.0)
"""Initial time constants in s. Chosen: ratios of about five. The fit refines them."""
SPECTRUM = (0.2, 0.5, 2.0)
"""Time constants of the parts of a real arm, relative to the effect. Chosen: motors warm up faster than castings."""
SPECTRUM_SHARE = 0.25
"""Standard deviation of the share of each part. Chosen: if a quarter of an arm warmed up five times as fast, a value
of 5 % turned a growth of 149 ppm into 120 ± 8.
"""


def warmed(t_s: Array, time_constant_s: float) -> Array:
    """Return the share (n,) of a growth at times t_s (n,) s after the start of the run."""
    share: Array = -np.expm1(-np.maximum(t_s, 0) / time_constant_s)
    return share


def warming_parts(effect: Effect) -> tuple[tuple[tuple[float, Effect], ...], ...]:
    """Return combinations of effects, with shares, for parts that grow with shorter or longer time constants."""
    tau_s = float(getattr(effect, "time_constant_s"))  # noqa: B009 - of those that grow alone
    others = [effect.model_copy(update={"time_constant_s": ratio * tau_s}) for ratio in SPECTRUM]
    return tuple(((SPECTRUM_SHARE, part), (-SPECTRUM_SHARE, effect)) for part in others)

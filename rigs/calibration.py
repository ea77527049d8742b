"""The calibrated model of an arm: everything that a diagnosis knows, as one file beside the rig file.

A rig file names effects that somebody stands by. A calibration holds the rest as well: a list of *terms*, each an
effect at a reference size and how many `times` of it the arm shows. The terms are the posterior of a diagnosis: `times`
is their mean, and `factor` a root of their covariance. What many small terms do together is accurate where no single
one of them is certain.

The file is JSON, named by the rig file with its SHA-256; docs/calibration.md reads it in twenty lines of numpy.
"""

from __future__ import annotations

import base64
import datetime as dt
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rigs.effects import AnyEffect, Effect
from rigs.schema.effect import (
    BY_TARGETS,
    PHASE,
    Compensation,
    Scope,
    Use,
    healthy,
    is_wave,
    scaled,
    size_field,
    size_of,
)
from rigs.schema.part import Axis, Part
from rigs.schema.scene import S
from rigs.schema.vocabulary import FEWEST_AXES, MOST_AXES

Array = NDArray[np.float64]
CALIBRATION = ".calibration.json"
"""What the name of a calibration file ends in."""
TIMES = "times"
"""The parameter that every term has: how many times the effect at its reference size."""
MOST_CALIBRATION_BYTES = 100_000_000
"""A file of 1500 terms has 7 MB; it grows with the square of their number."""
_MOST_TERMS = 20_000
"""Terms of a calibration. A diagnosis of poses has 1500; a root of the covariance of more is larger than a file may be.
"""
_NOTHING = 1e-4
"""Healthy sizes below which a term is left out: five hundred of them make less than a hundredth of what one healthy
effect does, and each costs as much time as a large one."""
_ROWS = 4096
"""Rows of a curve that are computed at a time: 135 waves of each take 4 MB."""


class CalibrationFile(Part):
    """What a rig file says of its calibration: the name of the file, which lies beside it, and the digest of its
    bytes."""

    file: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,120}\.calibration\.json$")]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class CalibratedRun(Part):
    """A run that a calibration comes from, with the digest of its readings."""

    name: Annotated[str, Field(max_length=300)]
    sha256: Annotated[str, Field(max_length=64)]


class PlacedSetUp(Part):
    """Where ball, gauges, instrument and target were in the runs of one set-up: places in mm, matrices row by row."""

    ball_mm: tuple[float, float, float] | None = None
    zeros_mm: tuple[float, ...] | None = None
    T_instrument_world: tuple[tuple[float, ...], ...] | None = None
    T_tool_target: tuple[tuple[float, ...], ...] | None = None


class Term(Part):
    """One term: an effect at its reference size, and how many times of it the arm shows. `named` terms stand in the
    rig file too, as effects, and are listed here because the other terms were found beside them."""

    effect: AnyEffect
    times: float
    named: bool = False


class Parameter(Part):
    """What a row of the covariance belongs to: the index of a term from 0, and one of the fields of its effect, or
    `times`."""

    term: Annotated[int, Field(ge=0)]
    field: Annotated[str, Field(max_length=40)]


class Judged(Part):
    """What a diagnosis said of its model where it was judged, rms in µm of the readings.

    `condition` is that of the diagnosis. `place` says where: at another place, on runs or poses held out, or on the
    runs used. `before_um` was left there without the model, `names_um` by the named effects alone, `whole_um` by all
    that was found, and `handed_um` by what the file holds: the names alone where these do better. `unexplained_um` is
    what the model leaves there beyond the noise, of one coordinate; every uncertainty made from the file contains it.
    """

    condition: Annotated[str, Field(max_length=40)]
    place: Literal["unseen", "held_out", "used"]
    before_um: Annotated[float, Field(ge=0)]
    names_um: Annotated[float, Field(ge=0)]
    whole_um: Annotated[float, Field(ge=0)]
    handed_um: Annotated[float, Field(ge=0)]
    noise_um: Annotated[float, Field(ge=0)]
    unexplained_um: Annotated[float, Field(ge=0)]

    @property
    def gained(self) -> float:
        """Share of the mean square beyond the noise that the model takes away there; negative where it adds."""
        floor = self.noise_um**2
        return 1 - max(self.handed_um**2 - floor, 0.0) / max(self.before_um**2 - floor, 1e-12)


class CalibratedModel(Part):
    """The content of a calibration file.

    `factor` is the lower triangle, row by row, of a root L of the covariance L L' of the `parameters`: little-endian
    float32, base64. `joints_deg` has the lowest and the highest angle of each joint in the runs, and `rail_mm` where a
    rail stood, of an arm on one; outside it the terms are what they were expected to be. `reach_mm`, of touches alone,
    is the farthest that a placement that judged the model was from the sockets of others. `held_out_um` is the rms in
    µm that the model left at places that had no part in it, None where none were left out. `widened` is the factor in L
    by which such places, or neighbourhoods of poses beside all others, were missed by more than the readings that were
    used explain. `judged` is what the diagnosis said of the model, None in files of earlier versions.
    """

    format: Literal[1] = 1
    rig: str
    date: dt.date
    version: str
    runs: tuple[CalibratedRun, ...]
    joints_deg: tuple[tuple[float, float], ...] = Field(min_length=FEWEST_AXES, max_length=MOST_AXES)
    rail_mm: tuple[float, float] | None = Field(default=None, exclude_if=lambda value: value is None)
    reach_mm: float | None = Field(default=None, ge=0, exclude_if=lambda value: value is None)
    setups: dict[str, PlacedSetUp]
    before_um: float
    calibrated_um: float
    held_out_um: float | None = None
    widened: Annotated[float, Field(ge=1)] = 1.0
    judged: Judged | None = Field(default=None, exclude_if=lambda value: value is None)
    terms: tuple[Term, ...] = Field(max_length=_MOST_TERMS)
    parameters: tuple[Parameter, ...] = Field(max_length=_MOST_TERMS)
    factor: str

    @classmethod
    def read(cls, content: bytes) -> CalibratedModel:
        """Return the model of the bytes of a calibration file, which it keeps. Raises ValidationError."""
        model = cls.model_validate_json(content)
        vars(model)["content"] = content  # as `content` would keep it
        return model

    @cached_property
    def content(self) -> bytes:
        """The bytes of its file: those that it was read from, of which a rig file has the digest, or new ones."""
        return self.model_dump_json(indent=1).encode()

    @model_validator(mode="after")
    def _whole(self) -> Self:
        for parameter in self.parameters:
            if parameter.term >= len(self.terms):
                raise ValueError(f"a parameter belongs to term {parameter.term}, and there are {len(self.terms)} terms")
            effect = self.terms[parameter.term].effect
            if parameter.field != TIMES and not isinstance(getattr(effect, parameter.field, None), float):
                raise ValueError(f"a parameter is {parameter.field} of {effect.effect}, which has no such number")
        frames = [frame for setup in self.setups.values() for frame in (setup.T_instrument_world, setup.T_tool_target)]
        sizes = {(len(frame or ()), *map(len, frame or ())) for frame in frames}
        if self.reach_mm is not None and sizes != {(4, 4, 4, 4, 4)}:
            raise ValueError("reach_mm is of touches, and a set-up has no frames of instrument and target")
        count = len(self.parameters)
        try:
            packed = base64.b64decode(self.factor, validate=True)
        except ValueError:
            raise ValueError("factor is not base64") from None
        if len(packed) != 2 * count * (count + 1):
            raise ValueError(f"factor has {len(packed)} bytes, and {count} parameters need {2 * count * (count + 1)}")
        if not np.isfinite(np.frombuffer(packed, dtype="<f4")).all():
            raise ValueError("factor holds numbers that are not finite")
        return self

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """The terms that the rig file does not name, as effects of the arm: constants summed, waves of a joint as one
        curve."""
        return tuple(effects_of([(term.effect, term.times) for term in self.terms if not term.named]))

    @cached_property
    def root(self) -> Array:
        """A root (P, P) of the covariance of the parameters, lower triangular."""
        count = len(self.parameters)
        root = np.zeros((count, count))
        root[np.tril_indices(count)] = np.frombuffer(base64.b64decode(self.factor), dtype="<f4")
        return root


Verdict = Literal["correct", "nothing"]
Ground = Literal["not_judged", "explained", "gains_elsewhere", "unknown_cause", "no_gain_elsewhere", "not_shown"]
"""Why a model is corrected by, or not: no run judged it; the runs used are explained; it takes away error where it had
no part; what explains the readings is in no library; it takes away nothing where it had no part; or its runs cannot
show what is wrong, as four poses, which more unknowns explain."""
_LEAST_GAIN = 0.3
"""Share of the mean square that a model must take away where it had no part to be corrected by although an unknown
cause remains. Source: a rule that was tried on generated cells of foreign effects, where worse models gained less."""


def ground_of(calibrated: CalibratedModel) -> Ground:
    """Return the ground on which a model is corrected by, or not; the figures are in its `judged`."""
    judged = calibrated.judged
    if judged is None:
        return "not_judged"
    if judged.condition == "not_testable_here":
        return "not_shown"
    if judged.place == "used":
        return "unknown_cause" if judged.condition == "outside_library" else "explained"
    if judged.handed_um >= judged.before_um:
        return "no_gain_elsewhere"
    if judged.condition == "outside_library" and judged.gained < _LEAST_GAIN:
        return "unknown_cause"
    return "gains_elsewhere"


def verdict_of(calibrated: CalibratedModel) -> Verdict:
    """Return whether targets, programs and entries may be corrected by a model. It is said nowhere else."""
    return "correct" if ground_of(calibrated) in ("not_judged", "explained", "gains_elsewhere") else "nothing"


def packed_factor(root: Array) -> str:
    """Return a lower triangular root (P, P) of a covariance, each row in the unit of its parameter, as a calibration
    file holds it."""
    return base64.b64encode(root[np.tril_indices(len(root))].astype("<f4").tobytes()).decode("ascii")


def is_nothing(effect: Effect, times: float) -> bool:
    """Return whether so many times an effect is so little that a model leaves it out."""
    return abs(times * size_of(effect)) < _NOTHING


def effects_of(terms: Sequence[tuple[Effect, float]]) -> list[Effect]:
    """Return the effects that terms, each an effect and how many times of it, make up together."""
    waves: dict[int, list[tuple[float, float, float]]] = {}
    sums: dict[Effect, float] = {}
    for term, times in terms:
        effect = term.model_copy(update={"found": None})  # it says nothing of the arm, and has no hash
        if is_nothing(effect, times):
            continue
        if is_sine(effect):
            axis, order, phase, size = sine_of(effect)
            amplitude = times * math.degrees(size)
            waves.setdefault(axis, []).append((order, amplitude * math.cos(phase), amplitude * math.sin(phase)))
        else:
            # Of constants the terms of one seat add up, whatever their reference sizes.
            unit = healthy(effect) if effect.STAGE == "arm" else effect
            sums[unit] = sums.get(unit, 0.0) + times * (size_of(effect) if unit is not effect else 1.0)
    curves: list[Effect] = [JointCurve(axis=axis, waves=tuple(parts)) for axis, parts in waves.items()]
    whole: list[Effect] = []
    joints: dict[Use, list[Portion]] = {}
    gauges: list[Portion] = []
    for effect, times in sums.items():
        if effect.STAGE == "gauge":
            gauges.append(Portion(of=effect, times=times))
        elif effect.STAGE == "joint" and effect.compensation().constant is None:
            joints.setdefault(effect.compensation().use, []).append(Portion(of=effect, times=times))
        else:
            whole.append(scaled(effect, times))
    together = [JointPortions(portions=tuple(parts)) for parts in joints.values()]
    return [*whole, *curves, *together, *([GaugePortions(portions=tuple(gauges))] if gauges else [])]


def is_sine(effect: Effect) -> bool:
    """Return whether it turns a joint by a sine of its angle: a wave with an order, and with no other shape."""
    if effect.STAGE != "joint" or not is_wave(effect) or not hasattr(effect, "order"):
        return False
    return not any(getattr(effect, shape.field) for shape in effect.FREE)


def sine_of(effect: Effect) -> tuple[int, float, float, float]:
    """Return the axis of a sine, its order in cycles a turn, and its phase and amplitude in rad."""
    wave: Any = effect
    return wave.axis, wave.order, math.radians(getattr(wave, PHASE)), math.radians(getattr(wave, size_field(wave)))


class _Calibrated(Effect):
    """An effect that only a calibration makes: no rig file names it and no diagnosis looks for it."""

    share: float = Field(default=1.0, json_schema_extra={"healthy": 1.0})

    @classmethod
    def forms(cls, scope: Scope) -> list[list[Self]]:
        """None: nothing looks for it."""
        return []

    def remedy(self) -> str:
        return "use the calibrated model"


class JointCurve(_Calibrated):
    """The angle error of a joint as a curve over its angle: `share` of waves (order, sine, cosine), in cycles a turn
    and degrees."""

    effect: Literal["joint_curve"] = "joint_curve"
    axis: Axis
    waves: tuple[tuple[float, float, float], ...]

    STAGE = "joint"

    def apply(self, scene: S) -> S:
        """The joint is turned by the curve at its reported angle."""
        return scene.turned(self.axis, np.radians(self.share * self.at(scene.q[:, self.axis - 1])))

    def at(self, q: Array) -> Array:
        """Return the curve (n,) in degrees at reported angles q (n,) rad."""
        order, sine, cosine = np.array(self.waves).T
        begins = np.flatnonzero(np.diff(q, prepend=np.nan) != 0)  # a robot that stands has one angle many times
        angles, curve_deg = q[begins], np.empty(len(begins))
        for begin in range(0, len(angles), _ROWS):
            turn = angles[begin : begin + _ROWS, None] * order
            curve_deg[begin : begin + _ROWS] = np.sin(turn) @ sine + np.cos(turn) @ cosine
        return np.repeat(curve_deg, np.diff(begins, append=len(q)))

    def plain(self, joint: str) -> str:
        return f"angle error of {joint} over its angle"

    def compensation(self) -> Compensation:
        """It depends on the posture alone."""
        return BY_TARGETS


class Portion(Part):
    """How many times what an effect does. A play lags by no fixed part of its width and a gauge's cosine error is no
    fixed part of its angle, so the change that the whole effect makes is scaled and not its size."""

    of: AnyEffect
    times: float


class _Portions(_Calibrated):
    """What portions of effects of one stage do together."""

    portions: tuple[Portion, ...] = Field(min_length=1)

    def apply(self, scene: S) -> S:
        """The scene with what all portions change of it."""
        changed = scene
        for portion in self.portions:
            changed = changed.blended(scene, portion.of.apply(scene), self.share * portion.times)
        return changed

    def compensation(self) -> Compensation:
        """The same as each of the effects, which have it in common."""
        return self.portions[0].of.compensation()


class JointPortions(_Portions):
    """What portions of effects turn joints by."""

    effect: Literal["joint_portions"] = "joint_portions"

    STAGE = "joint"

    def plain(self, joint: str) -> str:
        axes = {getattr(portion.of, "axis", None) for portion in self.portions} - {None}
        joint = f"axis {axes.pop()}" if len(axes) == 1 else "axes"
        return ", ".join(dict.fromkeys(portion.of.plain(joint) for portion in self.portions))


class GaugePortions(_Portions):
    """What portions of effects change of the readings."""

    effect: Literal["gauge_portions"] = "gauge_portions"

    STAGE = "gauge"

    def plain(self, joint: str) -> str:
        return f"{len(self.portions)} small errors of gauges"

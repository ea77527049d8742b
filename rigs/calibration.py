"""Calibrated model of an arm, the result of a diagnosis, in a JSON file that the rig file names with its SHA-256.

It lists *terms*, each an effect at a reference size with a multiple `times`, and the covariance of the multiples. The
sum of many small terms can be accurate although none of them is certain (docs/calibration.md).
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
    bounds,
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
TIMES = "times"
"""Parameter of every term: the multiple of the reference size."""
MOST_CALIBRATION_BYTES = 100_000_000
"""Size limit. A file with 1500 terms has 7 MB, and the size grows with the square of the number of terms."""
_MOST_TERMS = 20_000
"""Above it `factor` would exceed the size limit. A diagnosis of poses has 1500."""
_NOTHING = 1e-4
"""Healthy sizes below which a term is dropped: five hundred such terms together change the readings by less than a
hundredth of a healthy size.
"""
_ROWS = 4096
"""Number of rows of a curve computed together: 135 waves take 4 MB."""


class CalibrationFile(Part):
    """Reference in a rig file: name of the calibration file in the same directory, and its digest."""

    file: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,120}\.calibration\.json$")]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


MOST_POSTURES = 60
"""Number of measured postures in a calibration, as many as are otherwise spread over the range of the joints."""


class CalibratedRun(Part):
    name: Annotated[str, Field(max_length=300)]
    sha256: Annotated[str, Field(max_length=64)]


class PlacedSetUp(Part):
    """Positions of ball, gauges, instrument and target in a set-up. Places are in mm, matrices row by row."""

    ball_mm: tuple[float, float, float] | None = None
    zeros_mm: tuple[float, ...] | None = None
    T_instrument_world: tuple[tuple[float, ...], ...] | None = None
    T_tool_target: tuple[tuple[float, ...], ...] | None = None


class Term(Part):
    effect: AnyEffect
    times: float
    named: bool = False
    """Also an effect of the rig file. It is listed here because the others were estimated together with it."""


class CovarianceParameter(Part):
    """Meaning of a covariance row: index of a term from 0, and a field of the effect, or `times`."""

    term: Annotated[int, Field(ge=0)]
    field: Annotated[str, Field(max_length=40)]


Micrometres = Annotated[float, Field(ge=0)]


class ModelAssessment(Part):
    condition: Annotated[str, Field(max_length=40)]
    """Condition of the diagnosis."""
    place: Literal["unseen", "held_out", "used"]
    """Readings of the assessment: at a different place, held-out runs or poses, or the runs used."""
    before_um: Micrometres
    names_um: Micrometres
    """With only the named effects."""
    whole_um: Micrometres
    """With the complete model."""
    handed_um: Micrometres
    """With the effects stored in this file: the complete model, or the named effects if they give a smaller rms."""
    noise_um: Micrometres
    unexplained_um: Micrometres
    """Error per coordinate beyond the noise, which every uncertainty computed from the file includes."""
    left_out_um: Micrometres | None = Field(default=None, exclude_if=lambda value: value is None)
    """By which the model of all other poses misses each neighbourhood of similar poses, without another validation."""

    measure_first: bool = Field(default=False, exclude_if=lambda value: not value)
    """The diagnosis asks for other readings before a correction."""
    measure_why: Annotated[str, Field(max_length=40)] = Field(default="", exclude_if=lambda value: not value)
    """Reason of this act (docs/diagnosis-json.md). Empty in files of earlier versions, whose reason is `elsewhere`."""

    @property
    def gained(self) -> float:
        """Share of the mean square beyond the noise that the model removes; negative if it adds error."""
        return self.gain(self.handed_um)

    def gain(self, left_um: float) -> float:
        floor = self.noise_um**2
        return 1 - max(left_um**2 - floor, 0.0) / max(self.before_um**2 - floor, 1e-12)


class CalibratedModel(Part):
    format: Literal[1] = 1
    rig: str
    date: dt.date
    version: str
    runs: tuple[CalibratedRun, ...]
    joints_deg: tuple[tuple[float, float], ...] = Field(min_length=FEWEST_AXES, max_length=MOST_AXES)
    """Range of each joint in the runs. Outside of it, and of `rail_mm`, the terms equal their prior."""
    postures_deg: tuple[tuple[float, ...], ...] = Field(
        default=(), max_length=MOST_POSTURES, exclude_if=lambda value: not value
    )
    """Measured postures, evenly drawn from those of all poses and touches. Empty for circles, and for an arm on a
    rail."""
    rail_mm: tuple[float, float] | None = Field(default=None, exclude_if=lambda value: value is None)
    reach_mm: float | None = Field(default=None, ge=0, exclude_if=lambda value: value is None)
    """Largest distance between a validating placement and the other sockets, for touches only."""
    setups: dict[str, PlacedSetUp]
    before_um: float
    calibrated_um: float
    held_out_um: float | None = None
    """rms at places excluded from the fit, if any."""
    widened: Annotated[float, Field(ge=1)] = 1.0
    """Ratio of the real to the expected error at such places or held-out poses, at least Student's t for their number.

    `factor` is already multiplied by it.
    """
    judged: ModelAssessment | None = Field(default=None, exclude_if=lambda value: value is None)
    """None in files of earlier versions."""
    terms: tuple[Term, ...] = Field(max_length=_MOST_TERMS)
    parameters: tuple[CovarianceParameter, ...] = Field(max_length=_MOST_TERMS)
    factor: str
    """Lower triangle, row by row, of a root L of the covariance L L' of the parameters: base64 of float32, LE."""

    @classmethod
    def read(cls, content: bytes) -> CalibratedModel:
        """Parse the bytes of a calibration file and keep them. Raises ValidationError."""
        model = cls.model_validate_json(content)
        vars(model)["content"] = content  # cached for `content`
        return model

    def with_values(self, **values: Any) -> CalibratedModel:
        """A copy with other values, not checked again, and without the cached root, effects and content."""
        kept = {name: getattr(self, name) for name in CalibratedModel.model_fields}
        return CalibratedModel.model_construct(**kept | values)

    @cached_property
    def content(self) -> bytes:
        """Bytes of the file: as read, because a rig file has their digest, or new ones."""
        return self.model_dump_json(indent=1).encode()

    @model_validator(mode="after")
    def _check_parameters(self) -> Self:
        for parameter in self.parameters:
            if parameter.term >= len(self.terms):
                raise ValueError(
                    f"a parameter refers to term {parameter.term}, but there are only {len(self.terms)} terms"
                )
            effect = self.terms[parameter.term].effect
            if parameter.field != TIMES and not isinstance(getattr(effect, parameter.field, None), float):
                raise ValueError(
                    f"a parameter refers to {parameter.field} of {effect.effect}, which is not a number of that effect"
                )
        frames = [frame for setup in self.setups.values() for frame in (setup.T_instrument_world, setup.T_tool_target)]
        sizes = {(len(frame or ()), *map(len, frame or ())) for frame in frames}
        if self.reach_mm is not None and sizes != {(4, 4, 4, 4, 4)}:
            raise ValueError("reach_mm applies to touches, which have no frames of instrument and target")
        count = len(self.parameters)
        try:
            packed = base64.b64decode(self.factor, validate=True)
        except ValueError:
            raise ValueError("factor is not base64") from None
        if len(packed) != 2 * count * (count + 1):
            raise ValueError(f"factor has {len(packed)} bytes, but {count} parameters need {2 * count * (count + 1)}")
        if not np.isfinite(np.frombuffer(packed, dtype="<f4")).all():
            raise ValueError("factor contains numbers that are not finite")
        return self

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """Terms that are not in the rig file, as effects of the arm.

        Constants are added, and the waves of a joint are combined into a curve.
        """
        return tuple(effects_of([(term.effect, term.times) for term in self.terms if not term.named]))

    @cached_property
    def root(self) -> Array:
        count = len(self.parameters)
        root = np.zeros((count, count))
        root[np.tril_indices(count)] = np.frombuffer(base64.b64decode(self.factor), dtype="<f4")
        return root


Verdict = Literal["correct", "nothing"]
Ground = Literal["not_judged", "explained", "gains_elsewhere", "unknown_cause", "no_gain_elsewhere", "not_shown"]
"""In order: no run validated the model; the runs used are explained; it reduces the error at excluded places; an
unknown cause remains; it does not reduce the error there; the runs cannot show the fault.
"""
_LEAST_GAIN = 0.3
"""Share of the mean square at excluded places or poses that a model must remove to be used despite an unknown cause.

Source: tried on generated cells with foreign effects, where worse models removed less.
"""
_LEAST_OPEN = 0.05
"""Share of the mean square beyond the noise that a model must leave for deviations of an open cause to prevent a
correction. Source: 0.10 to 0.20 for three models of a gen3lite, which missed the placement left out by 1.7 to 4.4 mm.
"""


def ground_of(calibrated: CalibratedModel) -> Ground:
    judged = calibrated.judged
    if judged is None:
        return "not_judged"
    if judged.condition == "not_testable_here":
        return "not_shown"
    if judged.place == "used":
        # Nothing unusual was found, but large deviations may be scatter or an error of an unknown cause.
        is_open = judged.unexplained_um > judged.noise_um and 1 - judged.gained > _LEAST_OPEN
        is_unknown = judged.condition == "outside_library" or (judged.condition == "nothing_unusual" and is_open)
        if not is_unknown:
            return "explained"
        left_out_um = judged.left_out_um
        is_predicted = left_out_um is not None and judged.gain(left_out_um) >= _LEAST_GAIN
        return "gains_elsewhere" if is_predicted else "unknown_cause"
    if judged.handed_um >= judged.before_um:
        return "no_gain_elsewhere"
    is_unknown = judged.condition == "outside_library" and judged.gained < _LEAST_GAIN
    return "unknown_cause" if is_unknown else "gains_elsewhere"


def verdict_of(calibrated: CalibratedModel) -> Verdict:
    """Whether a model may correct targets, programs and controller entries; decided here only."""
    return "correct" if ground_of(calibrated) in ("not_judged", "explained", "gains_elsewhere") else "nothing"


_JITTER = 1e-9
"""Added to the diagonal of a correlation matrix before computing its root, because indistinguishable terms have a
correlation of 1 within rounding.
"""


def covariance_root(covariance: Array) -> Array:
    """A lower triangular root (P, P) of a covariance with any rank, each row in the unit of its parameter."""
    sd = np.sqrt(np.diag(covariance))
    unit = np.where(sd > 0, sd, 1.0)
    correlation = covariance / unit[:, None] / unit
    correlation[np.diag_indices_from(correlation)] += _JITTER
    return np.asarray(unit[:, None] * np.linalg.cholesky(correlation), dtype=float)


def largest_sd(effect: Effect, field: str) -> float:
    """Largest plausible uncertainty of a parameter: its bound in a rig file, infinite without one."""
    if field != TIMES:
        return bounds(effect, field)[1]
    size = abs(float(getattr(effect, size_field(effect))))
    return bounds(effect, size_field(effect))[1] / size if size else math.inf


def limited_root(root: Array, terms: Sequence[Term], parameters: Sequence[CovarianceParameter]) -> Array:
    most = np.array([largest_sd(terms[parameter.term].effect, parameter.field) for parameter in parameters])
    sd = np.linalg.norm(root, axis=1)
    return np.asarray(root * np.minimum(1.0, most / np.where(sd > 0, sd, 1.0))[:, None], dtype=float)


def packed_factor(root: Array) -> str:
    return base64.b64encode(root[np.tril_indices(len(root))].astype("<f4").tobytes()).decode("ascii")


def is_nothing(effect: Effect, times: float) -> bool:
    return abs(times * size_of(effect)) < _NOTHING


def effects_of(terms: Sequence[tuple[Effect, float]]) -> list[Effect]:
    waves: dict[int, list[tuple[float, float, float]]] = {}
    sums: dict[Effect, float] = {}
    for term, times in terms:
        if is_nothing(term, times):
            continue
        effect = term if term.found is None else term.model_copy(update={"found": None})  # unhashable
        if is_sine(effect):
            axis, order, phase, size = sine_of(effect)
            amplitude = times * math.degrees(size)
            waves.setdefault(axis, []).append((order, amplitude * math.cos(phase), amplitude * math.sin(phase)))
        else:
            # Terms for the same constant add up, for any reference sizes.
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
    """True if an effect turns a joint by a sine of the joint angle: a wave with an order and no other shape."""
    if effect.STAGE != "joint" or not is_wave(effect) or not hasattr(effect, "order"):
        return False
    return not any(getattr(effect, shape.field) for shape in effect.FREE)


def sine_of(effect: Effect) -> tuple[int, float, float, float]:
    """Axis, the order in cycles per turn, and the phase and amplitude in rad of a sine."""
    wave: Any = effect
    return wave.axis, wave.order, math.radians(getattr(wave, PHASE)), math.radians(getattr(wave, size_field(wave)))


class _Calibrated(Effect):
    """Base of effects that are created only by a calibration, never by a rig file or a search."""

    share: float = Field(default=1.0, json_schema_extra={"healthy": 1.0})

    @classmethod
    def forms(cls, scope: Scope) -> list[list[Self]]:
        return []

    def remedy(self) -> str:
        return "use the calibrated model"


class JointCurve(_Calibrated):
    """Angle error of a joint as a curve over the joint angle.

    `share` contains the waves (order, sine, cosine) in cycles per turn and degrees.
    """

    effect: Literal["joint_curve"] = "joint_curve"
    axis: Axis
    waves: tuple[tuple[float, float, float], ...]

    STAGE = "joint"

    def apply(self, scene: S) -> S:
        return scene.turned(self.axis, np.radians(self.share * self.at(scene.q[:, self.axis - 1])))

    def at(self, q: Array) -> Array:
        order, sine, cosine = np.array(self.waves).T
        begins = np.flatnonzero(np.diff(q, prepend=np.nan) != 0)  # a robot at rest repeats the angle
        angles, curve_deg = q[begins], np.empty(len(begins))
        for begin in range(0, len(angles), _ROWS):
            turn = angles[begin : begin + _ROWS, None] * order
            curve_deg[begin : begin + _ROWS] = np.sin(turn) @ sine + np.cos(turn) @ cosine
        return np.repeat(curve_deg, np.diff(begins, append=len(q)))

    def plain(self, joint: str) -> str:
        return f"angle error of {joint} over its angle"

    def compensation(self) -> Compensation:
        return BY_TARGETS


class Portion(Part):
    """An effect, and the multiple of its change, because not every change is proportional to the size."""

    of: AnyEffect
    times: float


class _Portions(_Calibrated):
    portions: tuple[Portion, ...] = Field(min_length=1)

    def apply(self, scene: S) -> S:
        changed = scene
        for portion in self.portions:
            changed = changed.blended(scene, portion.of.apply(scene), self.share * portion.times)
        return changed

    def compensation(self) -> Compensation:
        return self.portions[0].of.compensation()


class JointPortions(_Portions):
    effect: Literal["joint_portions"] = "joint_portions"

    STAGE = "joint"

    def plain(self, joint: str) -> str:
        axes = {getattr(portion.of, "axis", None) for portion in self.portions} - {None}
        joint = f"axis {axes.pop()}" if len(axes) == 1 else "axes"
        return ", ".join(dict.fromkeys(portion.of.plain(joint) for portion in self.portions))


class GaugePortions(_Portions):
    effect: Literal["gauge_portions"] = "gauge_portions"

    STAGE = "gauge"

    def plain(self, joint: str) -> str:
        return f"{len(self.portions)} small errors of gauges"

"""Result of a pair: constants of both arms, transform between their bases, scale, and what is not testable."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from analysis.apps.pair.arm_terms import scale_shares
from analysis.apps.pair.fit_pair import FittedPair
from analysis.robot.kinematics.arm import Array, roll_pitch_yaw
from rigs.schema.effect import size_field
from rigs.schema.part import Vector

_SHOWN = 0.5
"""Share of the prior below which u counts as measured."""
_RIG_DIGITS = 6


@dataclass(frozen=True)
class PairConstant:
    """nominal + delta ± u, in the unit of the key in the rig file."""

    arm: str
    axis: int
    key: str
    symbol: str
    delta: float
    u: float
    shown: bool
    """False if u is mostly that of the prior."""

    @property
    def unit(self) -> str:
        return "mm" if self.key.endswith("_mm") else "°"


@dataclass(frozen=True)
class BaseTransform:
    """Second base in the first, with fixed-axis roll, pitch and yaw."""

    xyz_mm: Vector
    rpy_deg: Vector
    u_xyz_mm: Vector
    u_rotation_deg: Vector
    distance_mm: float
    u_distance_mm: float
    work_mm: Vector
    """Centre of the touches in the first base."""
    u_work_mm: Vector


@dataclass(frozen=True)
class Scale:
    """Scale of all lengths, with its u and that of the nominal lengths."""

    ppm: float
    u_ppm: float
    nominal_u_ppm: float
    known: bool


@dataclass(frozen=True)
class NotTestable:
    arm: str
    what: str
    reason: str


@dataclass(frozen=True)
class PairResult:
    names: tuple[str, str]
    touches: int
    before_mm: float
    left_mm: float
    scatter_mm: float
    unexplained_mm: tuple[float, float]
    base: BaseTransform
    scale: Scale
    constants: tuple[PairConstant, ...]
    ball_mm: Vector
    u_ball_mm: Vector
    sockets: dict[str, tuple[Vector, Vector]]
    not_testable: tuple[NotTestable, ...]
    odd: tuple[tuple[int, float], ...]
    doubts: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        return {
            "first": self.names[0], "second": self.names[1], "touches": self.touches, "before_mm": self.before_mm,
            "left_mm": self.left_mm, "scatter_mm": self.scatter_mm,
            "unexplained_mm": dict(zip(self.names, self.unexplained_mm, strict=True)),
            "base": asdict(self.base), "scale": asdict(self.scale),
            "constants": [asdict(constant) for constant in self.constants],
            "ball": {"xyz_mm": list(self.ball_mm), "u_mm": list(self.u_ball_mm)},
            "sockets": {name: {"xyz_mm": list(at), "u_mm": list(u)} for name, (at, u) in self.sockets.items()},
            "not_testable": [asdict(hidden) for hidden in self.not_testable],
            "left_out": [{"row": row, "off_mm": off} for row, off in self.odd], "doubts": list(self.doubts),
        }  # fmt: skip


def result_of(fit: FittedPair) -> PairResult:
    pair, result = fit.pair, fit.posterior
    sd = np.sqrt(np.diag(result.cov))
    terms = sum(len(arm.terms) for arm in pair.arms)
    names = (pair.first.rig.name, pair.second.rig.name)
    constants = tuple(_constants(fit, sd))
    scale = _scale(fit)
    places = sd[terms + 9 :].reshape(-1, 3)
    sockets = {
        name: (_vector(at), _vector(u)) for (name, at), u in zip(fit.state.sockets_mm.items(), places, strict=True)
    }
    left_mm = float(np.sqrt(np.mean(result.left_mm**2)))
    return PairResult(
        names, len(pair.table.q), fit.nominal_rms_mm, left_mm, result.levels.scatter_mm, result.levels.unexplained_mm,
        _base(fit), scale, constants, _vector(fit.state.ball_mm), _vector(sd[terms + 6 : terms + 9]), sockets,
        tuple(_not_testable(fit, constants, scale)), fit.odd, tuple(_doubts(fit, left_mm)),
    )  # fmt: skip


def _constants(fit: FittedPair, sd: Array) -> Iterator[PairConstant]:
    k = 0
    for arm in fit.pair.arms:
        for term in arm.terms:
            mean, u, prior = fit.posterior.mean[k], sd[k], fit.posterior.prior_sd[k]
            k += 1
            constant = term.effect.compensation().constant
            if constant is None:
                continue
            unit = float(getattr(term.effect, size_field(term.effect)))
            axis, key = constant[0], "offset_deg" if constant[1] == "q_deg" else constant[1]
            value, u_value = float(mean * unit), float(u * unit)
            symbol = f"{'zero' if key == 'offset_deg' else key.rpartition('_')[0]} of axis {axis}"
            yield PairConstant(arm.rig.name, axis, key, symbol, value, u_value, bool(u < _SHOWN * prior))


def _base(fit: FittedPair) -> BaseTransform:
    first, second = (arm.model.arm.T_world_base for arm in fit.pair.arms)
    inverse = np.linalg.inv(first)
    T = inverse @ fit.state.T_first_second @ second
    terms = sum(len(arm.terms) for arm in fit.pair.arms)
    cov = fit.posterior.cov[terms : terms + 6, terms : terms + 6]
    centre = fit.gaps.centre_mm
    origin = (fit.state.T_first_second @ second)[:3, 3] - centre
    R = inverse[:3, :3]
    # The set-up rotates about the centre of the work, so its origin moves by the shift and by the rotation times its
    # distance.
    at_base = R @ np.concatenate([np.eye(3), -np.cross(np.eye(3), origin)], axis=1)
    u_base = at_base @ cov @ at_base.T
    along = T[:3, 3] / max(float(np.linalg.norm(T[:3, 3])), 1e-9)
    return BaseTransform(
        _vector(T[:3, 3]), _vector(np.degrees(roll_pitch_yaw(T))), _vector(np.sqrt(np.diag(u_base))),
        _vector(np.degrees(np.sqrt(np.diag(R @ cov[3:, 3:] @ R.T)))), float(np.linalg.norm(T[:3, 3])),
        float(np.sqrt(along @ u_base @ along)), _vector(R @ centre + inverse[:3, 3]),
        _vector(np.sqrt(np.diag(R @ cov[:3, :3] @ R.T))),
    )  # fmt: skip


def _scale(fit: FittedPair) -> Scale:
    shares = np.concatenate([scale_shares(arm) for arm in fit.pair.arms])
    count = len(shares)
    prior = fit.posterior.prior_sd[:count]
    information = float(((shares / prior) ** 2).sum())
    if information == 0.0:
        return Scale(0.0, 0.0, 0.0, True)
    weights = shares / prior**2 / information
    ppm = 1000 * float(weights @ fit.posterior.mean[:count])
    u = 1000 * float(np.sqrt(weights @ fit.posterior.cov[:count, :count] @ weights))
    prior_u = 1000 / np.sqrt(information)
    return Scale(ppm, u, float(prior_u), bool(u < _SHOWN * prior_u))


def _not_testable(fit: FittedPair, constants: tuple[PairConstant, ...], scale: Scale) -> Iterator[NotTestable]:
    if not scale.known:
        reason = (
            "all lengths times one factor leave every touch as it is; a known distance of two sockets fixes it "
            "(tests.touch.distances)"
        )
        yield NotTestable("", f"scale of both arms, ± {scale.u_ppm:.0f} ppm by the nominal lengths", reason)
    for arm, holds in zip(fit.pair.arms, ("ball", "socket"), strict=True):
        yield NotTestable(arm.rig.name, "constants and zero of axis 1", "they change only the base frame")
        last = f"zero and d of axis {arm.axes}"
        yield NotTestable(arm.rig.name, last, f"they move only the place of the {holds} on the flange")
        weak = [it.symbol for it in constants if it.arm == arm.rig.name and not it.shown]
        if weak:
            reason = "these postures hardly separate them; their u mostly reflects the usual size in such arms"
            yield NotTestable(arm.rig.name, ", ".join(weak), reason)
        if not any(term.group == "gravity" for term in arm.terms):
            reason = "the rig file contains no masses"
            yield NotTestable(arm.rig.name, "deflection of the joints under load", reason)


def _doubts(fit: FittedPair, left_mm: float) -> Iterator[str]:
    for row, off in fit.odd:
        yield f"row {row} does not fit the others by {off:.2f} mm and is left out: was the ball seated?"
    if left_mm >= fit.nominal_rms_mm:
        yield "the calibrations predict touches no better than the nominal arms: touch in more postures"
    for arm, joints in ((fit.pair.first, fit.pair.table.q), (fit.pair.second, fit.pair.table.p)):
        still = [str(axis) for axis, turn in enumerate(np.nanmax(joints, axis=0) - np.nanmin(joints, axis=0), start=1)
                 if turn < _STILL_RAD]  # fmt: skip
        if still:
            yield f"{arm.rig.name}: axis {', '.join(still)} hardly turned, so these constants cannot be determined"


_STILL_RAD = float(np.radians(20.0))
"""Range of an axis that hardly moved: it changes the lever arm of an error by a few percent."""


def _vector(values: Array) -> Vector:
    x, y, z = (round(float(value), _RIG_DIGITS) for value in values)
    return x, y, z

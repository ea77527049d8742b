"""The origin of the points of a program, and the new numbers that follow from it.

A *computed* point states where the tool shall be. A *taught* point states where an arm was while its tool was right, so
its numbers already contain the error of that arm. A taught point stays right as long as arm and controller are
unchanged. After a change the new numbers bring the tool back to its taught place.

Every origin solves the same problem: `q_then` are the readings at which the controller placed the point, and `q_now`
the readings at which the tool is right now. The number of a pose is the pose that the controller computes at `q_now`.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from analysis.correction.corrected_targets import (
    CorrectedTargets,
    NotCorrected,
    WorkError,
    beyond_limits,
    corrected,
    reached_angles,
    singular,
)
from analysis.correction.pose_uncertainty import covered, places_u_mm, pose_uncertainty, why_unknown
from analysis.correction.support import Support, supports
from analysis.correction.work import (
    FEWEST_TAUGHT,
    left_out_mm,
    real_model,
    rest_effects,
    rest_mm,
    taught_angles,
    tool_places,
    tool_poses,
    used_effects,
)
from analysis.robot.kinematics.arm import Arm, Array, Mask, controller_arm, controller_robot, forward
from analysis.robot.predict import geometric_arm, model_of
from rigs.effects import Effect
from rigs.rig import Rig

PointKind = Literal["computed", "taught"]
UNKNOWN_SHARE = 0.01
"""Uncertainty of a converted pose if the constants of the controller are unknown, as a share of the change of its
numbers. The twists of delivered arms differ from the data sheet by up to 13 mrad (rms 5 mrad; 19 arms of Universal
Robots, docs/evidence/real-arms.md), and a change of the numbers turns by as much."""


@dataclass(frozen=True)
class NewPoints:
    """Readings and numbers for n points. Values of points without a solution are NaN or unchanged."""

    q: Array
    """Readings (n, 6) rad at which the tool is right."""
    T: Array
    """Poses (n, 4, 4) that the controller computes there."""
    done: Mask
    left: tuple[NotCorrected, ...]
    u_mm: Array
    """Standard uncertainty (n,) of the place of the tool in the robot's base."""
    u_frame_mm: Array
    """The same in a frame taught with the robot."""
    unknown: tuple[str, ...]
    """Reason (n,) for an unknown uncertainty; empty if known."""
    errors: Mapping[PointKind, WorkError]
    """Error of the tool with the old and the new numbers by origin, if it depends on a model and points are covered."""

    @classmethod
    def of(cls, targets: CorrectedTargets, arm: Arm) -> NewPoints:
        return cls(
            targets.q, forward(arm, targets.q), targets.done, targets.left, targets.u_mm, targets.u_frame_mm,
            targets.unknown, {"computed": targets.error} if targets.error else {},
        )  # fmt: skip


@dataclass(frozen=True)
class PointOrigin(ABC):
    """Origin of points, with the changes since then."""

    is_unchanged: ClassVar[bool] = False
    """True if the numbers are right as they are."""
    is_exact: ClassVar[bool] = False
    """True if the new numbers do not depend on the model of the real arm. Then they need no proof that the error falls,
    and may differ from the old ones by any amount."""

    then: Rig
    """Rig whose controller placed the points."""

    @property
    def kind(self) -> PointKind:
        return "taught"

    @property
    def since(self) -> str:
        """File that states the changes since the points were taught; empty without changes."""
        return ""

    @property
    def digest(self) -> str:
        """Eight digits that identify the change since the points were taught; empty without a change."""
        return ""

    @cached_property
    def arm(self) -> Arm:
        """Arm in the controller that executes the new numbers."""
        return controller_arm(self.then.robot)

    @abstractmethod
    def renew(self, q: Array, wanted: Array, unsolved: Sequence[NotCorrected] = ()) -> NewPoints:
        """New numbers of points with readings q (n, 6) rad, which mean the poses `wanted` (n, 4, 4) if computed."""

    @abstractmethod
    def readings(self, q: Array) -> tuple[Array, Mask]:
        """Readings (n, 6) rad at which the tool is right where the controller placed q, and the mask of solutions."""


@dataclass(frozen=True)
class ComputedPoints(PointOrigin):
    """Points that state where the tool shall be: the real arm is brought there."""

    supported: tuple[Support, ...]

    @property
    def kind(self) -> PointKind:
        return "computed"

    def renew(self, q: Array, wanted: Array, unsolved: Sequence[NotCorrected] = ()) -> NewPoints:
        return NewPoints.of(corrected(self.then, self.supported, q, unsolved, wanted), self.arm)

    def readings(self, q: Array) -> tuple[Array, Mask]:
        model = real_model(self.then, used_effects(self.then, self.supported))
        return reached_angles(model, forward(self.arm, q), q)


@dataclass(frozen=True)
class UnchangedPoints(PointOrigin):
    """Points that are right as they are: taught without any change since, or computed with values at the controller
    that correct the arm."""

    is_unchanged: ClassVar[bool] = True
    is_exact: ClassVar[bool] = True

    values: str = ""
    """Name of the file with the values; empty for taught points."""

    @property
    def kind(self) -> PointKind:
        return "computed" if self.values else "taught"

    @property
    def since(self) -> str:
        return self.values

    def renew(self, q: Array, wanted: Array, unsolved: Sequence[NotCorrected] = ()) -> NewPoints:
        return _exact_points(q, forward(self.arm, q), (), np.zeros(len(q)))

    def readings(self, q: Array) -> tuple[Array, Mask]:
        return q, np.ones(len(q), dtype=bool)


@dataclass(frozen=True)
class ConvertedPoints(PointOrigin):
    """Taught points after a known change of zeros or constants: the same posture has other readings.

    The model of the real arm is not used. If the constants of the controller are unknown, those of the rig file are
    accurate enough, because only differences matter.
    """

    is_exact: ClassVar[bool] = True

    change: ReadingChange

    @property
    def since(self) -> str:
        return self.change.source

    @property
    def digest(self) -> str:
        return _digest(self.change.readings_deg, self.change.constants)

    @cached_property
    def arm(self) -> Arm:
        at_controller = self.then.model_copy(update={"robot": controller_robot(self.then.robot)})
        return geometric_arm(model_of(at_controller, self.change.constants))

    def renew(self, q: Array, wanted: Array, unsolved: Sequence[NotCorrected] = ()) -> NewPoints:
        known = {target.place: target for target in unsolved}
        new, _ = self.readings(q)
        left = known | {one.place: one for one in beyond_limits(self.arm, new) if one.place not in known}
        T, old = forward(self.arm, new), forward(controller_arm(self.then.robot), q)
        u_mm = np.hypot(self.change.u_mm(self.arm, new), _of_constants_mm(self.then, old, T))
        return _exact_points(new, T, tuple(left.values()), u_mm)

    def readings(self, q: Array) -> tuple[Array, Mask]:
        return q + np.radians(self.change.readings_deg), np.ones(len(q), dtype=bool)


@dataclass(frozen=True)
class ReadingChange:
    """Change of a controller or of joint zeros, by which an unchanged posture has other readings and numbers."""

    source: str
    """Name of the file that states it."""
    readings_deg: tuple[float, ...]
    """Changes (6,) of the readings at an unchanged posture."""
    constants: tuple[Effect, ...] = ()
    """Changes of the constants with which the controller computes poses."""
    u_deg: tuple[float, ...] = (0.0,) * 6
    """Standard uncertainties (6,) of the readings; values that were entered are exact."""
    lines: tuple[str, ...] = ()
    """The changes in words."""

    def u_mm(self, arm: Arm, q: Array) -> Array:
        """Uncertainty (n,) of the tool's place by those of the readings."""
        places, squares = forward(arm, q)[:, :3, 3], np.zeros(len(q))
        for axis, u_deg in enumerate(self.u_deg):
            if u_deg:
                turned = q + np.radians(u_deg) * np.eye(len(self.u_deg))[axis]
                squares += ((forward(arm, turned)[:, :3, 3] - places) ** 2).sum(axis=1)
        return np.asarray(np.sqrt(squares))


def _of_constants_mm(rig: Rig, old: Array, new: Array) -> Array:
    """Uncertainty (n,) by unknown constants of the controller, of a change of poses (n, 4, 4)."""
    moved_mm = np.linalg.norm(new[:, :3, 3] - old[:, :3, 3], axis=1)
    return np.asarray(moved_mm * UNKNOWN_SHARE * (rig.controller == "unknown"))


def _exact_points(q: Array, T: Array, left: tuple[NotCorrected, ...], u_mm: Array) -> NewPoints:
    done = np.asarray(np.isfinite(q).all(axis=1), dtype=bool)
    done[[target.place for target in left]] = False
    u_mm = np.where(done, u_mm, np.nan)
    return NewPoints(q, T, done, left, u_mm, u_mm, ("",) * len(q), {})


@dataclass(frozen=True)
class ChangedArm(PointOrigin):
    """Taught points after a change of the arm, or of another arm: corrected by the difference of two calibrations."""

    now: Rig
    calibration: str
    """Name of the rig file of the arm as it was."""
    is_another_arm: bool = False

    @property
    def since(self) -> str:
        return self.calibration

    @property
    def digest(self) -> str:
        models = [(rig.calibration, [effect.model_dump() for effect in rig.effects]) for rig in (self.then, self.now)]
        return _digest(models)

    @cached_property
    def arm(self) -> Arm:
        return controller_arm(self.now.robot)

    @cached_property
    def _supported(self) -> tuple[tuple[Support, ...], tuple[Support, ...]]:
        return tuple(supports(self.then)), tuple(supports(self.now))

    def _used(self) -> tuple[tuple[Effect, ...], tuple[Effect, ...]]:
        then, now = self._supported
        return used_effects(self.then, then), used_effects(self.now, now)

    def places(self, q: Array) -> Array:
        """Poses (n, 4, 4) of the tool of the arm as it was, at readings q (n, 6) rad."""
        return tool_poses(real_model(self.then, self._used()[0]), q)

    def readings(self, q: Array) -> tuple[Array, Mask]:
        return reached_angles(real_model(self.now, self._used()[1]), self.places(q), q)

    def renew(self, q: Array, wanted: Array, unsolved: Sequence[NotCorrected] = ()) -> NewPoints:
        skipped = {target.place: target for target in unsolved}
        skipped |= {one.place: one for one in beyond_limits(self.arm, q) if one.place not in skipped}
        rows = np.array([k not in skipped for k in range(len(q))], dtype=bool)
        new, solved = q.copy(), rows.copy()
        new[rows], solved[rows] = self.readings(q[rows])
        skipped |= {k: singular(k) for k in np.flatnonzero(rows & ~solved).tolist()}
        skipped |= {one.place: one for one in beyond_limits(self.arm, new) if solved[one.place]}
        done = np.array([k not in skipped for k in range(len(q))], dtype=bool)
        new[~done] = q[~done]
        sizes_mm, inside, unknown = self._sizes(q[done], new[done])
        spread, reasons = np.full((2, len(q)), np.nan), np.full(len(q), "", dtype=object)
        stays = np.hypot(sizes_mm[2:4], sizes_mm[4])
        of_constants_mm = _of_constants_mm(self.now, forward(self.arm, q[done]), forward(self.arm, new[done]))
        spread[:, done] = np.where(inside, np.hypot(stays, of_constants_mm), np.nan)
        reasons[done] = unknown
        errors: dict[PointKind, WorkError] = {}
        if inside.any():
            errors["taught"] = WorkError.of(sizes_mm[:, inside], None)
        left, T = tuple(skipped[k] for k in sorted(skipped)), forward(self.arm, new)
        return NewPoints(new, T, done, left, spread[0], spread[1], tuple(reasons.tolist()), errors)

    def _sizes(self, q: Array, new: Array) -> tuple[Array, Mask, list[str]]:
        """Sizes (5, n) for `WorkError`, the mask (n,) of points that both calibrations cover, and reasons (n,) for the
        others."""
        inside, unknown = np.ones(len(q), dtype=bool), [""] * len(q)
        squares = np.zeros((2, len(q)))
        for rig, supported, at in zip((self.then, self.now), self._supported, (q, new), strict=True):
            uncertainty = pose_uncertainty(rig, supported)
            taught = at if len(at) >= FEWEST_TAUGHT else taught_angles(rig, uncertainty.joints_rad)[:, : q.shape[1]]
            squares += np.square(places_u_mm(rig, uncertainty, at, taught))
            if (mask := covered(uncertainty, at)) is not None:
                reasons = why_unknown(rig, uncertainty, at)
                inside &= mask
                unknown = [one or other for one, other in zip(unknown, reasons, strict=True)]
        now = self._supported[1]
        stays_mm = np.linalg.norm(left_out_mm(self.now, rest_effects(self.now, now), new), axis=1)
        wanted, today = self.places(q), tool_places(self.now, self._used()[1], q)
        off_mm = np.linalg.norm(today - wanted[:, :3, 3], axis=1)
        in_frame_mm = rest_mm(today, wanted) if len(q) >= FEWEST_TAUGHT else off_mm
        return np.array([off_mm, in_frame_mm, *np.sqrt(squares), stays_mm]), inside, unknown


def _digest(*values: object) -> str:
    return hashlib.sha256(repr(values).encode()).hexdigest()[:8]


def merged(parts: Sequence[tuple[Mask, NewPoints]]) -> NewPoints:
    """Points of several origins, each with its mask (n,) of points."""
    first = parts[0][1]
    if len(parts) == 1:
        return first
    q, T, done = first.q.copy(), first.T.copy(), first.done.copy()
    u_mm, u_frame_mm, unknown = first.u_mm.copy(), first.u_frame_mm.copy(), list(first.unknown)
    errors = dict(first.errors)
    for mask, points in parts[1:]:
        q[mask], T[mask], done[mask] = points.q[mask], points.T[mask], points.done[mask]
        u_mm[mask], u_frame_mm[mask] = points.u_mm[mask], points.u_frame_mm[mask]
        errors |= points.errors
        unknown = [new if is_in else old for is_in, new, old in zip(mask, points.unknown, unknown, strict=True)]
    left = tuple(
        sorted((one for mask, points in parts for one in points.left if mask[one.place]), key=lambda x: x.place)
    )
    return NewPoints(q, T, done, left, u_mm, u_frame_mm, tuple(unknown), errors)

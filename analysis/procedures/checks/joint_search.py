"""Search for the signs and zeros of joint columns with which an arm fits measured places, from any start.

Each joint is tried in both directions and with zeros a quarter turn apart. For such a reading, base, tool and places
obey A p + b = x(q) + R(q) t with the flange frame (x, R) and an unknown matrix A instead of the base's rotation. These
equations are linear. A projection removes A and b, the same for all readings, and three unknowns t remain. The best
readings are refined by Gauss-Newton steps, first with A, then with a rigid base on more places.

The zeros of the first and the last joint only turn base and tool, so they stay unknown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from analysis.robot.geometry.pose_setup import REACH_MM, PoseSetUp, fit_setup, frame, position_error
from analysis.robot.kinematics.arm import Arm, Array, Integers, forward, forward_and_jacobian, rotation
from analysis.runs.noise.readings import evenly, extent_of, rms

_QUARTERS = (0.0, np.pi / 2, np.pi, -np.pi / 2)
_SCREENED, _FITTED = 30, 80
"""Places for the comparison of all readings, and for the best ones. Chosen: 30 places have 90 coordinates for 19
unknowns.
"""
_REFINED, _BEST, _FEW = 256, 16, 4
"""Readings that are refined with a free matrix, and with a rigid base: of those as good as the best, and of others."""
_ROUNDS, _RIGID_ROUNDS, _SETUP_STEPS, _ENOUGH = 10, 15, 12, 1e-4
_MOST_STEP = 0.35
"""Largest step of a zero in rad, within which the places are nearly linear."""
_KEPT = 0.8
_HOPELESS = 5.0
"""Residual with a free matrix, in those of a right arm, above which no reading fits. Chosen: wild places do not decide.
"""
_CLOSE = 1.5
"""Ratio to the smallest residual up to which the simplest reading is taken."""
_ALIKE = 1.1
"""Growth of the residual up to which a zero is not needed."""
_SAME, _SMALL = np.radians(1.0), np.radians(3.0)
"""Difference of zeros up to which two readings are the same, and size up to which a zero is no other convention."""
_USUAL = np.radians(0.5)
"""Zero that arms in use have, and that is left out if the residual remains that of a right arm."""
_NOTHING = 1e-9


@dataclass(frozen=True)
class JointReading:
    """Joint angles as sign times column plus zero."""

    signs: Array
    """1, or -1 for a joint that counts in the opposite direction."""
    zeros: Array
    """Zeros (axes,) rad, from -π to π."""
    left_mm: float
    """Root mean square coordinate residual of the best four fifths of the places."""

    @property
    def changes(self) -> int:
        """Number of joints that differ from the columns."""
        return int(((self.signs < 0) | (self.zeros != 0)).sum())

    def of(self, q: Array) -> Array:
        axes = len(self.signs)
        return np.column_stack([q[:, :axes] * self.signs + self.zeros, q[:, axes:]])


def search_joint_readings(bare: Arm, q: Array, xyz_mm: Array, right_mm: float) -> list[JointReading]:
    """Readings of joint columns q (n, axes) rad that fit places (n, 3) mm best, the simplest of equal ones first.

    bare: arm without base and tool. right_mm: error of the right arm with nominal constants over these places, within
    which small zeros are left out.
    """
    few, many = evenly(len(q), _SCREENED), evenly(len(q), _FITTED)
    signs, zeros, left = _Free(bare, q[few], _scaled(xyz_mm[few])).best()
    if np.sqrt(left.min()) * extent_of(xyz_mm) > _HOPELESS * right_mm:
        return []
    changes = ((signs < 0) | (np.abs(zeros) > _SMALL)).sum(axis=1)
    is_close = left <= _CLOSE * left.min()
    rigid = _Rigid(bare, q[many], xyz_mm[many])
    readings: list[JointReading] = []
    for k in np.lexsort((left, changes, ~is_close)):
        if len(readings) >= (_BEST if is_close[k] else _FEW):
            break
        if not any(_are_same(signs[k], zeros[k], known) for known in readings):
            readings.append(rigid.refined(JointReading(signs[k], zeros[k], np.inf)))
    closest = min(reading.left_mm for reading in readings)
    alike = [one for one in readings if one.left_mm <= _CLOSE * closest][:_FEW]
    alike = [rigid.with_needed_zeros(one, right_mm) for one in alike]
    others = [one for one in readings if one.left_mm > _CLOSE * closest]
    return [
        *sorted(alike, key=lambda one: (one.changes, one.left_mm)),
        *sorted(others, key=lambda one: one.left_mm),
    ]


def _are_same(signs: Array, zeros: Array, known: JointReading) -> bool:
    apart = (zeros - known.zeros + np.pi) % (2 * np.pi) - np.pi
    return bool((signs == known.signs).all() and np.abs(apart).max() < _SAME)


def _scaled(xyz_mm: Array) -> Array:
    centred = xyz_mm - xyz_mm.mean(axis=0)
    return np.asarray(centred / max(rms(centred), 1e-9))


@dataclass(frozen=True)
class _Free:
    """Comparison of readings with a free matrix in place of the rotation of the base."""

    bare: Arm
    q: Array
    places: Array

    def best(self) -> tuple[Array, Array, Array]:
        """Signs (r, axes), zeros (r, axes) rad and relative residuals (r,) of the best readings."""
        known = np.linalg.qr(np.column_stack([self.places, np.ones(len(self.places))]))[0]
        return self._refined(*self._screened(known), known)

    def _screened(self, known: Array) -> tuple[Array, Array]:
        """The best readings with zeros a quarter turn apart."""
        axes, half = self.bare.axes, self.bare.axes // 2
        firsts, lasts = list(_states(range(half), axes)), list(_states(range(half, axes), axes))
        of_lasts = np.stack([self._chain(signs, zeros, range(half, axes)) for signs, zeros in lasts])
        left = np.stack([
            _relative_residuals(known, self._chain(signs, zeros, range(half))[None] @ of_lasts)
            for signs, zeros in firsts
        ])  # fmt: skip
        first, last = np.unravel_index(np.argsort(left, axis=None)[:_REFINED], left.shape)
        chosen = [(firsts[k], lasts[m]) for k, m in zip(first.tolist(), last.tolist(), strict=True)]
        return np.array([one[0] * other[0] for one, other in chosen]), np.array([one[1] + o[1] for one, o in chosen])

    def _chain(self, signs: Array, zeros: Array, joints: range) -> Array:
        """Product (n, 4, 4) of the links of some joints."""
        theta = (self.q[:, : self.bare.axes] * signs + zeros) @ self.bare.coupling.T + self.bare.offset
        T = np.broadcast_to(np.eye(4), (len(self.q), 4, 4))
        for joint in joints:
            T = T @ self.bare.links_at_zero[joint] @ _frames(theta[:, joint])
        return np.asarray(T)

    def _refined(self, signs: Array, zeros: Array, known: Array) -> tuple[Array, Array, Array]:
        """Damped Gauss-Newton steps of the zeros of all readings at once."""
        count, inner = len(zeros), slice(1, self.bare.axes - 1)
        best, left, damping = zeros, np.full(count, np.inf), np.full(count, 1e-3)
        steps, tried = np.zeros_like(zeros[:, inner]), zeros
        for _ in range(_ROUNDS):
            q = self.q[None, :, : self.bare.axes] * signs[:, None] + tried[:, None]
            T, J = forward_and_jacobian(self.bare, q.reshape(-1, self.bare.axes))
            T, J = T.reshape(count, -1, 4, 4), J.reshape(count, len(self.q), 6, -1)[..., inner]
            now, new_steps = _free_steps(known, T, J, damping)
            is_better = now < left
            best, left = np.where(is_better[:, None], tried, best), np.where(is_better, now, left)
            steps = np.where(is_better[:, None], new_steps, steps / 4)
            damping = np.where(is_better, damping / 5, damping).clip(1e-6, 1.0)
            tried = best.copy()
            tried[:, inner] += np.clip(steps, -_MOST_STEP, _MOST_STEP)
        return signs, (best + np.pi) % (2 * np.pi) - np.pi, left


def _frames(angle: Array) -> Array:
    """Rotations (n, 4, 4) about z."""
    T = np.zeros((len(angle), 4, 4))
    T[:, 0, 0] = T[:, 1, 1] = np.cos(angle)
    T[:, 1, 0] = np.sin(angle)
    T[:, 0, 1] = -T[:, 1, 0]
    T[:, 2, 2] = T[:, 3, 3] = 1.0
    return T


def _states(joints: range, axes: int) -> Iterator[tuple[Array, Array]]:
    """Signs and zeros (axes,) of some joints, all others as named."""
    every = list(product((1.0, -1.0), _QUARTERS))
    for chosen in product(*(every if 0 < joint < axes - 1 else [(1.0, 0.0), (-1.0, 0.0)] for joint in joints)):
        signs, zeros = np.ones(axes), np.zeros(axes)
        signs[joints.start : joints.stop], zeros[joints.start : joints.stop] = np.transpose(chosen)
        yield signs, zeros


def _tools(known: Array, T: Array) -> tuple[Array, Array, Array]:
    """Tools (r, 3) mm on flanges T (r, n, 4, 4) that fit best, and squared residuals and spreads (r,) mm².

    known (n, 4): orthonormal columns of places and constants, which the base takes up.
    """
    count, n = T.shape[:2]
    x, frames = T[:, :, :3, 3], T[:, :, :3].reshape(count, n, 12)
    taken = (known.T @ frames).reshape(count, -1, 4)
    flat = frames.reshape(count, -1, 4)  # columns of rotation and position
    from_taken = taken.transpose(0, 2, 1) @ taken
    along = (flat.transpose(0, 2, 1) @ flat[:, :, 3:])[:, :, 0] - from_taken[:, :, 3]
    slope = along[:, :3]
    normal = (1 + _NOTHING) * n * np.eye(3) - from_taken[:, :3, :3]
    tool = -np.linalg.solve(normal, slope[:, :, None])[:, :, 0]
    squares = along[:, 3] + (slope * tool).sum(axis=1)
    spread = ((x - x.mean(axis=1, keepdims=True)) ** 2).sum(axis=(1, 2))
    return tool, squares, spread


def _relative_residuals(known: Array, T: Array) -> Array:
    _, squares, spread = _tools(known, T)
    return np.asarray(np.maximum(squares, 0.0) / np.maximum(spread, 1e-9))


def _free_steps(known: Array, T: Array, J: Array, damping: Array) -> tuple[Array, Array]:
    """Relative residuals (r,), and steps (r, zeros) rad. J (r, n, 6, zeros): Jacobian of the flange."""
    tool, _, spread = _tools(known, T)
    lever = np.einsum("rnij,rj->rni", T[:, :, :3, :3], tool)
    moves = J[:, :, :3] + np.cross(J[:, :, 3:], lever[..., None], axis=2)
    columns = np.concatenate([moves, T[:, :, :3, :3], (T[:, :, :3, 3] + lever)[..., None]], axis=3)
    flat = columns.reshape(*T.shape[:2], -1)
    columns = (flat - known @ (known.T @ flat)).reshape(len(T), -1, columns.shape[3])
    design, gap = columns[:, :, :-1], columns[:, :, -1:]
    normal = design.transpose(0, 2, 1) @ design
    diagonal = np.einsum("rkk->rk", normal) * damping[:, None] + _NOTHING * np.trace(normal, axis1=1, axis2=2)[:, None]
    normal = normal + np.eye(normal.shape[1]) * diagonal[:, None]
    steps = -np.linalg.solve(normal, design.transpose(0, 2, 1) @ gap)[:, : J.shape[3], 0]
    return np.asarray((gap[:, :, 0] ** 2).sum(axis=1) / np.maximum(spread, 1e-9)), np.asarray(steps)


@dataclass(frozen=True)
class _Rigid:
    """Fit of zeros together with a rigid base and the tool."""

    bare: Arm
    q: Array
    xyz_mm: Array

    def refined(self, reading: JointReading) -> JointReading:
        """Fit the non-zero zeros to the nearest four fifths of the places."""
        free = np.flatnonzero(reading.zeros)
        T = forward(self.bare, reading.of(self.q))
        setup, zeros = fit_setup(T, self.xyz_mm, _SETUP_STEPS), reading.zeros
        for _ in range(2):
            away = np.linalg.norm(position_error(T, self.xyz_mm, setup), axis=1)
            kept = np.argsort(away)[: max(int(_KEPT * len(T)), 9)]
            setup, zeros = self._fitted(reading.signs, zeros, free, setup, kept)
            T = forward(self.bare, JointReading(reading.signs, zeros, np.inf).of(self.q))
        away = np.sort(np.linalg.norm(position_error(T, self.xyz_mm, setup), axis=1))
        return JointReading(reading.signs, (zeros + np.pi) % (2 * np.pi) - np.pi, rms(away[: len(kept)]))

    def with_needed_zeros(self, reading: JointReading, right_mm: float) -> JointReading:
        """Remove zeros, the smallest first, as long as the residual hardly grows, or is that of a right arm."""
        for axis in np.argsort(np.abs(reading.zeros)):
            zeros = reading.zeros.copy()
            zeros[axis] = 0.0
            if reading.zeros[axis]:
                fewer = self.refined(JointReading(reading.signs, zeros, np.inf))
                is_usual = np.abs(reading.zeros[axis]) <= _USUAL and fewer.left_mm <= right_mm
                if fewer.left_mm > _ALIKE * reading.left_mm and not is_usual:
                    break
                reading = fewer
        return reading

    def _fitted(
        self, signs: Array, zeros: Array, free: Integers, setup: PoseSetUp, kept: Integers
    ) -> tuple[PoseSetUp, Array]:
        """Damped Gauss-Newton steps of base, tool and free zeros together."""
        damping, best = 1e-3, self._linearised(signs, zeros, free, setup, kept)
        for _ in range(_RIGID_ROUNDS):
            gap, design = best
            scale = np.linalg.norm(design, axis=0) + _NOTHING
            damped = np.vstack([design / scale, np.sqrt(damping) * np.eye(design.shape[1])])
            right = np.concatenate([-gap, np.zeros(design.shape[1])])
            step = np.clip(np.linalg.lstsq(damped, right)[0] / scale, -_MOST_STEP * REACH_MM, _MOST_STEP * REACH_MM)
            base, tool = setup.T_world_base, setup.T_flange_tool
            moved = frame(rotation(step[:3] / REACH_MM) @ base[:3, :3], base[:3, 3] + step[3:6])
            tried = PoseSetUp(moved, frame(np.eye(3), tool[:3, 3] + step[6:9]), setup.design)
            angles = zeros.copy()
            angles[free] += step[9:] / REACH_MM
            new = self._linearised(signs, angles, free, tried, kept)
            if new[0] @ new[0] < gap @ gap:
                gained = 1 - (new[0] @ new[0]) / (gap @ gap)
                setup, zeros, best, damping = tried, angles, new, damping / 10
                if gained < _ENOUGH:
                    break
            else:
                damping *= 10
        return setup, zeros

    def _linearised(
        self, signs: Array, zeros: Array, free: Integers, setup: PoseSetUp, kept: Integers
    ) -> tuple[Array, Array]:
        """Gaps (3n,) mm and their derivatives (3n, 9 + zeros) by base, tool and zeros, rotations at `REACH_MM`."""
        T, J = forward_and_jacobian(self.bare, JointReading(signs, zeros, np.inf).of(self.q[kept]))
        R, lever = setup.T_world_base[:3, :3], T[:, :3, :3] @ setup.T_flange_tool[:3, 3]
        arm = (T[:, :3, 3] + lever) @ R.T
        gap = self.xyz_mm[kept] - arm - setup.T_world_base[:3, 3]
        moves = J[:, :3, free] + np.cross(J[:, 3:, free], lever[..., None], axis=1)
        turns = np.cross(np.eye(3)[None], arm[:, None]).transpose(0, 2, 1)
        columns = [turns / REACH_MM, np.broadcast_to(np.eye(3), turns.shape), R @ T[:, :3, :3], R @ moves / REACH_MM]
        return gap.ravel(), -np.concatenate(columns, axis=2).reshape(gap.size, -1)

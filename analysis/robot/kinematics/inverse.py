"""Inverse kinematics with all branches: every set of joint angles for a tool pose.

An arm with a closed form (`canonical`) has eight exact branches. For other arms, solutions are searched (`searched`) by
Newton's method on stacks of start values. Every solution is confirmed by forward kinematics.

With R = RotX(90°) and without signs, the arm consists of Rz(t1) TransX(a1) R, a planar chain, and the wrist. A point of
the plane is a complex number. The normal of the plane is -y of frame 1. The inverse of both kinds has the same three
parts:

- shoulder: the distance D of the wrist centre from the plane is the sum of the offsets along the parallel axes. The
  equation -x sin t1 + y cos t1 = -D has two solutions t1.
- elbow: u + iv = L e^(i t2) + w e^(i (t2 + t3)) for two links in the plane has two solutions (t2, t3).
- wrist: M = Rz(t4) R Rz(t5) R Rz(t6) has two solutions (t4, t5, t6), because M22 = -cos t5 and column 2 gives t4.

For a spherical wrist the order is shoulder, elbow with w = a3 - i d4, wrist. For parallel axes it is shoulder, wrist
with t2 + t3 + t4 in place of t4, and elbow with w = a3 after removing a4 - i d5. The equations were derived for this
program (J. Craig, Introduction to Robotics, 3rd ed., ch. 4 for the method; M. Brandstötter et al. 2014 and K. Hawkins
2013 have the same branches in other parameters).

The two kinds with a closed form are: parallel axes 2 and 3 with a spherical wrist, and parallel axes 2, 3 and 4
(Universal Robots). Reversing the z axis of joint i, a half turn about its x axis, changes the sign of theta_i and d_i,
and the adjacent alphas by 180°. Each arm of a kind can therefore be brought to the same alphas of 90° or 0°.

A calibrated arm differs from a kind by small Hayati angles and errors of alpha. It is snapped to the kind, and the
branches of the snapped arm are the start values. More start values are used in doubtful cases: near a singularity, near
the end of the reach, and for arms of no known kind. These include values on both sides of each solution near a
singularity.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Integers, Mask, blocks, cos_sin
from analysis.robot.kinematics.joint_limits import distinct, good, may_have_duplicates, off_by, wrapped
from analysis.robot.kinematics.newton import LENGTH_MM, TOLERANCE_MM, from_nearby, newton, null_motion
from rigs.schema.vocabulary import DRIVEN_AXES

Kind = Literal["spherical wrist", "parallel axes"]

_ALPHA: dict[Kind, Array] = {
    "spherical wrist": np.radians([90.0, 0.0, 90.0, 90.0, 90.0]),
    "parallel axes": np.radians([90.0, 0.0, 0.0, 90.0, 90.0]),
}
"""Alphas of links 1 … 5. The transformation before axis 1 is arbitrary."""
_NEAR = 0.05
"""Largest difference of a calibrated arm from its kind: in rad, and for lengths relative to the size of the arm."""
_EXACT = 1e-12
_DEGENERATE = 1e-6


@dataclass(frozen=True)
class Canonical:
    """An arm of one of the two kinds, with all axis directions brought to the same convention.

    A joint angle theta of the arm is sign · theta in this form. a, d, sign: (6,). T_one_world: (4, 4), from the world
    to the frame of axis 1 at rest, raised by d1. T_tool_wrist: (4, 4), from the tool back along axis 6 by d6.
    snapped_mm: largest tool motion caused by replacing the arm by its ideal kind, with a radian counted as 500 mm.
    """

    kind: Kind
    sign: Array
    a: Array
    d: Array
    T_one_world: Array
    T_tool_wrist: Array
    snapped_mm: float

    @property
    def exact(self) -> bool:
        return self.snapped_mm == 0


def canonical(arm: Arm) -> Canonical | None:
    """Canonical form of an arm, or None if it belongs to neither kind."""
    for kind, alpha in _ALPHA.items():
        half_turns = np.rint((arm.alpha[1:] - alpha) / np.pi)
        turned = np.concatenate([arm.alpha[1:] - alpha - half_turns * np.pi, arm.beta[1:]])
        is_spherical = kind == "spherical wrist"
        # zero for an exact arm of the kind
        lengths = np.array([arm.a[4], arm.a[5], arm.d[4]] if is_spherical else [arm.a[5]])
        deviation = max(np.abs(turned).max(), np.abs(lengths).max() / _size(arm))
        forearm = np.hypot(arm.a[3], arm.d[3]) if is_spherical else abs(arm.a[3])
        lacks_a_link = min(abs(arm.a[2]), forearm) < _DEGENERATE * _size(arm)  # a link of the planar chain
        if deviation < _NEAR and not lacks_a_link:
            sign = np.cumprod(np.concatenate([[1.0], np.where(half_turns % 2 == 1, -1.0, 1.0)]))
            reach = _size(arm) + float(np.linalg.norm(arm.T_flange_tool[:3, 3])) + LENGTH_MM
            moved = float(np.abs(lengths).sum() + np.abs(turned).sum() * reach)
            d = sign * arm.d
            drawn_back, half_turn = np.eye(4), np.diag([1.0, sign[5], sign[5], 1.0])
            drawn_back[2, 3] = -d[5]
            return Canonical(
                kind,
                sign,
                arm.a,
                d,
                T_one_world=np.linalg.inv(arm.T_world_base @ arm.links_at_zero[0]),
                T_tool_wrist=np.linalg.inv(arm.T_flange_tool) @ half_turn @ drawn_back,
                snapped_mm=0.0 if deviation < _EXACT else moved,
            )
    return None


def _size(arm: Arm) -> float:
    return float(np.abs(arm.a[1:]).sum() + np.abs(arm.d[1:]).sum()) or 1.0


_BOTH = np.array([1.0, -1.0])
_ON_AXIS_MM = 1e-9
_WRIST_SINGULAR = 1e-12
"""Value of sin t5 below which t4 can be chosen. The resulting tool motion is negligible compared with all tolerances.
"""
Point = tuple[Array, Array]
"""Positions in the plane of the arm in mm: two coordinates with equal shapes."""


def branches(form: Canonical, poses: Array, spread: float = 0.0, slot: int | None = None) -> Array:
    """Theta (8, 6, n) rad of all branches for tool poses (n, 4, 4) in the world, or (1, 6, n) for one slot.

    Slot = 4 · shoulder + 2 · elbow + wrist. Angles are not wrapped. An unreachable branch is not marked: its angles
    come as close to the pose as possible, and forward kinematics shows the difference. With `spread` > 0 (rad) the two
    sides of a singularity are separated by this angle. This gives start values for an arm close to its kind.

    At singular poses the solution is a choice. If the wrist centre is on axis 1, t1 is 0 and 180°. If t5 = 0, t4 is 0
    for a spherical wrist. For parallel axes, t2 + t3 + t4 is chosen so that the elbow is closest to a right angle.
    """
    sides = [_BOTH] * 3 if slot is None else [_BOTH[[slot >> bit & 1]] for bit in (2, 1, 0)]
    solve = _spherical_wrist if form.kind == "spherical wrist" else _parallel_axes
    theta = np.empty((*(len(side) for side in sides), 6, len(poses)))
    # T_one_world poses T_tool_wrist without the last row, (3, 4, n). The expression is linear in the pose, so a single
    # product is sufficient.
    both = np.kron(form.T_one_world[:3], form.T_tool_wrist.T)
    for axis, angle in enumerate(
        solve(form, np.asarray(both @ poses.reshape(-1, 16).T).reshape(3, 4, -1), sides, spread)
    ):
        theta[:, :, :, axis] = form.sign[axis] * angle
    return theta.reshape(8 if slot is None else 1, 6, len(poses))


def _spherical_wrist(form: Canonical, T: Array, sides: list[Array], spread: float) -> list[Array]:
    """T1 … t6, each broadcastable to (shoulder, elbow, wrist, n)."""
    a, d = form.a, form.d
    t1, u = _shoulder(T, d[1] + d[2], sides[0])
    t2, t3 = _elbow((u - a[1], np.broadcast_to(T[2, 3], u.shape)), a[2], complex(a[3], -d[3]), sides[1], spread)
    upper = _down(t1[:, None], T[:, None, :3])
    M = _down((t2 + t3)[:, :, None], [row[:, None] for row in upper])
    t4, t5, t6 = _wrist(M, np.zeros(()), sides[2], spread)
    return [t1[:, None, None], t2[:, :, None], t3[:, :, None], t4, t5, t6]


def _parallel_axes(form: Canonical, T: Array, sides: list[Array], spread: float) -> list[Array]:
    a, d = form.a, form.d
    t1, u = _shoulder(T, d[1] + d[2] + d[3], sides[0])
    x, y, hand = u - a[1], np.broadcast_to(T[2, 3], u.shape), complex(a[4], -d[4])
    # direction of the hand for which the elbow is closest to a right angle
    square = x * x + y * y
    reach = 2 * np.sqrt(square) * abs(hand)
    cosine = (square + abs(hand) ** 2 - a[2] ** 2 - a[3] ** 2) / np.where(reach > 0, reach, 1.0)
    bent = np.arctan2(y, x) + np.arccos(np.clip(cosine, -1.0, 1.0)) - np.angle(hand)
    t234, t5, t6 = _wrist(_down(t1[:, None], T[:, None, :3]), bent, sides[2], spread)
    c, s = cos_sin(t234)
    centre = x[:, None] - hand.real * c + hand.imag * s, y[:, None] - hand.real * s - hand.imag * c
    t2, t3 = _elbow(centre, a[2], complex(a[3]), sides[1], spread)
    return [t1[:, None, None], t2, t3, t234[:, None] - t2 - t3, t5[:, None], t6[:, None]]


def _shoulder(T: Array, off_plane: float, sides: Array) -> tuple[Array, Array]:
    """T1 (shoulder, n), and the distance within the plane of the wrist centre from axis 1 (shoulder, n)."""
    x, y = T[0, 3], T[1, 3]
    r = np.hypot(x, y)
    bearing = np.where(r < _ON_AXIS_MM, 0.0, np.arctan2(y, x))
    u = np.sqrt(np.maximum((r - off_plane) * (r + off_plane), 0.0)) * sides[:, None]
    return bearing - np.arctan2(-off_plane, u), u


def _elbow(target: Point, upper: float, forearm: complex, sides: Array, spread: float) -> tuple[Array, Array]:
    """T2 and t3 (shoulder, elbow, …) of two planar links that end at target (shoulder, …)."""
    x, y = target
    length, widest = abs(forearm), np.cos(spread)
    cosine = np.clip((x * x + y * y - upper**2 - length**2) / (2 * upper * length), -widest, widest)
    ahead = np.arctan2(length * np.sqrt((1 - cosine) * (1 + cosine)), upper + length * cosine)
    sides = sides.reshape(-1, *[1] * (x.ndim - 1))
    t2 = np.arctan2(y, x)[:, None] - sides * ahead[:, None]
    return t2, sides * np.arccos(cosine)[:, None] - np.angle(forearm)


def _wrist(M: list[Array], free: Array, sides: Array, spread: float) -> tuple[Array, Array, Array]:
    """T4, t5, t6 (…, wrist, n) of rotations M, given by three rows (…, 3, n).

    If the wrist is singular, t4 is `free` (…, n).
    """
    x, y = M[0][..., 2, :], M[1][..., 2, :]
    sine = np.sqrt(x * x + y * y)
    singular = sine < _WRIST_SINGULAR
    t4, apart = np.arctan2(y, x), np.where(singular, 1.0, sine)
    c4, s4 = x / apart, y / apart
    if singular.any():
        t4 = np.where(singular, free, t4)
        c4, s4 = np.where(singular, np.cos(t4), c4), np.where(singular, np.sin(t4), s4)
    t5 = np.arctan2(np.maximum(sine, np.sin(spread)), -M[2][..., 2, :])
    # Computed from t4 and the second row, which is well-conditioned for any sin t5.
    t6 = np.arctan2(s4 * M[0][..., 0, :] - c4 * M[1][..., 0, :], s4 * M[0][..., 1, :] - c4 * M[1][..., 1, :])
    flipped = np.where(singular, 0.0, np.pi)[..., None, :] * (sides < 0)[:, None]
    return t4[..., None, :] + flipped, t5[..., None, :] * sides[:, None], t6[..., None, :] + flipped


def _down(t: Array, rows: Array | list[Array]) -> list[Array]:
    c, s = cos_sin(t)
    x, y, z = rows
    return [c * x + s * y, z, s * x - c * y]


_SEEDS, _MOST = 96, 16
"""Number of start values, and largest number of solutions of a general six-axis arm (Raghavan and Roth 1993)."""
_ITERATIONS = 30
_BEYOND = 1.5
"""Multiple of the largest snapping motion beyond which a branch is out of reach. A factor of 1 would suffice,
because the difference is the missing reach.
"""
_REGULAR = 2e-3
"""Regularity below which a branch of the snapped arm is doubtful: the true arm may then have additional solutions."""
_SPREAD = 0.1
"""Angle in rad between start values on the two sides of a singularity of the snapped arm."""
_SINGULAR = 0.01
_ASIDE = np.array([-0.6, -0.15, -0.03, 0.03, 0.15, 0.6])
"""Conditioning below which a solution is singular, and distances in rad of the start values on both sides of it."""


def searched(arm: Arm, form: Canonical | None, poses: Array) -> tuple[Array, Mask]:
    """Solve poses (n, 4, 4) by Newton: q (n, 16, 6) rad, and solved (n, 16) with solved slots first.

    Starts are the branches of the snapped arm, or spread evenly for an arm of no known kind.
    """
    q, solved = np.full((len(poses), _MOST, 6), np.nan), np.zeros((len(poses), _MOST), dtype=bool)
    if form is None:
        # Start values (s, 6) rad that fill the six turns evenly: the additive recurrence of M. Roberts (2018).
        root = 1.0
        for _ in range(50):
            root = (1 + root) ** (1 / 7)
        steps = root ** -np.arange(1.0, 7.0)
        filled: Array = 2 * np.pi * ((np.arange(1, _SEEDS + 1)[:, None] * steps) % 1.0) - np.pi
        theta: Array = np.broadcast_to(filled, (len(poses), _SEEDS, 6))
        return _add_singular_solutions(arm, poses, *_first(*_reached(arm, poses, _joints(arm, theta))))
    theta = branches(form, poses)
    q[:, :8], solved[:, :8], clear = _near_branches(arm, form, poses, theta)
    doubtful = np.flatnonzero(~clear)
    if len(doubtful):
        # Branches without success, and separated sides of a singularity if they differ from the branches.
        snapped, apart = theta[:, :, doubtful], branches(form, poses[doubtful], _SPREAD)
        has_moved = (np.abs(wrapped(apart - snapped)).max(axis=1) > 0).T
        seeds = _joints(arm, np.concatenate([snapped, apart]).transpose(2, 0, 1))
        seeds = distinct(arm, seeds, np.concatenate([~solved[doubtful, :8], has_moved], axis=1))[0]
        more = _reached(arm, poses[doubtful], seeds)
        q[doubtful], solved[doubtful] = _add_singular_solutions(
            arm, poses[doubtful], *_together(arm, q[doubtful], solved[doubtful], *more)
        )
    return _first(q, solved)


def _near_branches(arm: Arm, form: Canonical, poses: Array, theta: Array) -> tuple[Array, Mask, Mask]:
    """Refine each branch theta (8, 6, n) rad of the snapped arm: q (n, 8, 6), solved (n, 8), clear (n,).

    A pose is clear if all branches are far from the end of the reach, from each other, and from singularities.
    """
    seeds = _joints(arm, theta.transpose(2, 0, 1))
    flat = np.repeat(poses, 8, axis=0)
    reached, off_mm, regularity = from_nearby(arm, flat, seeds.reshape(-1, 6), _BEYOND * form.snapped_mm)
    turned = wrapped(reached @ arm.coupling.T)
    q: Array = turned @ np.linalg.inv(arm.coupling).T
    solved, tried = off_mm < TOLERANCE_MM, off_mm < np.inf
    unsure = np.flatnonzero(tried & ~solved)
    solved[unsure] = good(*off_by(arm, flat[unsure], q[unsure].T[None]))[0]
    q[~solved] = np.nan
    regular = (solved & (regularity >= _REGULAR)) | ~tried
    clear = regular.reshape(-1, 8).all(axis=1)
    clear &= ~may_have_duplicates(turned.reshape(-1, 8, 6).transpose(1, 2, 0), solved.reshape(-1, 8).T)
    return q.reshape(-1, 8, 6), solved.reshape(-1, 8), clear


def _add_singular_solutions(arm: Arm, poses: Array, q: Array, solved: Mask) -> tuple[Array, Mask]:
    """Add solutions on both sides of singular ones: q (n, 16, 6) rad, solved (n, 16).

    Near a singularity, branches are close together, along the joint motion that does not move the tool.
    """
    row, slot = np.nonzero(solved)
    condition, still = null_motion(arm, q[row, slot])
    near = condition < _SINGULAR
    row, slot = row[near], slot[near]
    seeds = np.full((*q.shape[:2], len(_ASIDE), 6), np.nan)
    seeds[row, slot] = q[row, slot, None] + _ASIDE[:, None] * still[near, None]
    seeds = seeds.reshape(len(q), q.shape[1] * len(_ASIDE), 6)
    again = np.isfinite(seeds).any(axis=(1, 2))
    more = _reached(arm, poses[again], seeds[again])
    q[again], solved[again] = _together(arm, q[again], solved[again], *more)
    return q, solved


def _together(arm: Arm, q: Array, solved: Mask, more: Array, solved_more: Mask) -> tuple[Array, Mask]:
    both = np.concatenate([q, more], axis=1), np.concatenate([solved, solved_more], axis=1)
    return _first(*distinct(arm, *_first(*both, most=None)))


def _reached(arm: Arm, poses: Array, seeds: Array) -> tuple[Array, Mask]:
    row, slot = np.nonzero(np.isfinite(seeds).all(axis=2))
    q_reached = newton(arm, poses[row], seeds[row, slot], _ITERATIONS)[0]
    q_reached = _joints(arm, q_reached @ arm.coupling.T + arm.offset)
    q, solved = np.full(seeds.shape, np.nan), np.zeros(seeds.shape[:2], dtype=bool)
    q[row, slot], solved[row, slot] = q_reached, good(*off_by(arm, poses[row], q_reached.T[None]))[0]
    return distinct(arm, *_first(q, solved, most=None))


def _first(q: Array, solved: Mask, most: int | None = _MOST) -> tuple[Array, Mask]:
    """At most `most` slots with solved ones first, in order; None for all solved ones."""
    most = most or max(_MOST, int(solved.sum(axis=1).max(initial=0)))
    order = np.argsort(~solved, axis=1, kind="stable")[:, :most]
    return np.take_along_axis(q, order[..., None], axis=1), np.take_along_axis(solved, order, axis=1)


def _joints(arm: Arm, theta: Array) -> Array:
    q: Array = wrapped(theta - arm.offset) @ np.linalg.inv(arm.coupling).T
    return q


_POLISHED_MM = 1e-3
"""Largest rounding error of a closed form, which a Newton step removes. A larger error is missing reach."""
_BLOCK = 1000
"""Poses per block, which fit into the processor's cache."""


@dataclass(frozen=True)
class Solutions:
    """Solutions q (n, k, 6) rad, nan in empty slots. found (n, k): mask of solutions.

    complete: True if the arm has an exact closed form. All branches are then present; at a singular pose they are a
    choice of infinitely many. A slot identifies the branch: 4 · shoulder + 2 · elbow + wrist. If False, slots have no
    meaning, and solutions may be missing: near a singularity of a calibrated arm, and anywhere for an arm of no known
    kind.
    """

    q: Array
    found: Mask
    complete: bool


NO_BRANCH = -1
"""Branch of a posture if the arm has no closed form."""


def branch_of(arm: Arm, poses: Array, q: Array) -> Integers:
    """Configuration (m,) of postures q (m, axes) rad at their poses (m, 4, 4): 4 · shoulder + 2 · elbow + wrist."""
    form = canonical(arm) if arm.axes == DRIVEN_AXES and arm.rail is None else None
    if form is None or not len(q):
        return np.full(len(q), NO_BRANCH, dtype=np.int64)
    turned = (q @ arm.coupling.T + arm.offset).T
    return np.asarray(np.abs(wrapped(branches(form, poses) - turned)).max(axis=1).argmin(axis=0), dtype=np.int64)


def inverse(arm: Arm, poses: Array) -> Solutions:
    """All branches for tool poses (n, 4, 4) in the world: k = 8 with a closed form, otherwise 16.

    Each solution reproduces its pose within 1e-8 mm and 1e-10 rad. Full turns are removed: coupling @ q is in (-180°,
    180°]. Joint limits are ignored; `within_limits` adds turns and filters. An unreachable or non-finite pose has no
    solution, and no error is raised. At a singular wrist, theta4 corresponds to t4 = 0 (`branches`).
    Coinciding branches are returned once.
    """
    form = canonical(arm)
    solve = partial(_exact, arm, form) if form is not None and form.exact else partial(searched, arm, form)
    finite = np.where(np.isfinite(poses), poses, np.nan)  # nan is processed silently, infinity is not
    parts = [solve(finite[block]) for block in blocks(max(1, len(poses)), _BLOCK)]
    q, solved = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Solutions(q, solved, complete=form is not None and form.exact)


def _exact(arm: Arm, form: Canonical, poses: Array) -> tuple[Array, Mask]:
    turned = wrapped(branches(form, poses) - arm.offset[:, None])
    q: Array = np.linalg.inv(arm.coupling) @ turned
    mm, rad = off_by(arm, poses, q)
    solved = good(mm, rad)
    near = ~solved & (mm < _POLISHED_MM) & (rad < _POLISHED_MM)
    q = np.ascontiguousarray(q.transpose(2, 0, 1))
    solved = np.ascontiguousarray(solved.T)
    if near.any():
        slot, row = np.nonzero(near)
        polished = newton(arm, poses[row], q[row, slot])[0]
        q[row, slot] = polished
        solved[row, slot] = good(*off_by(arm, poses[row], polished.T[None]))[0]
    twins = np.flatnonzero(may_have_duplicates(turned, solved.T))
    solved[twins] = distinct(arm, q[twins], solved[twins])[1]
    q[~solved] = np.nan
    return q, solved

"""Gap between ball and socket of each touch, and its derivatives by all unknowns of two arms.

The unknowns in order: multiples of the terms of the first and the second arm; the set-up with translation (3,) mm and
rotation (3,) rad of the second world about the centre of the work, the ball (3,) mm, and each socket (3,) mm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.pair.arm_terms import GROUPS, PairArm, tool_points
from analysis.apps.pair.pair_table import PairTable
from analysis.robot.geometry.pose_setup import frame
from analysis.robot.kinematics.arm import Array, Integers, Mask
from rigs.errors import FileError
from rigs.schema.declared_tests import KnownSocketDistance

SETUP = 9
"""Number of set-up unknowns before those of the sockets."""


@dataclass(frozen=True)
class PairState:
    """Values of all unknowns: multiples of the terms of both arms, the second world in the first (4, 4), the ball (3,)
    mm in the tool frame of the first arm, and sockets (3,) mm by name, on the second tool or in the first world.
    """

    times: tuple[Array, Array]
    T_first_second: Array
    ball_mm: Array
    sockets_mm: dict[str, Array]

    def moved(self, step: Array, centre_mm: Array) -> PairState:
        """State after a change (unknowns,) of all values; the rotation is about a centre (3,) mm."""
        counts = [len(times) for times in self.times]
        first, second, setup = np.split(step, np.cumsum(counts))
        R = Rotation.from_rotvec(setup[3:6]).as_matrix()
        motion = frame(R, centre_mm + setup[:3] - R @ centre_mm)
        places = setup[SETUP:].reshape(-1, 3)
        sockets = {name: place + shift for (name, place), shift in zip(self.sockets_mm.items(), places, strict=True)}
        times = (self.times[0] + first, self.times[1] + second)
        return PairState(times, motion @ self.T_first_second, self.ball_mm + setup[6:9], sockets)


@dataclass(frozen=True)
class Pair:
    """Two arms, their touches, and known distances between sockets."""

    first: PairArm
    second: PairArm
    table: PairTable
    distances: tuple[KnownSocketDistance, ...]
    where: str

    @property
    def arms(self) -> tuple[PairArm, PairArm]:
        return self.first, self.second

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(np.unique(self.table.socket).tolist())

    @cached_property
    def socket(self) -> Integers:
        """Index (n,) in `names` of each touch's socket."""
        return np.searchsorted(np.array(self.names), self.table.socket)

    @cached_property
    def q_second(self) -> Array:
        """Angles (n, axes) of the second arm; zero if the socket is fixed."""
        return np.where(self.table.is_mounted[:, None], self.table.p, 0.0)

    @property
    def unknowns(self) -> int:
        return len(self.first.terms) + len(self.second.terms) + SETUP + 3 * len(self.names)

    def rows(self, keep: Mask) -> Pair:
        return replace(self, table=self.table.rows(keep))

    def gaps(self, state: PairState) -> tuple[Array, Array, Array]:
        """Gap (n, 3) mm from ball to socket in the first world, and the positions (n, 3) mm of both."""
        ball = tool_points(self.first.poses(self.table.q, state.times[0]), state.ball_mm)
        at, X = self.sockets_at(state), state.T_first_second
        carried = tool_points(self.second.poses(self.q_second, state.times[1]), at) @ X[:3, :3].T + X[:3, 3]
        socket = np.where(self.table.is_mounted[:, None], carried, at)
        return socket - ball, ball, socket

    def sockets_at(self, state: PairState) -> Array:
        """Socket position (n, 3) of each touch, on the second tool or in the first world."""
        return np.stack([state.sockets_mm[name] for name in self.names])[self.socket]


@dataclass(frozen=True)
class LinearGaps:
    """Gaps linearised at a state."""

    y: Array
    """Value (m,) of each reading if all unknowns had their prior mean."""
    columns: Array
    """Derivative (m, k) by each unknown."""
    known_var: Array
    """Variance (m,) in mm² of readings with a stated u; 0 for touches."""
    near: tuple[Array, Array]
    """Correlation (m, m) of the unexplained part of each arm."""
    group: Integers
    """Index (k,) in `GROUPS` of a term, plus 3 for the second arm; -1 for the set-up."""
    state: PairState
    centre_mm: Array

    @property
    def touches(self) -> int:
        """Number of touches, each with three readings."""
        return int((self.known_var == 0).sum()) // 3


def linearise(pair: Pair, state: PairState) -> LinearGaps:
    gap, ball, socket = pair.gaps(state)
    centre = ball.mean(axis=0)
    mounted = pair.table.is_mounted
    T_ball = pair.first.poses(pair.table.q, state.times[0])
    T_socket = pair.second.poses(pair.q_second, state.times[1])
    X = state.T_first_second[:3, :3]
    of_first = -pair.first.slopes(pair.table.q, state.times[0], state.ball_mm)
    of_second = X @ pair.second.slopes(pair.q_second, state.times[1], pair.sockets_at(state)) * mounted[:, None, None]
    setup = np.zeros((len(gap), 3, SETUP + 3 * len(pair.names)))
    setup[:, :, :3] = np.eye(3) * mounted[:, None, None]
    turns = np.cross(np.eye(3), (socket - centre)[:, None]).transpose(0, 2, 1)  # a small rotation about each axis
    setup[:, :, 3:6] = turns * mounted[:, None, None]
    setup[:, :, 6:9] = -T_ball[:, :3, :3]
    of_socket = np.where(mounted[:, None, None], X @ T_socket[:, :3, :3], np.eye(3))
    for number in range(len(pair.names)):
        at = slice(SETUP + 3 * number, SETUP + 3 * number + 3)
        setup[:, :, at] = of_socket * (pair.socket == number)[:, None, None]
    columns = np.concatenate([of_first, of_second, setup], axis=2).reshape(3 * len(gap), -1)
    deviation, known_columns, variance = _known_distances(pair, state)
    columns = np.concatenate([columns, known_columns])
    times = np.concatenate([*state.times, np.zeros(setup.shape[2])])
    y = np.concatenate([-gap.ravel(), deviation]) + columns @ times
    known_var = np.concatenate([np.zeros(gap.size), variance])
    near = (
        _nearness(pair.table.q, np.ones(len(gap), dtype=bool), len(deviation)),
        _nearness(pair.q_second, mounted, len(deviation)),
    )
    groups = [GROUPS.index(term.group) + 3 * k for k, arm in enumerate(pair.arms) for term in arm.terms]
    return LinearGaps(y, columns, known_var, near, np.array(groups + [-1] * setup.shape[2]), state, centre)


def _known_distances(pair: Pair, state: PairState) -> tuple[Array, Array, Array]:
    """Known distances minus those of the state (d,) mm, derivatives (d, unknowns) and variances (d,) mm²."""
    fixed = set(pair.table.socket[~pair.table.is_mounted])
    deviations, columns, variances = [], [], []
    for stated in pair.distances:
        begin, end = stated.between
        if begin not in pair.names or end not in pair.names:
            continue
        if (begin in fixed) != (end in fixed):
            problem = f"the distance from {begin} to {end} is between a fixed socket and a socket on the second arm"
            raise FileError(
                pair.where, problem, "give distances of two sockets that move together", code="pair.distance"
            )
        apart = state.sockets_mm[end] - state.sockets_mm[begin]
        distance = float(np.linalg.norm(apart))
        column = np.zeros(pair.unknowns)
        first = pair.unknowns - 3 * len(pair.names)
        for name, sign in ((begin, -1.0), (end, 1.0)):
            at = first + 3 * pair.names.index(name)
            column[at : at + 3] = sign * apart / distance
        deviations.append(stated.distance_mm - distance)
        columns.append(column)
        variances.append(stated.u_mm**2)
    return np.array(deviations), np.array(columns).reshape(-1, pair.unknowns), np.array(variances)


_NEAR_RAD = (0.6, 1.5)
"""Correlation lengths of the unexplained part in joint space, as in `rig moved`."""


def _nearness(q: Array, has_part: Mask, others: int) -> Array:
    """Correlation (m, m) of the unexplained part of an arm at angles q (n, axes) rad.

    Coordinates are independent. The last `others` readings have no unexplained part.
    """
    apart = (q[:, None] - q[None] + np.pi) % (2 * np.pi) - np.pi
    square = (apart**2).sum(axis=2)
    near = sum(np.exp(-0.5 * square / length**2) for length in _NEAR_RAD) / len(_NEAR_RAD)
    near = near * np.outer(has_part, has_part)
    whole = np.zeros((3 * len(q) + others,) * 2)
    whole[: 3 * len(q), : 3 * len(q)] = np.kron(near, np.eye(3))
    return whole

"""Gap between ball and socket of each touch, and its derivatives by all unknowns of two arms.

Unknowns in order: terms of the first and second arm; translation (3,) mm and rotation (3,) rad of the second world
about the centre of the work; ball (3,) mm; each socket (3,) mm.
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


@dataclass(frozen=True)
class PairState:
    """Multiples of the terms of both arms, the second world in the first (4, 4), the ball (3,) mm on the first tool,
    and sockets (3,) mm by name, on the second tool or in the first world.
    """

    times: tuple[Array, Array]
    T_first_second: Array
    ball_mm: Array
    sockets_mm: dict[str, Array]

    def moved(self, step: Array, centre_mm: Array) -> PairState:
        """State after a change (unknowns,); rotations are about a centre (3,) mm."""
        counts = [len(times) for times in self.times]
        first, second, setup = np.split(step, np.cumsum(counts))
        R = Rotation.from_rotvec(setup[3:6]).as_matrix()
        motion = frame(R, centre_mm + setup[:3] - R @ centre_mm)
        places = setup[SETUP:].reshape(-1, 3)
        sockets = {name: place + shift for (name, place), shift in zip(self.sockets_mm.items(), places, strict=True)}
        times = (self.times[0] + first, self.times[1] + second)
        return PairState(times, motion @ self.T_first_second, self.ball_mm + setup[6:9], sockets)

    def distance_mm(self, known: KnownSocketDistance) -> float:
        begin, end = (self.sockets_mm[name] for name in known.between)
        return float(np.linalg.norm(end - begin))


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
        return np.searchsorted(np.array(self.names), self.table.socket)

    @cached_property
    def q_second(self) -> Array:
        """Angles (n, axes); zero if the socket is fixed."""
        return np.where(self.table.is_mounted[:, None], self.table.p, 0.0)

    @property
    def unknowns(self) -> int:
        return len(self.first.terms) + len(self.second.terms) + SETUP + 3 * len(self.names)

    def rows(self, keep: Mask) -> Pair:
        return replace(self, table=self.table.rows(keep))

    def gaps(self, state: PairState) -> Array:
        """Gap (n, 3) mm from ball to socket in the first world."""
        T_first, T_second = self.poses(state.times)
        return self.between(T_first, T_second, state)

    def poses(self, times: tuple[Array, Array]) -> tuple[Array, Array]:
        return self.first.poses(self.table.q, times[0]), self.second.poses(self.q_second, times[1])

    def between(self, T_first: Array, T_second: Array, state: PairState) -> Array:
        at, X = self.sockets_at(state), state.T_first_second
        carried = tool_points(T_second, at) @ X[:3, :3].T + X[:3, 3]
        socket = np.where(self.table.is_mounted[:, None], carried, at)
        return np.asarray(socket - tool_points(T_first, state.ball_mm))

    def sockets_at(self, state: PairState) -> Array:
        """(n, 3), on the second tool or in the first world."""
        return np.stack([state.sockets_mm[name] for name in self.names])[self.socket]


@dataclass(frozen=True)
class LinearGaps:
    """Gaps linearised at a state."""

    y: Array
    """Readings (m,) if all unknowns had their prior mean."""
    columns: Array
    """Derivative (m, k) by each unknown."""
    known_var: Array
    near: tuple[Array, Array]
    """Correlations (m, m) of the unexplained part of each arm."""
    group: Integers
    """Index (k,) in `GROUPS`, plus 3 for the second arm; -1 for the set-up."""
    state: PairState
    centre_mm: Array

    @property
    def touches(self) -> int:
        return int((self.known_var == 0).sum()) // 3


_STEP, _STEP_RAD = 1e-3, 1e-6
"""Steps of derivatives by the set-up, in mm and rad."""


def linearise(pair: Pair, state: PairState) -> LinearGaps:
    T_first, T_second = pair.poses(state.times)
    mounted, terms = pair.table.is_mounted, sum(map(len, state.times))
    centre = tool_points(T_first, state.ball_mm).mean(axis=0)
    distances = _known_distances(pair)

    def left(step: Array) -> Array:
        """Gaps, and distances beyond the known ones (m,) mm, after a change of the set-up."""
        at = state.moved(np.concatenate([np.zeros(terms), step]), centre)
        beyond = [at.distance_mm(known) - known.distance_mm for known in distances]
        return np.concatenate([pair.between(T_first, T_second, at).ravel(), beyond])

    begin = left(np.zeros(pair.unknowns - terms))
    steps = np.full(pair.unknowns - terms, _STEP)
    steps[3:6] = _STEP_RAD
    setup = np.stack([left(step) - begin for step in np.diag(steps)], axis=1) / steps
    of_first = -pair.first.slopes(pair.table.q, state.times[0], state.ball_mm)
    of_second = pair.second.slopes(pair.q_second, state.times[1], pair.sockets_at(state)) * mounted[:, None, None]
    of_terms = np.zeros((len(begin), terms))
    of_terms[: 3 * len(mounted)] = np.dstack([of_first, state.T_first_second[:3, :3] @ of_second]).reshape(-1, terms)
    near = (
        _nearness(pair.table.q, np.ones(len(mounted), dtype=bool), len(distances)),
        _nearness(pair.q_second, mounted, len(distances)),
    )
    groups = [GROUPS.index(term.group) + 3 * k for k, arm in enumerate(pair.arms) for term in arm.terms]
    return LinearGaps(
        of_terms @ np.concatenate(state.times) - begin, np.hstack([of_terms, setup]),
        np.concatenate([np.zeros(3 * len(mounted)), [known.u_mm**2 for known in distances]]), near,
        np.array(groups + [-1] * len(steps)), state, centre,
    )  # fmt: skip


def _known_distances(pair: Pair) -> list[KnownSocketDistance]:
    """Raises FileError for sockets that do not move together."""
    fixed = set(pair.table.socket[~pair.table.is_mounted])
    known = [stated for stated in pair.distances if set(stated.between) <= set(pair.names)]
    for begin, end in (stated.between for stated in known):
        if (begin in fixed) != (end in fixed):
            problem = f"the distance from {begin} to {end} is between a fixed socket and a socket on the second arm"
            remedy = "give distances of two sockets that move together"
            raise FileError(pair.where, problem, remedy, code="pair.invalid")
    return known


_NEAR_RAD = (0.6, 1.5)
"""Correlation lengths of the unexplained part in joint space, as in `rig moved`."""


def _nearness(q: Array, has_part: Mask, others: int) -> Array:
    """Correlation (m, m) of the unexplained part at angles q (n, axes) rad; the last `others` readings have none."""
    apart = (q[:, None] - q[None] + np.pi) % (2 * np.pi) - np.pi
    square = (apart**2).sum(axis=2)
    near = sum(np.exp(-0.5 * square / length**2) for length in _NEAR_RAD) / len(_NEAR_RAD)
    near = near * np.outer(has_part, has_part)
    whole = np.zeros((3 * len(q) + others,) * 2)
    whole[: 3 * len(q), : 3 * len(q)] = np.kron(near, np.eye(3))
    return whole

"""Postures for touches of two arms, the expected result, and simulated touches for trying the plan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.apps.pair.arm_terms import arm_terms, tool_points
from analysis.apps.pair.fit_pair import FittedPair, ball_of, pair_of
from analysis.apps.pair.linear_gap import Pair, PairState, linearise
from analysis.apps.pair.pair_table import PairTable
from analysis.apps.pair.posterior import expected_posterior, setup_sds
from analysis.apps.pair.postures import common_postures
from analysis.apps.pair.result import PairResult, result_of
from analysis.robot.kinematics.arm import Array, forward_and_jacobian
from analysis.robot.predict import model_of
from analysis.runs.noise.cell_noise import SEAT_MM
from analysis.runs.tables import SOCKET, joint_columns, second_joint_columns
from analysis.runs.written_files import csv_text
from rigs.rig import Rig

_CANDIDATES = 500
"""Chosen: ten for each touch of a usual plan."""
_READING_MM = 0.1
_SEED = 1


@dataclass(frozen=True)
class PlannedTouches:
    table: PairTable
    expected: PairResult

    def to_dict(self) -> dict[str, Any]:
        whole, table = self.expected.to_dict(), self.table
        q_deg, p_deg = (np.round(np.degrees(angles), 4).tolist() for angles in (table.q, table.p))
        touches = [
            {"socket": socket, "q_deg": q, "p_deg": p}
            for socket, q, p in zip(table.socket.tolist(), q_deg, p_deg, strict=True)
        ]
        keys = ("u_xyz_mm", "u_rotation_deg", "u_distance_mm", "work_mm", "u_work_mm")
        return {
            "touches": touches,
            "expected": {
                "base": {key: whole["base"][key] for key in keys}, "scale_u_ppm": whole["scale"]["u_ppm"],
                "constants": [{key: constant[key] for key in ("arm", "axis", "key", "symbol", "u", "shown")}
                              for constant in whole["constants"]],
            },
            "not_testable": whole["not_testable"],
        }  # fmt: skip

    def csv(self) -> str:
        """The operator replaces the planned angles by the reported ones."""
        table = self.table
        head = [SOCKET, *joint_columns(table.q.shape[1]), *second_joint_columns(table.p.shape[1])]
        angles = np.degrees(np.hstack([table.q, table.p])).tolist()
        rows = zip(table.socket.tolist(), angles, strict=True)
        return csv_text([head, *([socket, *(f"{angle:z.4f}" for angle in row)] for socket, row in rows)])


def plan_touches(first: Rig, second: Rig, count: int, where: str) -> PlannedTouches:
    """Most informative first, for two rig files whose bases are in the same world."""
    socket = second.tests.touch.sockets[0] if second.tests.touch else "A"
    empty = PairTable(np.empty((0, 0)), np.empty((0, 0)), np.empty(0, dtype=np.str_), np.empty(0, dtype=np.int64))
    pair = pair_of(first, second, empty, where)
    arms, points = (pair.first.model.arm, pair.second.model.arm), (ball_of(first), ball_of(second))
    rng = np.random.default_rng(_SEED)
    q, p = common_postures(arms, points, max(_CANDIDATES, 2 * count), rng, where)
    zeros = (np.zeros(len(pair.first.terms)), np.zeros(len(pair.second.terms)))
    state = PairState(zeros, np.eye(4), points[0], {socket: points[1]})

    def touching(q: Array, p: Array) -> Pair:
        table = PairTable(q, p, np.full(len(q), socket), np.arange(1, len(q) + 1))
        return replace(pair, table=table, distances=())

    chosen = _chosen(touching(q, p), state, count)
    final = touching(q[chosen], p[chosen])  # in order of selection
    gaps = linearise(final, state)
    expected = result_of(FittedPair(final, gaps, expected_posterior(gaps), state, (), 0.0))
    return PlannedTouches(final.table, expected)


def _chosen(pair: Pair, state: PairState, count: int) -> list[int]:
    """Touches that add most information about constants, gravity and set-up, one after the other."""
    gaps = linearise(pair, state)
    touches = gaps.columns.reshape(len(pair.table.q), 3, -1)
    is_curve = (gaps.group >= 0) & (gaps.group % 3 == 2)
    curves = touches[:, :, is_curve]  # treated as noise of each touch
    noise = curves @ curves.transpose(0, 2, 1) + _READING_MM**2 * np.eye(3)
    columns = np.linalg.solve(np.linalg.cholesky(noise), touches[:, :, ~is_curve])
    prior = np.ones(len(gaps.group))
    prior[gaps.group < 0] = setup_sds(gaps) ** 2
    cov = np.diag(prior[~is_curve])
    chosen: list[int] = []
    free = np.ones(len(columns), dtype=bool)
    for _ in range(count):
        spread = columns @ cov
        inner = np.eye(3) + spread @ columns.transpose(0, 2, 1)
        best = int(np.argmax(np.where(free, np.linalg.slogdet(inner)[1], -np.inf)))
        cov = cov - spread[best].T @ np.linalg.solve(inner[best], spread[best])
        chosen.append(best)
        free[best] = False
    return chosen


_BASE_MM, _BASE_RAD, _BALL_MM = 5.0, 0.003, 2.0
"""Standard deviations of the second base, ball and socket, placed by tape measure."""
_ROUNDS = 8


def simulated_touches(first: Rig, second: Rig, planned: PairTable, seed: int) -> tuple[PairTable, PairState]:
    rng = np.random.default_rng(seed)
    pair = pair_of(first, second, planned, "simulated touches")
    times = [rng.standard_normal(len(arm_terms(rig))) for rig in (first, second)]
    sockets = {name: np.zeros(3) for name in pair.names}
    begun = PairState((times[0], times[1]), np.eye(4), _drawn_point(first, rng), sockets)
    count = len(times[0]) + len(times[1])
    step = np.concatenate([np.zeros(count), _BASE_MM * rng.standard_normal(3), _BASE_RAD * rng.standard_normal(3),
                           np.zeros(3), *(_drawn_point(second, rng) for _ in pair.names)])  # fmt: skip
    state = begun.moved(step, pair.second.model.arm.T_world_base[:3, 3])
    seat = SEAT_MM * rng.standard_normal((len(planned.q), 3))
    p = planned.p.copy()
    for _ in range(_ROUNDS):
        gap = replace(pair, table=replace(planned, p=p)).gaps(state)
        T, J = forward_and_jacobian(pair.second.model.arm, p)
        at = np.stack([state.sockets_mm[name] for name in planned.socket.tolist()])
        slope = J[:, :3] + np.cross(J[:, 3:], (tool_points(T, at) - T[:, :3, 3])[:, :, None], axis=1)
        shift = (seat - gap) @ state.T_first_second[:3, :3]
        p += np.einsum("nij,nj->ni", np.linalg.pinv(slope), shift)
    return PairTable(planned.q, p, planned.socket, planned.row), state


def _drawn_point(rig: Rig, rng: np.random.Generator) -> Array:
    return np.asarray(ball_of(rig) + _BALL_MM * rng.standard_normal(3))


def base_of(first: Rig, second: Rig, state: PairState) -> Array:
    bases = [model_of(rig).arm.T_world_base for rig in (first, second)]
    return np.asarray((np.linalg.inv(bases[0]) @ state.T_first_second @ bases[1])[:3, 3])

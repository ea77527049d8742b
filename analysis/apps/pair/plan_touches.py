"""Selection of postures for touches of two arms, and the expected result."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.apps.pair.fit_pair import FittedPair, ball_of, pair_of
from analysis.apps.pair.linear_gap import Pair, PairState, linearise
from analysis.apps.pair.pair_table import PairTable
from analysis.apps.pair.posterior import expected_posterior, setup_sds
from analysis.apps.pair.postures import common_postures
from analysis.apps.pair.result import PairResult, result_of
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import SOCKET, joint_columns, second_joint_columns
from rigs.rig import Rig

_CANDIDATES = 500
"""Number of candidate postures. Chosen: ten for each touch of a usual plan."""
_READING_MM = 0.1
"""Standard deviation assumed for the selection: seat and unmodelled error."""
_SEED = 1


@dataclass(frozen=True)
class PlannedTouches:
    """Touches, most informative first, and the expected result."""

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
        """Postures as a table. After each touch, the operator replaces the planned angles by the reported ones."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([SOCKET, *joint_columns(self.table.q.shape[1]), *second_joint_columns(self.table.p.shape[1])])
        for socket, q, p in zip(self.table.socket.tolist(), self.table.q, self.table.p, strict=True):
            writer.writerow([socket, *(f"{angle:z.4f}" for angle in np.degrees(np.concatenate([q, p])))])
        return text.getvalue()


def plan_touches(first: Rig, second: Rig, count: int, where: str) -> PlannedTouches:
    """Select touches of two arms whose rig files describe their bases in the same world."""
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
    """Indices of the touches that add most information about constants, gravity and set-up, one after the other."""
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

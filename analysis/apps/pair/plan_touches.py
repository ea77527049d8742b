"""Selection of postures for touches of two arms, and the expected result."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.apps.pair.fit_pair import ball_of, pair_of
from analysis.apps.pair.linear_gap import Pair, PairState, linearise
from analysis.apps.pair.pair_table import PairTable
from analysis.apps.pair.posterior import expected_posterior, setup_sds
from analysis.apps.pair.postures import common_postures
from analysis.apps.pair.result import PairResult, result_of_plan
from analysis.runs.table_layout import SOCKET, joint_columns, second_joint_columns
from rigs.rig import Rig

_CANDIDATES = 500
"""Number of candidate postures. Chosen: ten for each touch of a usual plan."""
_READING_MM = 0.1
"""Standard deviation of a coordinate of a touch assumed for the selection: seat and unmodelled error."""
_SEED = 1


@dataclass(frozen=True)
class PlannedTouches:
    """Touches in the order of selection, most informative first, and the expected result."""

    table: PairTable
    expected: PairResult

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain types for JSON."""
        whole = self.expected.to_dict()
        touches = [
            {
                "socket": socket,
                "q_deg": np.round(np.degrees(q), 4).tolist(),
                "p_deg": np.round(np.degrees(p), 4).tolist(),
            }
            for socket, q, p in zip(self.table.socket.tolist(), self.table.q, self.table.p, strict=True)
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
        """Return the postures as a CSV table. After each touch, the operator replaces the planned joint angles by
        the reported ones.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([SOCKET, *joint_columns(self.table.q.shape[1]), *second_joint_columns(self.table.p.shape[1])])
        for socket, q, p in zip(self.table.socket.tolist(), self.table.q, self.table.p, strict=True):
            writer.writerow([socket, *(f"{angle:z.4f}" for angle in np.degrees(np.concatenate([q, p])))])
        return text.getvalue()


def plan_touches(first: Rig, second: Rig, count: int, where: str) -> PlannedTouches:
    """Select touches of two arms whose rig files describe their bases in the same world. Raises FileError if the
    arms can hardly reach each other.
    """
    socket = second.tests.touch.sockets[0] if second.tests.touch else "A"
    empty = PairTable(np.empty((0, 0)), np.empty((0, 0)), np.empty(0, dtype=np.str_), np.empty(0, dtype=np.int64))
    pair = pair_of(first, second, empty, where)
    arms, points = (pair.first.model.arm, pair.second.model.arm), (ball_of(first), ball_of(second))
    rng = np.random.default_rng(_SEED)
    postures = common_postures(arms, points, max(_CANDIDATES, 2 * count), rng, where)
    total = len(postures.q)
    table = PairTable(postures.q, postures.p, np.full(total, socket), np.arange(1, total + 1))
    zeros = (np.zeros(len(pair.first.terms)), np.zeros(len(pair.second.terms)))
    state = PairState(zeros, np.eye(4), points[0], {socket: points[1]})
    candidates = Pair(pair.first, pair.second, table, (), where)
    chosen = _chosen(candidates, state, count)
    keep = table.rows(np.array(chosen))  # in order of selection
    planned = PairTable(keep.q, keep.p, keep.socket, np.arange(1, count + 1))
    final = Pair(pair.first, pair.second, planned, (), where)
    gaps = linearise(final, state)
    return PlannedTouches(planned, result_of_plan(final, gaps, state, expected_posterior(gaps)))


def _chosen(pair: Pair, state: PairState, count: int) -> list[int]:
    """Return the indices of the touches that add most information about constants, gravity and set-up, one after the
    other.
    """
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

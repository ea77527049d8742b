"""Simulated touches of two arms with typical errors, for trying plan and fit without robots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.apps.pair.arm_terms import arm_terms, tool_points
from analysis.apps.pair.fit_pair import ball_of, pair_of
from analysis.apps.pair.linear_gap import PairState
from analysis.apps.pair.pair_table import PairTable
from analysis.robot.kinematics.arm import Array, forward_and_jacobian
from analysis.robot.model.predict import model_of
from analysis.runs.noise.cell_noise import SEAT_MM
from rigs.rig import Rig

_BASE_MM, _BASE_RAD, _BALL_MM = 5.0, 0.003, 2.0
"""Standard deviations of the second base, ball and socket, as placed by tape measure."""
_ROUNDS = 8


def simulated_touches(first: Rig, second: Rig, planned: PairTable, seed: int) -> tuple[PairTable, PairState]:
    """Touches of two random arms near planned postures, and their true state."""
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
        gap, _, _ = replace(pair, table=replace(planned, p=p)).gaps(state)
        T, J = forward_and_jacobian(pair.second.model.arm, p)
        at = np.stack([state.sockets_mm[name] for name in planned.socket.tolist()])
        slope = J[:, :3] + np.cross(J[:, 3:], (tool_points(T, at) - T[:, :3, 3])[:, :, None], axis=1)
        shift = (seat - gap) @ state.T_first_second[:3, :3]
        p += np.einsum("nij,nj->ni", np.linalg.pinv(slope), shift)
    return PairTable(planned.q, p, planned.socket, planned.row), state


def _drawn_point(rig: Rig, rng: np.random.Generator) -> Array:
    return np.asarray(ball_of(rig) + _BALL_MM * rng.standard_normal(3))


def base_of(first: Rig, second: Rig, state: PairState) -> Array:
    """Position (3,) of the second base in the first."""
    bases = [model_of(rig).arm.T_world_base for rig in (first, second)]
    return np.asarray((np.linalg.inv(bases[0]) @ state.T_first_second @ bases[1])[:3, 3])

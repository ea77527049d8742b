"""Cells of two arms, their touches, and the comparison of a fit with the true arms.

`tests/tables/two_arms.json` has them as an independent world drew them: a UR10e that holds a ball beside an iiwa 14 and
light arms of four and five axes with a socket. The true arms have errors of zeros and constants, gear waves, and a
compliance that no fit models.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.pair.arm_terms import PairArm, tool_points
from analysis.apps.pair.fit_pair import FittedPair
from analysis.apps.pair.pair_table import PairTable
from analysis.robot.kinematics.arm import Array
from rigs.load import parse
from rigs.rig import Rig
from tests.worlds.chain import link_frames

_DRAWN: dict[str, Any] = json.loads((Path(__file__).parents[1] / "tables" / "two_arms.json").read_text())
KNOWN = "    distances: [{between: [C, D], distance_mm: 555.5178, u_mm: 0.02}]\n"
"""Distance of two fixed sockets, as stated in a rig file."""


def rigs(second: str = "iiwa", more: str = "") -> tuple[Rig, Rig]:
    """Rigs with the data-sheet constants of the arms of a cell; more lines for the touch test of the first."""
    return parse(_DRAWN["rigs"]["left"] + more, "left"), parse(_DRAWN["rigs"][second], "right")


def touches_of_pair(second: str = "iiwa") -> PairTable:
    """Touches in random postures of both arms."""
    q, p = (np.radians(_DRAWN["cells"][second][name]) for name in ("q_deg", "p_deg"))
    return PairTable(q, p, np.full(len(q), "A"), np.arange(1, len(q) + 1))


def with_fixed(table: PairTable) -> PairTable:
    """Touches of both arms, and those of two fixed sockets by the first."""
    q = np.concatenate([table.q, np.radians(_DRAWN["alone"]["q_deg"])])
    p = np.concatenate([table.p, np.full((len(q) - len(table.q), table.p.shape[1]), np.nan)])
    return PairTable(q, p, np.concatenate([table.socket, _DRAWN["alone"]["socket"]]), np.arange(1, len(q) + 1))


def known_base(second: str = "iiwa") -> Array:
    """Transform (4, 4) between the frames of axis 1 of both arms."""
    return np.array(_DRAWN["cells"][second]["known_base"])


def nominal_points(rig: Rig, q: Array, point_mm: tuple[float, float, float]) -> Array:
    """Positions (n, 3) mm of a point on the flange of an arm of the data sheet, in its base."""
    axes = rig.robot.axes
    a, alpha, d = ([getattr(axis, name) for axis in axes] for name in ("a_mm", "alpha_deg", "d_mm"))
    R, p = link_frames(a, np.radians(alpha), 0.0, d, q)
    return np.asarray(p[:, -1] + R[:, -1] @ np.array(point_mm))


@dataclass(frozen=True)
class Deviations:
    """Errors of a fit. z: error divided by u. error: rms of tool positions in mm, by arm, of the nominal and the
    fitted arm."""

    z: Array
    error: dict[str, float]


def deviations(fit: FittedPair) -> Deviations:
    """Errors of a fit of the iiwa's cell."""
    z, error = list[float](), dict[str, float]()
    sd, first = np.sqrt(np.diag(fit.posterior.cov)), 0
    for name, arm in (("first", fit.pair.first), ("second", fit.pair.second)):
        own, true = slice(first, first + len(arm.terms)), _DRAWN["arms"][name]
        first = own.stop
        z += _constants(arm, true, fit.posterior.mean[own], sd[own])
        for known, times in (("nominal", np.zeros(len(arm.terms))), ("fitted", fit.posterior.mean[own])):
            error[f"{name} {known}"] = _place_error(arm, true, times)
    centre, off = fit.gaps.centre_mm, known_base() @ np.linalg.inv(fit.state.T_first_second)
    shift, turn = off[:3, :3] @ centre + off[:3, 3] - centre, Rotation.from_matrix(off[:3, :3]).as_rotvec()
    return Deviations(np.array([*z, *np.concatenate([shift, turn]) / sd[first : first + 6]]), error)


def _constants(arm: PairArm, true: dict[str, Any], mean: Array, sd: Array) -> list[float]:
    found = []
    for k, term in enumerate(arm.terms):
        effect = term.effect.model_dump()
        if term.group == "constants":
            field = effect.get("field", "zero")
            unit = effect["offset_deg"] if field == "zero" else effect["delta"]
            truth = true[field + ("_mm" if field in "ad" else "_deg")][effect["axis"] - 1]
            found.append((mean[k] * unit - truth) / (sd[k] * unit))
    return found


def _place_error(arm: PairArm, true: dict[str, Any], times: Array) -> float:
    """Rms position error in mm of the tool in random postures.

    The base frame and the ball position are fitted first, because joint tables do not contain them.
    """
    truth, ball = np.array(true["at_mm"]), np.array(true["point_mm"])
    T = arm.poses(np.radians(true["q_deg"]), times)
    for _ in range(3):
        places = tool_points(T, ball)
        centre, at = truth.mean(axis=0), places.mean(axis=0)
        R = Rotation.align_vectors(truth - centre, places - at)[0].as_matrix()
        gap = truth - ((places - at) @ R.T + centre)
        turns = -np.cross((places - at)[:, None], np.eye(3)).transpose(0, 2, 1)
        shifts = np.tile(np.eye(3), (len(truth), 1, 1))
        design = np.concatenate([shifts, R @ turns, R @ T[:, :3, :3]], axis=2).reshape(-1, 9)
        step = np.linalg.lstsq(design, gap.ravel(), rcond=None)[0]
        ball = ball + step[6:]
    left = (gap.ravel() - design @ step).reshape(-1, 3)
    return float(np.sqrt((left**2).sum(axis=1).mean()))

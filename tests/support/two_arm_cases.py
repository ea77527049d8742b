"""Random cells with two arms, their touches, and the comparison of a fit with the true arms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.pair.arm_terms import PairArm, tool_points
from analysis.apps.pair.fit_pair import FittedPair, fit_pair, pair_of
from analysis.apps.pair.pair_table import PairTable
from analysis.robot.kinematics.arm import Array
from rigs.load import parse
from rigs.rig import Rig
from tests.worlds import two_arms as world

FIXED_MM = (np.array([520.0, -180.0, 250.0]), np.array([380.0, 330.0, 420.0]))
"""Positions of two fixed sockets in the cell, for an arm measured on its own."""


KNOWN_MM = float(np.linalg.norm(FIXED_MM[0] - FIXED_MM[1]))
KNOWN = f"    distances: [{{between: [C, D], distance_mm: {KNOWN_MM:.4f}, u_mm: 0.02}}]"
"""Their distance, as stated in a rig file."""


def rig_of(kind: world.Kind, name: str, ball: tuple[float, float, float], more: str = "") -> Rig:
    """Rig with the data-sheet constants of an arm."""
    return parse(rig_text(kind, name, ball, more), name)


def rig_text(kind: world.Kind, name: str, ball: tuple[float, float, float], more: str = "") -> str:
    """Text of the rig file of an arm, with additional lines for the touch test."""
    lines = [f"name: {name}", "robot:", f"  name: {kind.name}", f"  build: {kind.build}", "  axes:"]
    constants = zip(kind.a, kind.alpha, kind.d, kind.limit, kind.mass, kind.centre, strict=True)
    for k, (a, alpha, d, limit, mass, centre) in enumerate(constants, start=1):
        lines.append(
            f"    - {{name: J{k}, a_mm: {a}, alpha_deg: {alpha}, d_mm: {d}, limits_deg: [-{limit}, {limit}], "
            f"speed_deg_s: 100, mass_kg: {mass}, centre_mm: {list(centre)}}}"
        )
    return (
        "\n".join([*lines, "tests:", "  touch:", "    sockets: [A, C, D]", f"    ball_mm: {list(ball)}", more]) + "\n"
    )


@dataclass(frozen=True)
class Deviations:
    """Errors of a fit. z: error divided by u, by quantity. error: errors of zeros in degrees, of lengths in mm and
    of tool positions in mm, by arm and quantity.
    """

    z: dict[str, list[float]]
    error: dict[str, float]
    fitted: FittedPair


def touches_of_pair(cell: world.Cell, count: int, scatter_mm: float, rng: np.random.Generator) -> PairTable:
    """Simulate touches in random postures of both arms."""
    q, p = world.touched(cell, *world.pair_postures(cell, count, rng), scatter_mm, rng)
    return PairTable(q, p, np.full(count, "A"), np.arange(1, count + 1))


def touches_alone(
    arm: world.TrueArm, other_axes: int, count: int, scatter_mm: float, rng: np.random.Generator
) -> PairTable:
    """Simulate touches of two fixed sockets in random postures of one arm."""
    limit, rows, sockets = np.radians(arm.kind.limit), [], []
    for number, place in enumerate(FIXED_MM):
        wanted = (count + 1 - number) // 2
        found: list[Array] = []
        while len(found) < wanted:
            q = rng.uniform(-limit, limit, size=(4 * count, len(limit)))
            q = world.touched_fixed(arm, q, np.tile(place, (len(q), 1)), scatter_mm, rng)
            q = (q + np.pi) % (2 * np.pi) - np.pi
            near = np.linalg.norm(arm.tip_and_slope(q)[0] - place, axis=1) < 10 * scatter_mm
            found += list(q[near & (np.abs(q) < limit).all(axis=1)])
        rows += found[:wanted]
        sockets += ["CD"[number]] * wanted
    return PairTable(np.array(rows), np.full((count, other_axes), np.nan), np.array(sockets), np.arange(1, count + 1))


def with_fixed(table: PairTable, fixed: PairTable) -> PairTable:
    """Return touches of both arms combined with those of fixed sockets."""
    columns = [np.concatenate([getattr(part, name) for part in (table, fixed)]) for name in ("q", "p", "socket")]
    return PairTable(*columns, np.arange(1, len(columns[0]) + 1))


def fitted(first: Rig, second: Rig, table: PairTable) -> FittedPair:
    """Fit a table of touches."""
    return fit_pair(pair_of(first, second, table, "trial"))


def deviations(cell: world.Cell, fit: FittedPair, rng: np.random.Generator, *, alone: bool = False) -> Deviations:
    """Errors of a fit; for an arm fitted on its own, only those of the first arm."""
    z: dict[str, list[float]] = {"zeros": [], "lengths": [], "twists": [], "base": []}
    error: dict[str, float] = {}
    sd, first = np.sqrt(np.diag(fit.posterior.cov)), 0
    for name, arm, true in (("first", fit.pair.first, cell.first), ("second", fit.pair.second, cell.second)):
        own = slice(first, first + len(arm.terms))
        first = own.stop
        if alone and name == "second":
            continue
        of_arm = _constants(arm, true, fit.posterior.mean[own], sd[own])
        for quantity, rows in of_arm.items():
            z[quantity] += [off / u for off, u in rows]
            error[f"{name} {quantity}"] = float(np.sqrt(np.mean([off**2 for off, _ in rows])))
        for known, times in (("nominal", np.zeros(len(arm.terms))), ("fitted", fit.posterior.mean[own])):
            error[f"{name} place {known}"] = _place_error(arm, true, times, rng)
    if not alone:
        centre = fit.gaps.centre_mm
        off = cell.known_base @ np.linalg.inv(fit.state.T_first_second)
        shift = off[:3, :3] @ centre + off[:3, 3] - centre
        turn = Rotation.from_matrix(off[:3, :3]).as_rotvec()
        z["base"] = (np.concatenate([shift, turn]) / sd[first : first + 6]).tolist()
        error["base"] = float(np.linalg.norm(shift))
    return Deviations(z, error, fit)


def _constants(arm: PairArm, true: world.TrueArm, mean: Array, sd: Array) -> dict[str, list[tuple[float, float]]]:
    """Return error and u of each zero in degrees, length in mm and twist in degrees."""
    found: dict[str, list[tuple[float, float]]] = {"zeros": [], "lengths": [], "twists": []}
    nominal = world.nominal_arm(true.kind, true.point)
    for k, term in enumerate(arm.terms):
        effect = term.effect.model_dump()
        if term.group != "constants":
            continue
        axis = effect["axis"] - 1
        if effect["effect"] == "joint_offset":
            quantity, unit, truth = "zeros", effect["offset_deg"], np.degrees(true.zero[axis])
        else:
            quantity, unit = "lengths" if effect["field"] in "ad" else "twists", effect["delta"]
            truth = getattr(true, effect["field"])[axis] - getattr(nominal, effect["field"])[axis]
            truth = truth if quantity == "lengths" else np.degrees(truth)
        found[quantity].append((mean[k] * unit - truth, sd[k] * unit))
    return found


def _place_error(arm: PairArm, true: world.TrueArm, times: Array, rng: np.random.Generator, count: int = 300) -> float:
    """Rms position error in mm of the tool in random postures.

    The base frame and the ball position are fitted first, because joint tables do not contain them.
    """
    limit = np.radians(true.kind.limit)
    q = rng.uniform(-limit, limit, size=(count, len(limit)))
    T = arm.poses(q, times)
    truth, ball = true.tip_and_slope(q)[0], true.point
    for _ in range(3):
        places = tool_points(T, ball)
        centre, at = truth.mean(axis=0), places.mean(axis=0)
        R = Rotation.align_vectors(truth - centre, places - at)[0].as_matrix()
        gap = truth - ((places - at) @ R.T + centre)
        x, y, zc = (places - at).T @ np.eye(count)
        zero = np.zeros(count)
        turns = np.stack([np.stack(r, axis=1) for r in ([zero, zc, -y], [-zc, zero, x], [y, -x, zero])], axis=1)
        design = np.concatenate([np.tile(np.eye(3), (count, 1, 1)), R @ turns, R @ T[:, :3, :3]], axis=2).reshape(-1, 9)
        step = np.linalg.lstsq(design, gap.ravel(), rcond=None)[0]
        ball = ball + step[6:]
    left = (gap.ravel() - design @ step).reshape(-1, 3)
    return float(np.sqrt((left**2).sum(axis=1).mean()))

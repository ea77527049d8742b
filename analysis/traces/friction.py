"""The friction of joints as the currents of their motors show it: by how much they jump where a joint turns back.

Where a joint turns back, all that its motor carries goes on smoothly: gravity, inertia, what grows with speed, which is
zero there. Friction alone changes its sign. So half of the jump is the current that friction takes, and no mass, gear
or motor has to be known. It is Coulomb's part, of a joint that creeps; what grows with speed is not in it.
Source of the law: Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30 (1994), 2.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.geometry.circle import peaks
from analysis.kinematics.arm import Array
from rigs.schema.condition import CURRENTS

_CREEPS_DEG = 0.05
"""So near its turning point a joint may stick, and its friction has any value up to Coulomb's. Chosen: encoders of arms
see it leave after some thousandths of a degree."""
_WAY_DEG = 3.0
"""How far from its turning point a joint is looked at, at the most, and the least way is a third of it."""
_WAITS = 0.4
"""Share of the time on one side that creeping takes of a joint that turns in motion: 0.13 of the longest way to 0.22 of
the shortest, at an even acceleration. One that waits there brakes and starts again, whose torque jumps too."""
_PIECES = 12
"""Means of currents to each side, by equal ways: ripple within a piece, which is no noise, is averaged."""
_ORDER = 3
"""Order of the polynomial in time that everything but friction follows."""


@dataclass(frozen=True)
class Friction:
    """Current in A that friction takes of a joint's motor, its standard uncertainty, and how often the joint turned."""

    current_a: float
    u_a: float
    turns: int


def friction_of(robot: Mapping[str, np.ndarray[Any, Any]], t_s: Array) -> dict[int, Friction]:
    """The friction of each axis, 1 … 6, that turns back in motion, from the columns (n,) of a run's robot stream at
    times t_s (n,).

    u holds what the fits leave, or how the turns of a joint differ, whichever is more.
    """
    friction = {}
    for axis, name in enumerate(CURRENTS, 1):
        current = robot.get(name, np.empty(0))
        shown = np.isfinite(current)
        if not shown.any() or np.ptp(current[shown]) == 0:
            continue
        if turns := _turns(t_s[shown], robot[f"q{axis}_deg"][shown], current[shown]):
            values, u = np.array(turns).T
            n = len(values)
            within = float(np.sqrt((u**2).sum()) / n)
            between = 0.0 if n == 1 else float(values.std(ddof=1) / np.sqrt(n))
            friction[axis] = Friction(float(values.mean()), max(within, between), n)
    return friction


def _turns(t_s: Array, q_deg: Array, current_a: Array) -> list[tuple[float, float]]:
    """Friction, half the jump of the current, and its standard uncertainty in A at each turn of a joint."""
    places = sorted((k, sign) for sign in (1, -1) for k in peaks(sign * q_deg, _WAY_DEG / 3))
    ends = [0, *(k for k, _ in places), len(q_deg) - 1]
    turns = []
    for (k, sign), before, after in zip(places, ends[:-2], ends[2:], strict=True):
        away = sign * (q_deg[k] - q_deg)
        sides = [_side(t_s, away, current_a, k, end) for end in (before, after)]
        pieces = [side for side in sides if side is not None]
        if len(pieces) < len(sides):
            continue
        since_s, side, current = np.concatenate(pieces).T
        design = np.column_stack([-sign * side, np.vander(since_s / np.abs(since_s).max(), _ORDER + 1)])
        fitted, *_ = np.linalg.lstsq(design, current, rcond=None)
        residual = current - design @ fitted
        variance = float(residual @ residual) / (len(current) - design.shape[1])
        u = float(np.sqrt(variance * np.linalg.inv(design.T @ design)[0, 0]))
        turns.append((float(fitted[0]), u))
    return turns


def _side(t_s: Array, away_deg: Array, current_a: Array, turn: int, end: int) -> Array | None:
    """Time from the turn, side and mean current (pieces, 3) of what a joint drives towards a turn or from it; None
    where it stands, or does not drive far enough."""
    step = 1 if end > turn else -1
    rows = np.arange(turn, end + step, step)
    rows = rows[: int(np.argmax(away_deg[rows] > _WAY_DEG)) or len(rows)]
    rows = rows[away_deg[rows] > _CREEPS_DEG]
    if len(rows) < 2 * _PIECES or away_deg[rows].max() < _WAY_DEG / 3:
        return None
    crept_s, whole_s = np.abs(t_s[rows[[0, -1]]] - t_s[turn])
    if crept_s > _WAITS * whole_s:
        return None
    edges = np.linspace(_CREEPS_DEG, away_deg[rows].max(), _PIECES + 1)
    piece = np.clip(np.searchsorted(edges, away_deg[rows], side="right") - 1, 0, _PIECES - 1)
    count = np.bincount(piece, minlength=_PIECES)
    if not count.all():
        return None
    means = [np.bincount(piece, weights, _PIECES) / count for weights in (t_s[rows] - t_s[turn], current_a[rows])]
    return np.column_stack([means[0], np.full(_PIECES, float(step)), means[1]])

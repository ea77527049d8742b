"""Condition of the robot during a run: disturbances, joint temperatures, and friction.

The test takes place between the first and the last motion of the robot. A stop or pause may also have ended it. Stops
therefore count from the first motion until the program ended by itself, or until the end of the run if the program
state is unknown. Opening the gate after the program is harmless. A value of nan means not reported, and is ignored.

Friction is determined from the jump of the motor current at a joint reversal. All other loads of a motor are continuous
there: gravity, inertia, and viscous friction, which is zero. Only Coulomb friction changes sign. Its current is
therefore half of the jump, independent of masses, gears and motors. The law is valid for a creeping joint. Source:
Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30 (1994), 2.1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.robot.geometry.circle import peaks
from analysis.robot.kinematics.arm import Array, Mask
from rigs.schema.condition import (
    CURRENTS,
    FULL_PERCENT,
    MOTORS,
    PROGRAM,
    SAFETY,
    SPEED,
    STOPPED,
    TEMPERATURES,
    ProgramState,
    words_of,
)

_CREEPS_DEG = 0.05
"""Distance from the reversal within which a joint may stick, with any friction up to Coulomb's. Chosen: encoders
resolve a few thousandths of a degree.
"""
_WAY_DEG = 3.0
"""Largest distance from the reversal that is evaluated; the smallest is a third of it."""
_WAITS = 0.4
"""Largest share of the time spent creeping in a continuous reversal.

At constant acceleration the share is 0.13 for the largest distance and 0.22 for the smallest. A joint that waits at the
reversal brakes and restarts, which adds jumps of the torque.
"""
_PIECES = 12
"""Number of current averages on each side, over equal distances. Averaging removes ripple."""
_ORDER = 3
"""Order of the polynomial in time that models all loads except friction."""


@dataclass(frozen=True)
class Friction:
    """Friction current of a joint's motor in A, its standard uncertainty, and the number of evaluated reversals."""

    current_a: float
    u_a: float
    turns: int


def friction_of(robot: Mapping[str, np.ndarray[Any, Any]], t_s: Array) -> dict[int, Friction]:
    """Friction by axis 1 … 6. The uncertainty is the larger of that of the fit and the scatter between reversals."""
    friction = {}
    for axis, name in enumerate(CURRENTS, 1):
        current, q_deg = robot.get(name, np.full(len(t_s), np.nan)), robot[f"q{axis}_deg"]
        shown = np.isfinite(current) & np.isfinite(q_deg)
        if not shown.any() or np.ptp(current[shown]) == 0:
            continue
        if turns := _turns(t_s[shown], q_deg[shown], current[shown]):
            values, u = np.array(turns).T
            n = len(values)
            within = float(np.sqrt((u**2).sum()) / n)
            between = 0.0 if n == 1 else float(values.std(ddof=1) / np.sqrt(n))
            friction[axis] = Friction(float(values.mean()), max(within, between), n)
    return friction


def _turns(t_s: Array, q_deg: Array, current_a: Array) -> list[tuple[float, float]]:
    """Half the current jump at each reversal, which is the friction, and the standard uncertainty, in A."""
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
    """Time from the reversal, side and mean current (pieces, 3) of the motion to or from it; None if too short."""
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


_MOVED_DEG = 0.02
"""Smallest joint motion of a moving robot, as in recording_rule."""
_BY_PROGRAM = "the results differ from those of programmed motion; compare them only with similar runs"
_SAME_PERCENT = 1.0
"""Largest difference of speeds that is ignored. Controllers report integer percentages."""
_PART = 0.1
"""Fraction of the run averaged for the temperatures at the start and end."""


@dataclass(frozen=True)
class Warmth:
    """Mean and rise of a joint's temperature in °C, with standard uncertainties from the scatter."""

    mean_c: float
    u_mean_c: float
    rise_c: float
    u_rise_c: float


@dataclass(frozen=True)
class Condition:
    """Condition of the robot in a run; warmth and friction by axis 1 … 6, if available."""

    doubts: tuple[str, ...] = ()
    warmth: Mapping[int, Warmth] | None = None
    friction: Mapping[int, Friction] | None = None


NOT_SHOWN = Condition()


def condition_of(robot: Mapping[str, np.ndarray[Any, Any]]) -> Condition:
    stamps_ns = robot["last_byte_ns"]
    q_deg = np.stack([robot[f"q{axis}_deg"] for axis in range(1, 7)], axis=1)
    whole = np.isfinite(q_deg).all(axis=1)
    if len(stamps_ns) < 2 or not whole.any():
        return NOT_SHOWN
    t_s = (stamps_ns - stamps_ns[0]) / 1e9
    q_deg[~whole] = np.nan  # neither here nor there
    away, to_come = (np.abs(q_deg - place).max(axis=1) > _MOVED_DEG for place in q_deg[whole][[0, -1]])
    begun = np.maximum.accumulate(away)
    moving = begun & np.maximum.accumulate(to_come[::-1])[::-1]  # between first and last motion
    warmth = {}
    for axis, name in enumerate(TEMPERATURES, 1):
        shown = robot.get(name, np.empty(0))
        shown = shown[np.isfinite(shown)]
        if len(shown):
            part = max(1, round(_PART * len(shown)))
            first, last = shown[:part], shown[-part:]
            rise_c, u_rise_c = float(last.mean() - first.mean()), math.hypot(first.std(), last.std())
            warmth[axis] = Warmth(float(shown.mean()), float(shown.std()), rise_c, u_rise_c)
    return Condition(tuple(_doubts(robot, t_s, moving, begun)), warmth, friction_of(robot, t_s))


def _doubts(robot: Mapping[str, np.ndarray[Any, Any]], t_s: Array, moving: Mask, begun: Mask) -> Iterator[str]:
    unknown = np.full(len(t_s), math.nan)
    safety, program, motors, speed = (robot.get(name, unknown) for name in (SAFETY, PROGRAM, MOTORS, SPEED))
    # The program was not stopped if it ended by itself after the last motion.
    by_itself = (program == ProgramState.STOPPED) & ~np.isin(safety, list(STOPPED))
    counts = begun & ~np.maximum.accumulate(begun & ~moving & by_itself)
    for state in sorted(STOPPED):
        if when := _when(t_s, counts & (safety == state)):
            yield f"robot: {words_of(state)} {when}; find the cause, and repeat the recording"
    paused = counts & (program == ProgramState.PAUSED)
    if (paused & moving).any():
        yield f"robot: the program was paused {_when(t_s, paused)}; the lap was interrupted: repeat the recording"
    elif paused.any():
        yield f"robot: the program was paused {_when(t_s, paused)}, after the last motion; check that it had driven all"
    if when := _when(t_s, moving & (program == ProgramState.STOPPED)):
        if (program[moving] == ProgramState.RUNNING).any():
            yield f"robot: the program did not run {when}, while the robot moved; record a motion of the program"
        else:
            yield f"robot: moved without a program, {when}: jogged, or guided by hand; {_BY_PROGRAM}"
    if when := _when(t_s, moving & (motors == 0)):
        yield f"robot: the motors were off {when}; find the cause, and repeat the recording"
    driving = moving & ~np.isin(program, [ProgramState.PAUSED, ProgramState.STOPPED])
    slowed = driving & (speed < FULL_PERCENT)
    if slowed.any():
        # A constant reduced speed is intended. A changing speed is a disturbance.
        low, high = speed[slowed].min(), speed[slowed].max()
        if np.nanmax(speed[driving]) - low < _SAME_PERCENT:
            yield f"robot: the speed was {low:.0f} % throughout; compare only with runs at this speed"
        else:
            shown = f"{low:.0f} %" if high - low < _SAME_PERCENT else f"{low:.0f} to {high:.0f} %"
            changed = f"{shown} {_when(t_s, slowed)}, and not constant"
            yield f"robot: the speed was {changed}; repeat the recording at a constant speed"


def _when(t_s: Array, lasts: Mask) -> str:
    edges = np.diff(lasts.astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if not len(begins):
        return ""
    until_s = np.append(t_s, t_s[-1])
    lasted_s = float((until_s[ends] - t_s[begins]).sum())
    if len(begins) == 1:
        return f"from {t_s[begins[0]]:.1f} s on for {lasted_s:.1f} s"
    return f"{len(begins)} times, first from {t_s[begins[0]]:.1f} s on, {lasted_s:.1f} s in total"

"""Joint angles beside the limits of the rig file, and rows that state a joint whole turns further than the others.

A posture is the same whether a joint stands at -106° or at 254°. Two things may be behind it. The controller or an
export restarts its count of turns: the joint did not turn. Or the joint really turned once more, which only an error
that does not repeat with the turn could show. A joint that really turns further stands at angles all over its range;
a joint whose count restarted stands in one window, and a whole number of turns away from it. So rows are turned back
if they leave the limits of the joint, or if all angles of the table, modulo a turn, leave a gap that so many angles
all over a turn would hardly leave. A joint is kept if the rig file has an error of it that does not repeat with the
turn.
"""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers, Mask, arm_of
from analysis.runs.tables import PoseTable, Table, TouchTable, counted_back
from rigs.rig import Rig
from rigs.text import listed

_TURN = 2 * np.pi
_SLACK_RAD = float(np.radians(0.1))
"""Tolerance of a reading beyond the limit: noise, and the rounding of limits in data sheets."""
_BY_CHANCE = 1e-3
"""Probability below which a gap in the angles of a joint, modulo a turn, is no accident: n angles all over a turn leave
a share g of it free with a probability of at most n (1 - g)^(n - 1)."""


def without_whole_turns(table: Table, rig: Rig) -> tuple[Table, tuple[str, ...]]:
    """Return poses or touches with each joint counted in the same turn, and a message for each joint that was not."""
    if not isinstance(table, PoseTable | TouchTable):
        return table, ()
    limits, turned, doubts = arm_of(rig.robot).limits, np.zeros(table.q.shape), list[str]()
    for axis in range(1, min(len(limits), table.q.shape[1]) + 1):
        angle = table.q[:, axis - 1]
        turns = turns_further(angle, limits[axis - 1])
        if turns.any() and not _has_fractional_wave(rig, axis):
            turned[:, axis - 1] = _TURN * turns
            doubts += [_counted_further(table, axis, turns, k) for k in np.unique(turns[turns != 0]).tolist()]
    return counted_back(table, turned) if doubts else table, tuple(doubts)


def turns_further(angle: Array, limits: Array) -> Integers:
    """Return the number of turns by which each angle (n,) rad of a joint was counted further than the others, or
    than the limits (2,) rad allow; zero if the joint really turned."""
    places = np.sort(angle % _TURN)
    gaps = np.diff(places, append=places[:1] + _TURN)
    widest = int(np.argmax(gaps))
    if len(angle) * (1 - gaps[widest] / _TURN) ** (len(angle) - 1) > _BY_CHANCE:
        return _turns_beyond(angle, limits)
    turn = np.floor((angle - places[widest] - gaps[widest] / 2) / _TURN).astype(np.int64)

    def worse(usual: int) -> tuple[bool, int, int]:
        outside = bool(_turns_beyond(angle - _TURN * (turn - usual), limits).any())
        return outside, -int(np.count_nonzero(turn == usual)), abs(usual)

    turns: Integers = turn - min(range(int(turn.min()) - 1, int(turn.max()) + 2), key=worse)
    return turns


def _turns_beyond(angle: Array, limits: Array) -> Integers:
    """Return the number of turns by which angles (n,) rad must be counted back to lie within limits (2,) rad; zero
    if they do, or if no turn brings them there."""
    low, high = limits[0] - _SLACK_RAD, limits[1] + _SLACK_RAD
    above, below = np.ceil((angle - high) / _TURN), np.floor((angle - low) / _TURN)
    turns = np.where(angle > high, above, np.where(angle < low, below, 0.0))
    back = angle - _TURN * turns
    return np.where((back >= low) & (back <= high), turns, 0.0).astype(np.int64)


def beyond_limits(table: Table, rig: Rig) -> tuple[str, ...]:
    """Return a message for each joint that a table has outside the limits of the rig file."""
    limits, doubts = arm_of(rig.robot).limits, []
    for axis, ((low, high), angle) in enumerate(zip(limits, table.q.T, strict=False), start=1):
        outside = (angle < low - _SLACK_RAD) | (angle > high + _SLACK_RAD)
        if outside.any():
            farthest = np.degrees(angle[np.argmax(np.abs(angle - (low + high) / 2))])
            doubts.append(
                f"axis {axis} is outside the limits of {np.degrees(low):.6g}° to {np.degrees(high):.6g}°: it stands at "
                f"{farthest:.1f}° {_row_words(table, outside)}; check the column, the zero, and limits_deg of the rig "
                "file"
            )
    return tuple(doubts)


def _has_fractional_wave(rig: Rig, axis: int) -> bool:
    """Return whether the rig file contains an error of an axis that does not repeat with the turn."""
    effects = (*rig.effects, *(rig.calibrated.effects if rig.calibrated else ()))
    return any(getattr(effect, "axis", None) == axis and not effect.repeats_each_turn for effect in effects)


def _counted_further(table: Table, axis: int, turns: Integers, count: int) -> str:
    """Return the message about rows in which a joint is counted this number of turns further."""
    rows = turns == count
    way = f"{abs(count)} whole turn{'s' * (abs(count) > 1)} {'further' if count > 0 else 'back'}"
    low, high = np.degrees([table.q[rows, axis - 1].min(), table.q[rows, axis - 1].max()])
    return (
        f"axis {axis} is counted {way} {_row_words(table, rows)} ({low:.1f}° to {high:.1f}°): the postures are the "
        "same and are taken within one turn; check how the angle was exported"
    )


def _row_words(table: Table, chosen: Mask) -> str:
    """Return the rows of the file selected by a mask (n,), in words."""
    rows = np.sort(table.rows[chosen]).tolist()
    if len(rows) == 1:
        return f"in row {rows[0]}"
    if len(rows) == rows[-1] - rows[0] + 1:
        return f"in rows {rows[0]} to {rows[-1]}"
    return f"in rows {listed(rows)}"

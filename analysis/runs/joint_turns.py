"""Comparison of joint angles with the limits of the rig file, and correction of wrong turn counts.

A posture is the same at a joint angle of -106° and of 254°. Either the controller or an export restarted the count of
turns, or the joint really made an additional turn, which only an error with a fractional number of waves per turn could
show. The distribution of the angles distinguishes these causes. A joint that really turns has angles over the complete
range. A joint with a restarted count has angles in one window, and others exactly whole turns away. Rows are therefore
counted back in two cases: if they are outside the limits of the joint, or if the angles of the table span a turn or
more and, modulo a turn, leave a gap that is unlikely by chance. Angles within less than a turn are unambiguous: a joint
that stood at -136° and at 138° did not stand at 224°, and a wrong scale would show the difference. A joint is not
changed if the rig file contains an error of that joint with a fractional number of waves per turn.
"""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers, Mask, arm_of
from analysis.runs.tables import PlaceTable, Table
from rigs.rig import Rig
from rigs.text import counted, listed

_TURN = 2 * np.pi
_SLACK_RAD = float(np.radians(0.1))
"""Tolerance of readings beyond a limit: noise, and rounding of limits in data sheets."""
_BY_CHANCE = 1e-3
"""Largest probability of a gap by chance. If n angles are spread over a turn, the probability that a share g of the
turn is empty is at most n (1 - g)^(n - 1).
"""


def without_whole_turns(table: Table, rig: Rig) -> tuple[Table, tuple[str, ...]]:
    """Count each joint of poses or touches in the same turn; also returns messages about the corrected joints."""
    if not isinstance(table, PlaceTable):
        return table, ()
    limits, turned, facts = arm_of(rig.robot).limits, np.zeros(table.q.shape), list[str]()
    for axis in range(1, min(len(limits), table.q.shape[1]) + 1):
        angle = table.q[:, axis - 1]
        turns = turns_further(angle, limits[axis - 1])
        if turns.any() and not _has_fractional_wave(rig, axis):
            turned[:, axis - 1] = _TURN * turns
            facts += [_counted_further(table, axis, turns, k) for k in np.unique(turns[turns != 0]).tolist()]
    if not facts:
        return table, ()
    reduced = "the postures are equal, and the angles are reduced to a single turn; check the export of the angles"
    return table.counted_back(turned), (f"{', '.join(facts)}: {reduced}",)


def turns_further(angle: Array, limits: Array) -> Integers:
    """Excess turns (n,) of joint angles relative to the others, or to the limits (2,) rad; zero if the joint really
    turned.
    """
    if np.ptp(angle) < _TURN:
        return _turns_beyond(angle, limits)
    places = np.sort(angle % _TURN)
    gaps = np.diff(places, append=places[:1] + _TURN)
    widest = int(np.argmax(gaps))
    if len(angle) * (1 - gaps[widest] / _TURN) ** (len(angle) - 1) > _BY_CHANCE:
        return _with_neighbours(angle, _turns_beyond(angle, limits))
    turn = np.floor((angle - places[widest] - gaps[widest] / 2) / _TURN).astype(np.int64)

    def worse(usual: int) -> tuple[bool, int, int]:
        outside = bool(_turns_beyond(angle - _TURN * (turn - usual), limits).any())
        return outside, -int(np.count_nonzero(turn == usual)), abs(usual)

    turns: Integers = turn - min(range(int(turn.min()) - 1, int(turn.max()) + 2), key=worse)
    return turns


def _with_neighbours(angle: Array, turns: Integers) -> Integers:
    """Excess turns, also of the few angles within the limits but outside the turn of most angles, such as one at -354°
    and six below -360°.
    """
    counted = angle - _TURN * turns
    ordered = np.sort(counted)
    inside = np.searchsorted(ordered, ordered + _TURN) - np.arange(len(ordered))
    begin = ordered[np.argmax(inside)]
    further: Integers = np.floor((counted - begin) / _TURN).astype(np.int64)
    return turns + further if np.count_nonzero(further) < np.count_nonzero(turns) else turns


def _turns_beyond(angle: Array, limits: Array) -> Integers:
    """Turns (n,) to subtract to bring angles within limits (2,) rad; zero if no number of turns does."""
    low, high = limits[0] - _SLACK_RAD, limits[1] + _SLACK_RAD
    above, below = np.ceil((angle - high) / _TURN), np.floor((angle - low) / _TURN)
    turns = np.where(angle > high, above, np.where(angle < low, below, 0.0))
    back = angle - _TURN * turns
    return np.where((back >= low) & (back <= high), turns, 0.0).astype(np.int64)


def beyond_limits(table: Table, rig: Rig) -> tuple[str, ...]:
    limits, doubts = arm_of(rig.robot).limits, []
    for axis, ((low, high), angle) in enumerate(zip(limits, table.q.T, strict=False), start=1):
        outside = (angle < low - _SLACK_RAD) | (angle > high + _SLACK_RAD)
        if outside.any():
            farthest = np.degrees(angle[np.argmax(np.abs(angle - (low + high) / 2))])
            doubts.append(
                f"axis {axis} is outside the limits of {np.degrees(low):z.6g}° to {np.degrees(high):z.6g}°: it is at "
                f"{farthest:z.1f}° {_row_words(table, outside)}; check the column, the zero, and limits_deg of the rig "
                "file"
            )
    return tuple(doubts)


def _has_fractional_wave(rig: Rig, axis: int) -> bool:
    effects = (*rig.effects, *(rig.calibrated.effects if rig.calibrated else ()))
    return any(getattr(effect, "axis", None) == axis and not effect.repeats_each_turn for effect in effects)


def _counted_further(table: Table, axis: int, turns: Integers, count: int) -> str:
    rows = turns == count
    turns_off = f"{counted(abs(count), 'whole turn')} {'higher' if count > 0 else 'lower'}"
    angles = np.degrees(table.q[rows, axis - 1])
    ends = " to ".join(dict.fromkeys(f"{angle:z.1f}°" for angle in (angles.min(), angles.max())))
    return f"axis {axis} is {turns_off} {_row_words(table, rows)} ({ends})"


def _row_words(table: Table, chosen: Mask) -> str:
    rows = np.sort(table.rows[chosen]).tolist()
    if len(rows) == 1:
        return f"in row {rows[0]}"
    if len(rows) == rows[-1] - rows[0] + 1:
        return f"in rows {rows[0]} to {rows[-1]}"
    return f"in rows {listed(rows)}"

"""Set-ups made like those of an operator: the ball is mounted where the real tool path is centred, including the arm's
errors.

An error that only displaces the complete circle then does not change the readings, exactly and not only to first order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.worlds.stranger.cell import Cell
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.joints import Trace
from tests.worlds.stranger.measure import by_ball, read, tool_of
from tests.worlds.stranger.motion import Motion
from tests.worlds.stranger.screws import Array

_NEAR_MM = 1e-4
_ROUNDS = 8
LEAST_SHARE = 0.05
"""Ball directions with less than this share of the largest effect are not fitted."""


@dataclass(frozen=True)
class Watch:
    """A motion in a set-up without faults: tool positions place (n, 3) mm, readings plain (m, k) mm; by_ball (m, k,
    3).
    """

    motion: Motion
    trace: Trace
    place: Array
    plain: Array
    by_ball: Array


def watched(cell: Cell, motion: Motion, trace: Trace, link: Link) -> Watch:
    """A motion with this set-up and no faults."""
    tool = tool_of(cell, motion, [], trace)
    return Watch(motion, trace, tool[1], read(motion, [], link, tool), by_ball(motion, link, tool))


def by_setup(watches: Sequence[Watch]) -> Array:
    """Derivatives (D, 3 + k) of the readings of all motions, concatenated, by the ball and the zeros."""
    ball = np.concatenate([watch.by_ball.reshape(-1, 3) for watch in watches])
    gauges = watches[0].plain.shape[1]
    return np.concatenate([ball, np.tile(np.eye(gauges), (len(ball) // gauges, 1))], axis=1)


def centred(cell: Cell, watches: Sequence[Watch], link: Link, faults: Sequence[Fault]) -> Link:
    """Link with its ball moved so that its eccentricity with a faulty arm equals that with a perfect arm.

    The centre of a circle follows the mean tool position. The remaining displacement, and that of a hemisphere, is
    fitted. A ball displacement along the normal of a circle is hardly visible and not fitted.
    """
    A = by_setup(watches)
    tools = [tool_of(cell, watch.motion, faults, watch.trace) for watch in watches]
    if watches[0].motion.test != "radial":
        moves = [np.mean(tool[1] - watch.place, axis=0) for watch, tool in zip(watches, tools, strict=True)]
        link = replace(link, ball=link.ball + np.mean(moves, axis=0))
    for _ in range(_ROUNDS):
        added = [read(w.motion, faults, link, tool) - w.plain for w, tool in zip(watches, tools, strict=True)]
        step = np.linalg.lstsq(A, np.concatenate([x.ravel() for x in added]), rcond=LEAST_SHARE)[0][:3]
        link = replace(link, ball=link.ball - step)
        if np.abs(step).max() < _NEAR_MM:
            break
    return link

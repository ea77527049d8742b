"""Set-ups as people make them: the ball stands where the tool really goes round it, whatever the arm's errors.

An error that only moves the whole circle is then no error of the readings, to all orders and not just the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.worlds.stranger.cell import Cell
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.joints import Trace
from tests.worlds.stranger.measure import read, tool_of
from tests.worlds.stranger.motion import Motion
from tests.worlds.stranger.screws import Array

_STEP_MM = 1e-4
_NEAR_MM = 1e-4
_ROUNDS = 8
HARDLY = 0.05
"""A move of the ball that shows less than this share of what shows most is not fitted."""


@dataclass(frozen=True)
class Watch:
    """A motion of a set-up. Without faults: place (n, 3) mm of the tool, plain (m, k) mm; by_ball (m, k, 3)."""

    motion: Motion
    trace: Trace
    place: Array
    plain: Array
    by_ball: Array


def watched(cell: Cell, motion: Motion, trace: Trace, link: Link) -> Watch:
    """A motion with this set-up, no faults."""
    tool = tool_of(cell, motion, [], trace)
    plain = read(motion, [], link, tool)
    shifted = [read(motion, [], replace(link, ball=link.ball + step), tool) for step in _STEP_MM * np.eye(3)]
    return Watch(motion, trace, tool[1], plain, np.stack([(g - plain) / _STEP_MM for g in shifted], axis=2))


def by_setup(watches: Sequence[Watch]) -> Array:
    """(D, 3 + k): how the readings of all motions, one after the other, go with the ball and the zeros."""
    ball = np.concatenate([watch.by_ball.reshape(-1, 3) for watch in watches])
    gauges = watches[0].plain.shape[1]
    return np.concatenate([ball, np.tile(np.eye(gauges), (len(ball) // gauges, 1))], axis=1)


def centred(cell: Cell, watches: Sequence[Watch], link: Link, faults: Sequence[Fault]) -> Link:
    """The link with its ball moved to where an arm with faults has it as eccentric as the link is without.

    A circle's centre goes with the mean of the tool's places; what is left, and all of a hemisphere's, is fitted. A
    ball that moves along a circle's normal hardly shows, and is left there.
    """
    A = by_setup(watches)
    tools = [tool_of(cell, watch.motion, faults, watch.trace) for watch in watches]
    if watches[0].motion.test != "radial":
        moves = [np.mean(tool[1] - watch.place, axis=0) for watch, tool in zip(watches, tools, strict=True)]
        link = replace(link, ball=link.ball + np.mean(moves, axis=0))
    for _ in range(_ROUNDS):
        added = [read(w.motion, faults, link, tool) - w.plain for w, tool in zip(watches, tools, strict=True)]
        step = np.linalg.lstsq(A, np.concatenate([x.ravel() for x in added]), rcond=HARDLY)[0][:3]
        link = replace(link, ball=link.ball - step)
        if np.abs(step).max() < _NEAR_MM:
            break
    return link

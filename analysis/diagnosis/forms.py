"""How nature departs from the page: what stands beside a named effect because no gear, ball or brake is ideal.

These are not named; they are allowed for, in proportion to the effect, when it is fitted and when what is left is
judged. What departs, the effects say themselves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.linear import Linear
from analysis.diagnosis.observed import ORDER_OF
from analysis.kinematics.arm import Array
from rigs.effects import Effect, turned

_JOLT = 0.4
_MOST_DEG = 5.0
"""By which a joint is turned to see what it does; a play is never so wide."""


def form_columns(linear: Linear, effect: Effect) -> Array:
    """What departures of an effect may add, one standard deviation each: (N, f) in standard deviations."""
    own = effect.departures()
    parts = [linear.columns(own.beside), begin_columns(linear, [effect])]
    parts += [_jolts(linear, *own.jolt)] if own.jolt else []
    parts += [_sticks(linear, *own.stick)] if own.stick else []
    return np.concatenate(parts, axis=1)


def begin_columns(linear: Linear, effects: Sequence[Effect]) -> Array:
    """Where in their play the joints of effects stood before each run began, (N, b) one standard deviation each."""
    begins = [one.begin for one in (effect.departures() for effect in effects) if one.begin]
    return np.concatenate([np.empty((len(linear.y), 0)), *(_begins(linear, *begin) for begin in begins)], axis=1)


def _begins(linear: Linear, axis: int, off_deg: float) -> Array:
    """Where in its play a joint stood before each run began nobody knows: (N, b), a column a circle."""
    raw = linear.columns([turned(axis, min(off_deg, _MOST_DEG))])[:, 0]
    columns, begin = [], 0
    for block in linear.blocks:
        if block.sampling and block.sampling.stands:
            first = slice(begin + len(ORDER_OF), begin + len(ORDER_OF) + 2)
            column = np.zeros(len(raw))
            column[first] = raw[first]
            columns.append(column)
        begin += len(block.y_mm)
    return np.stack(columns, axis=1) if columns else np.empty((len(raw), 0))


def _jolts(linear: Linear, axis: int, size_deg: float) -> Array:
    """When a joint turned back is known to a sample or so, and differs by that between repeats: (N, j), columns for the
    samples about each of its turns, where a spike may begin sooner or later, or a play be crossed in its own way."""
    columns = []
    for k, block in enumerate(linear.blocks):
        if not block.sampling:
            continue
        path = block.one.path
        for when, _ in path.motion.reversals(axis):
            after = int(np.searchsorted(path.t_s, when))
            columns += [
                linear.jolt(k, axis, sample, min(_JOLT * size_deg, 1.0))
                for sample in (after - 1, after)
                if 0 <= sample < len(path.t_s)
            ]
    return np.stack(columns, axis=1) if columns else np.empty((len(linear.y), 0))


def _sticks(linear: Linear, gauge: str, off_mm: float) -> Array:
    """How a plunger that sticks came to a target nobody recorded: (N, t), a column for each target."""
    columns, begin = [], 0
    for block in linear.blocks:
        if not block.sampling and gauge == "g1":
            for row in range(len(block.y_mm)):
                column = np.zeros(len(linear.y))
                column[begin + row] = off_mm / block.sd_mm[row]
                columns.append(column)
        begin += len(block.y_mm)
    return np.stack(columns, axis=1) if columns else np.empty((len(linear.y), 0))

"""Departures: the deviations of a real gear, ball or brake from the ideal form of a named effect.

They are never named. They are allowed for, in proportion to the effect, when it is fitted and when the residual is
judged. The effects themselves define their departures.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.linearisation import Linearisation
from analysis.diagnosis.observed_run import ORDER_OF
from analysis.kinematics.arm import Array
from rigs.effects import Effect, turned

_REVERSAL_SHIFT = 0.4
"""Standard deviation of the error at a sample next to a reversal, as a share of the effect's size. Chosen: the instant
of a reversal is known to about one sample, so any part of the jump may fall on either side."""
_LARGEST_TURN_DEG = 5.0
"""Largest angle by which a joint is turned to compute a response. Chosen: wider than any play."""


def departure_columns(linear: Linearisation, effect: Effect) -> Array:
    """Return what the departures of an effect may add, one standard deviation each: columns (N, f) in standard
    deviations of the noise."""
    own = effect.departures()
    parts = [linear.columns(own.beside), initial_play_columns(linear, [effect])]
    parts += [_reversal_shifts(linear, *own.jolt)] if own.jolt else []
    parts += [_stick_columns(linear, *own.stick)] if own.stick else []
    return np.concatenate(parts, axis=1)


def initial_play_columns(linear: Linearisation, effects: Sequence[Effect]) -> Array:
    """Return columns (N, b), one standard deviation each, for the unknown position in their play of the effects' joints
    before each run began."""
    begins = [one.begin for one in (effect.departures() for effect in effects) if one.begin]
    return np.concatenate([np.empty((len(linear.y), 0)), *(_initial_play(linear, *begin) for begin in begins)], axis=1)


def _initial_play(linear: Linearisation, axis: int, off_deg: float) -> Array:
    """Return columns (N, b), one for each circle, for the unknown position of a joint in its play before the
    run began."""
    raw = linear.columns([turned(axis, min(off_deg, _LARGEST_TURN_DEG))])[:, 0]
    columns, begin = [], 0
    for block in linear.blocks:
        if block.sampling and block.sampling.stands:
            first = slice(begin + len(ORDER_OF), begin + len(ORDER_OF) + 2)
            column = np.zeros(len(raw))
            column[first] = raw[first]
            columns.append(column)
        begin += len(block.y_mm)
    return np.stack(columns, axis=1) if columns else np.empty((len(raw), 0))


def _reversal_shifts(linear: Linearisation, axis: int, size_deg: float) -> Array:
    """Return columns (N, j) for the samples about each reversal of a joint. The instant of a reversal is known to about
    one sample and differs by that between repeats, so a spike may begin earlier or later, and a play may be crossed
    differently."""
    columns = []
    for k, block in enumerate(linear.blocks):
        if not block.sampling:
            continue
        path = block.one.path
        for when, _ in path.motion.reversals(axis):
            after = int(np.searchsorted(path.t_s, when))
            columns += [
                linear.jolt(k, axis, sample, min(_REVERSAL_SHIFT * size_deg, 1.0))
                for sample in (after - 1, after)
                if 0 <= sample < len(path.t_s)
            ]
    return np.stack(columns, axis=1) if columns else np.empty((len(linear.y), 0))


def _stick_columns(linear: Linearisation, gauge: str, off_mm: float) -> Array:
    """Return columns (N, t), one for each target, for the unknown state in which a sticking plunger reached
    the target.
    """
    columns, begin = [], 0
    for block in linear.blocks:
        if not block.sampling and gauge == "g1":
            for row in range(len(block.y_mm)):
                column = np.zeros(len(linear.y))
                column[begin + row] = off_mm / block.sd_mm[row]
                columns.append(column)
        begin += len(block.y_mm)
    return np.stack(columns, axis=1) if columns else np.empty((len(linear.y), 0))

"""Departures: the deviations of a real gear, ball or brake from the ideal form of a named effect.

They are never named. They are allowed for, in proportion to the effect, when it is fitted and when the residual is
judged. The effects themselves define their departures.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.linearisation import Linearisation
from analysis.kinematics.arm import Array
from rigs.effects import Effect
from rigs.schema.play import play

_REVERSAL_SHIFT = 0.4
"""Standard deviation of the error at a sample next to a reversal, as a share of the effect's size, and of the instant
of the reversal, as a share of the time between samples. Chosen: the instant is known to about one sample, so any part
of the jump may fall on either side."""
_LEAST = 1e-3
"""Largest entry, in standard deviations of the noise, below which a column is left out: it changes nothing."""
_NEGLIGIBLE = 0.01
"""Largest standard deviation along one direction, in those of the noise, that `fewest_columns` leaves out. Chosen: a
ten-thousandth of the variance of the noise."""
_PARTS = 16
"""Parts of a fault's play in each of which a run may have begun. Chosen: finer than the rounding of a play."""


def departure_columns(linear: Linearisation, effect: Effect) -> Array:
    """Return what the departures of an effect may add, one standard deviation each: columns (N, f) in standard
    deviations of the noise."""
    own = effect.departures()
    parts = [_shares(linear, own.beside)]
    parts += [_initial_play(linear, *own.gap, _PARTS)] if own.gap else []
    parts += [_reversal_shifts(linear, *own.jolt)] if own.jolt else []
    parts += [_stick_columns(linear, *own.stick)] if own.stick else []
    parts += [_fading_columns(linear, effect)] if own.fades else []
    parts += [_late_columns(linear, effect)] if effect.STAGE == "joint" else []
    return np.concatenate(parts, axis=1)


def alike_columns(linear: Linearisation, effect: Effect) -> Array:
    """Return what combinations of effects that resemble an effect may add, one standard deviation each: columns (N, f)
    in standard deviations of the noise."""
    parts = [_shares(linear, combined).sum(axis=1) for combined in effect.departures().alike]
    return np.stack(parts, axis=1) if parts else np.empty((len(linear.y), 0))


def _shares(linear: Linearisation, effects: Sequence[tuple[float, Effect]]) -> Array:
    return linear.columns([effect for _, effect in effects]) * [share for share, _ in effects]


def fewest_columns(columns: Array) -> Array:
    """Return the fewest columns (N, g) that allow for the same as columns (N, f): both have the same covariance, except
    along directions that hardly vary. A play has a column for each part of it and each circle, and most are alike."""
    variances, directions = np.linalg.eigh(columns.T @ columns)
    fewest: Array = columns @ directions[:, variances > _NEGLIGIBLE**2]
    return fewest


def initial_play_columns(linear: Linearisation, effects: Sequence[Effect]) -> Array:
    """Return columns (N, b), one standard deviation each, for the unknown position in their play of the effects' joints
    before each run began."""
    gaps = [one.gap for one in (effect.departures() for effect in effects) if one.gap]
    return np.concatenate([np.empty((len(linear.y), 0)), *(_initial_play(linear, *gap, 1) for gap in gaps)], axis=1)


def _initial_play(linear: Linearisation, axis: int, half_deg: float, parts: int) -> Array:
    """Return columns (N, b) for the unknown position of a joint in its play when each circle began.

    It lasts until the joint has crossed the play, which may take much of a lap. The play of ± half_deg is divided into
    parts, each with a column for each circle; a position anywhere in the play is equally likely.
    """
    edges, half = np.linspace(-1, 1, parts + 1), np.radians(half_deg)

    def off(block: Block) -> Array:
        x = block.one.path.q[:, axis - 1]
        return np.diff([play(x, half, float(edge)) for edge in edges], axis=0).T * _usual_shares(edges)

    return _apart(linear, linear.by_joint(axis, off), sampling=True)


def _usual_shares(edges: Array) -> Array:
    """Return the root mean square (n,) of the share of each part of a play, between its edges (n + 1,), that lies
    between its middle and a position that may be anywhere between -1 and 1."""
    reached = np.clip(np.linspace(-1, 1, 201)[:, None], edges[:-1], edges[1:]) - np.clip(0.0, edges[:-1], edges[1:])
    shares: Array = np.sqrt(np.mean((reached / np.diff(edges)) ** 2, axis=0))
    return shares


def _reversal_shifts(linear: Linearisation, axis: int, size_deg: float, fades_s: float) -> Array:
    """Return columns (N, j) for the samples about each reversal of a joint. The instant of a reversal is known to about
    one sample and differs by that between repeats, so a spike may begin earlier or later, and a play may be crossed
    differently. One that fades is smaller or larger from then on."""
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
    jolts = np.stack(columns, axis=1) if columns else np.empty((len(linear.y), 0))
    return np.concatenate([jolts, _faded(linear, axis, size_deg, fades_s)], axis=1) if fades_s else jolts


def _faded(linear: Linearisation, axis: int, size_deg: float, fades_s: float) -> Array:
    """Return a column (N,) for each reversal of a joint in each circle, as (N, j): how much more is left of an effect
    that fades in fades_s (s) if it began later."""
    columns = [np.empty((len(linear.y), 0))]
    for one, rows in zip(linear.simulated, linear.rows, strict=True):
        if not one.block.sampling:
            continue
        path = one.block.one.path
        turns = [when for when, _ in path.motion.reversals(axis)]
        if not turns:
            continue
        since = np.subtract.outer(path.t_s, turns)
        later_s = _REVERSAL_SHIFT * float(np.median(np.diff(path.t_s)))
        more_deg = size_deg * later_s / fades_s * np.exp(-np.maximum(since, 0.0) / fades_s)
        own = np.zeros((len(linear.y), since.shape[1]))
        own[rows] = one.by_joint(axis, np.radians(np.where(since >= 0, more_deg, 0.0)))
        columns.append(own)
    return np.concatenate(columns, axis=1)


def _stick_columns(linear: Linearisation, gauge: str, off_mm: float) -> Array:
    """Return columns (N, t), one for each target, for the unknown state in which a sticking plunger reached
    the target.
    """
    read = [not block.sampling and gauge == "g1" for block in linear.blocks]
    off = np.concatenate([one * off_mm / block.sd_mm for one, block in zip(read, linear.blocks, strict=True)])
    targets = np.flatnonzero(off)
    columns = np.zeros((len(off), len(targets)))
    columns[targets, np.arange(len(targets))] = off[targets]
    return columns


def _fading_columns(linear: Linearisation, effect: Effect) -> Array:
    """Return a column (N,) for each block of targets, as (N, t): what is left there of an effect that fades while the
    robot stands may be anything between nothing and twice as much."""
    return _apart(linear, linear.columns([effect]), sampling=False)


def _late_columns(linear: Linearisation, effect: Effect) -> Array:
    """Return columns (N, c), c ≤ 3, for an effect that comes as much later as the stamps of healthy clocks have it, and
    for how much smaller stamps that scatter make it.

    What late stamps do among the columns of a healthy arm is what they do without the effect. A play that was crossed
    2 ms later came out 1.2 % too narrow, with an uncertainty of 0.06 %. A wave of 5 Hz that is read at instants which
    scatter by 4 ms is 0.8 % smaller on average.
    """
    return _that_change(np.concatenate([linear.late(effect), linear.scattered(effect)], axis=1))


def _that_change(columns: Array) -> Array:
    """Return those of columns (N, c) that change a reading."""
    shown: Array = columns[:, np.abs(columns).max(axis=0) > _LEAST]
    return shown


def _apart(linear: Linearisation, whole: Array, *, sampling: bool) -> Array:
    """Return columns (N, c) once for each circle, or, without sampling, for each block of targets, as (N, f): zero
    elsewhere, and without those that change nothing."""
    columns = [np.empty((len(whole), 0))]
    for block, rows in zip(linear.blocks, linear.rows, strict=True):
        if bool(block.sampling) == sampling:
            own = np.zeros_like(whole)
            own[rows] = whole[rows]
            columns.append(_that_change(own))
    return np.concatenate(columns, axis=1)

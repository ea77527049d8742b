"""Departures: deviations of a real gear, ball or brake from the ideal form of a named effect.

They are never named, but included, in proportion to the effect, in the fit and in the judgement of the residual.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.fit.responses import Linearisation
from analysis.robot.kinematics.arm import Array
from rigs.schema.effect import Effect
from rigs.schema.scene import play

_REVERSAL_SHIFT = 0.4
"""Standard deviation of the error at a sample next to a reversal, relative to the effect's size, and of the reversal
time, relative to the sampling interval. Chosen: the time is known to about a sample.
"""
_LEAST = 1e-3
"""Columns with no entry above this value, in noise standard deviations, are omitted."""
_NEGLIGIBLE = 0.01
"""Standard deviation along a direction, relative to the noise, below which `fewest_columns` omits it. Chosen."""
_PARTS = 16
"""Parts of a fault's backlash with separate initial positions. Chosen: finer than the rounding of a crossing."""


def departure_columns(linear: Linearisation, effect: Effect) -> Array:
    """Columns (N, f) of the departures of an effect, each scaled to a standard deviation, in noise standard
    deviations.
    """
    departures = effect.departures()
    parts = [_shares(linear, departures.beside)]
    parts += [_initial_play(linear, *departures.gap, _PARTS)] if departures.gap else []
    parts += [_reversal_shifts(linear, *departures.jolt)] if departures.jolt else []
    if departures.stick:
        # A column per target, for the unknown state of a sticking plunger.
        gauge, off_mm = departures.stick
        read = [not block.sampling and gauge == "g1" for block in linear.blocks]
        blocks = zip(read, linear.blocks, strict=True)
        off = linear.at_entries([reads * off_mm / block.sd_mm for reads, block in blocks])
        targets = np.flatnonzero(off)
        parts.append(np.zeros((len(off), len(targets))))
        parts[-1][targets, np.arange(len(targets))] = off[targets]
    # The remainder of a decaying effect at a block of targets may be between zero and twice as much.
    parts += [_columns_by_block(linear, linear.columns([effect]), sampling=False)] if departures.fades else []
    # Healthy stamp delays are modelled separately from the effect. A backlash crossed 2 ms later was estimated 1.2 %
    # too narrow, with an uncertainty of 0.06 %. A wave of 5 Hz read at times with a scatter of 4 ms is 0.8 % smaller on
    # average.
    if effect.STAGE == "joint":
        parts.append(_that_change(linear.retimed(effect)))
    return np.concatenate(parts, axis=1)


def similar_columns(linear: Linearisation, effect: Effect) -> Array:
    """Columns (N, f) for combinations of effects that resemble a given effect."""
    parts = [_shares(linear, combined).sum(axis=1) for combined in effect.departures().alike]
    return np.stack(parts, axis=1) if parts else np.empty((len(linear.y), 0))


def _shares(linear: Linearisation, effects: Sequence[tuple[float, Effect]]) -> Array:
    return linear.columns([effect for _, effect in effects]) * [share for share, _ in effects]


def fewest_columns(columns: Array) -> Array:
    """The fewest columns (N, g) with the same covariance as columns (N, f). Most columns of a backlash are similar."""
    variances, directions = np.linalg.eigh(columns.T @ columns)
    return np.asarray(columns @ directions[:, variances > _NEGLIGIBLE**2], dtype=float)


def initial_play_columns(linear: Linearisation, effects: Sequence[Effect]) -> Array:
    """Columns (N, b) for the unknown initial position of joints in their backlash."""
    gaps = [departures.gap for departures in (effect.departures() for effect in effects) if departures.gap]
    return np.concatenate([np.empty((len(linear.y), 0)), *(_initial_play(linear, *gap, 1) for gap in gaps)], axis=1)


def _initial_play(linear: Linearisation, axis: int, half_width_deg: float, parts: int) -> Array:
    """Columns (N, b) for the unknown position of a joint within its backlash at the start of each circle.

    It affects the readings until the joint has crossed the backlash, which may take much of a lap. All positions within
    ± half_width_deg are equally likely. Each of the parts of the range has a column per circle.
    """
    edges, half_width_rad = np.linspace(-1, 1, parts + 1), np.radians(half_width_deg)
    # Rms of the share of each part between the middle and a random position.
    reached = np.clip(np.linspace(-1, 1, 201)[:, None], edges[:-1], edges[1:]) - np.clip(0.0, edges[:-1], edges[1:])
    usual = np.sqrt(np.mean((reached / np.diff(edges)) ** 2, axis=0))

    def edge_responses(block: Block) -> Array:
        x = block.drives.q[:, axis - 1]
        return np.asarray(
            np.diff([play(x, half_width_rad, float(edge)) for edge in edges], axis=0).T * usual, dtype=float
        )

    return _columns_by_block(linear, linear.by_joint(axis, edge_responses), sampling=True)


def _reversal_shifts(linear: Linearisation, axis: int, size_deg: float, fades_s: float) -> Array:
    """Columns (N, j) for the uncertain time of each reversal of a joint.

    A spike may start earlier or later, and backlash may be crossed differently. A spike that decays in fades_s is
    larger after a later start.
    """
    jolts, faded = [], [np.empty((len(linear.y), 0))]
    for k, (simulated, rows) in enumerate(zip(linear.simulated, linear.rows, strict=True)):
        path = simulated.block.path
        turns = [when for when, _ in simulated.block.drives.reversals(axis)] if simulated.block.sampling else []
        for when in turns:
            after = int(np.searchsorted(path.t_s, when))
            jolts += [
                linear.jolt(k, axis, sample, min(_REVERSAL_SHIFT * size_deg, 1.0))
                for sample in (after - 1, after)
                if 0 <= sample < len(path.t_s)
            ]
        if fades_s and turns:
            since = np.subtract.outer(path.t_s, turns)
            later_s = _REVERSAL_SHIFT * float(np.median(np.diff(path.t_s)))
            more_deg = size_deg * later_s / fades_s * np.exp(-np.maximum(since, 0.0) / fades_s)
            faded.append(np.zeros((len(linear.y), len(turns))))
            faded[-1][rows] = simulated.by_joint(axis, np.radians(np.where(since >= 0, more_deg, 0.0)))
    at_samples = np.stack(jolts, axis=1) if jolts else np.empty((len(linear.y), 0))
    return np.concatenate([at_samples, np.concatenate(faded, axis=1)], axis=1) if fades_s else at_samples


def _that_change(columns: Array) -> Array:
    return columns[:, np.abs(columns).max(axis=0) > _LEAST]


def _columns_by_block(linear: Linearisation, whole: Array, *, sampling: bool) -> Array:
    """Columns (N, f) that each describe a single circle, or a single block of targets, and are zero elsewhere."""
    columns = [np.empty((len(whole), 0))]
    for block, rows in zip(linear.blocks, linear.rows, strict=True):
        if bool(block.sampling) == sampling:
            apart = np.zeros_like(whole)
            apart[rows] = whole[rows]
            columns.append(_that_change(apart))
    return np.concatenate(columns, axis=1)

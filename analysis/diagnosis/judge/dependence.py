"""What the residual depends on, and scatter of repeated readings that is larger than usual.

Each dependence is an error of joints that is a smooth function of a quantity, fitted to a part of the readings and
evaluated on the others: noise gives about zero. Poses are held out by neighbourhoods of joint space; on circles every
fifth entry of the spectrum is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.evidence.observation import ORDER_OF
from analysis.diagnosis.fit.responses import Linearisation, noise_um
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.fit.unknown import torque_share
from analysis.diagnosis.judge.held_out import HeldOut
from analysis.diagnosis.judge.residuals import Dependence, HeldOutResidual, Residual, Subject
from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.noise.cell_noise import (
    REPEATABILITY_MM,
    RP_PER_SD,
    SLOW_MM,
    TARGET_MM,
    TIP_MM,
    TRACKER_U_MM,
    WHITE_MM,
)
from rigs.effects import play_of_joint
from rigs.schema.declared_tests import Touch

_UNIT_RAD, _UNIT_MM = np.radians(1e-3), 1e-3
"""Units of an error of a joint and of a place. They do not affect the result, because the strength is scaled."""
_STRENGTHS = 4.0 ** np.arange(-8, 7)
"""Squares of the strength of a dependence in these units, from a 256th of a unit to 64; the best is used."""
_ORDERS = np.arange(1, 9)
"""Waves per turn of an error over the joint angle. Chosen: the finest that a hundred poses show."""
_DEGREES = np.arange(1, 6)
"""Powers of the torque. Chosen: they approximate a cubic spring and a one-sided knee within a tenth."""
_HALF_WAVES = np.arange(1, 5)
"""Half waves over the duration of a run: warming, a shift of the instrument, a day's cycle."""
_FOLDS = 5
"""Number of parts of a circle's spectrum, each held out once."""
_NOTHING = 0.06
"""Share below which the residual depends on no quantity, and readings without repeats may be scatter: plain noise of 30
to 50 poses had at most 0.054.
"""
_Functions = Callable[[Block], Array]
"""Functions of a quantity (n, c) at the samples of a block's path."""

# ----------------------------------------------------------------------------------------------------------------------
# Dependence of the residual on a quantity.


def held_out_residual(
    result: SearchResult, held_out: HeldOut | None, temperature: Array | None
) -> HeldOutResidual | None:
    """Residual of held-out places with its dependences; None if too few places were held out. temperature (n,): in °C
    of the rows of a single table, None if unknown.
    """
    if held_out is None or not held_out.is_enough:
        return None
    linear = result.linear
    tables = [block.table for block in linear.blocks if block.facts.of_places]
    of_arm: dict[Subject, _Functions | None] = dict.fromkeys(("posture", "approach", "time", "temperature", "speed"))
    of_arm["posture"] = lambda block: np.concatenate([np.cos(block.path.q), np.sin(block.path.q)], axis=1)
    if any(table.sides is not None for table in tables):
        of_arm["approach"] = _sides
    if temperature is not None and len(set(map(id, tables))) == 1 and np.ptp(temperature) > 0:
        warmth = ((temperature - temperature.mean()) / np.ptp(temperature))[:, None]
        of_arm["temperature"] = lambda block: _at_samples(block, warmth)
    weight = np.sqrt(held_out.robust)
    off = weight * held_out.whitened

    def share(functions: _Functions) -> float:
        axes = [_by_joint(linear, axis, functions)[held_out.rows] for axis in range(1, linear.axes + 1)]
        return held_out_share(weight[:, None] * np.concatenate(axes, axis=1), off, held_out.group)

    looked = {what: None if functions is None else share(functions) for what, functions in of_arm.items()}
    return HeldOutResidual(held_out.rms_um, held_out.noise_um, looked)


def with_dependences(residual: Residual, result: SearchResult, held_out: HeldOut | None) -> Residual:
    """Add the quantities on which the residual depends, or its scatter."""
    linear = result.linear
    whole = linear.without_set_up(result.posterior.residual + result.free_share)
    groups = np.zeros(len(linear.y), dtype=np.int64)
    for k, rows in enumerate(linear.rows):
        groups[rows] = _FOLDS * k + np.arange(rows.stop - rows.start) % _FOLDS
    if held_out is not None:
        whole[held_out.rows] = held_out.whitened
        groups[held_out.rows] = -1 - held_out.group
    weight = np.sqrt(result.state.robust)
    follows = []
    for what, axis, columns in _subjects(linear):
        free = columns if held_out is not None else linear.without_set_up(columns)
        if np.any(free):
            share = held_out_share(weight[:, None] * free, weight * whole, groups)
            follows.append(Dependence(what, share, axis))
    follows.sort(key=lambda followed: -followed.share)
    scatters = held_out is not None and not any(block.measured for block in linear.blocks)
    is_scatter = scatters and all(followed.share < _NOTHING for followed in follows)
    scatter_um = _scatter_um(result) if is_scatter else None
    return replace(residual, follows=tuple(follows), scatter_um=scatter_um)


def held_out_share(columns: Array, off: Array, group: Integers) -> float:
    """Share of the square of a residual (n,) explained by columns (n, c) in cross-validation over groups (n,), at the
    strength with the largest share.
    """
    normal, right = columns.T @ columns, columns.T @ off
    squares = np.zeros(len(_STRENGTHS))
    for number in np.unique(group):
        rows = np.flatnonzero(group == number)
        of_group = columns[rows]
        power, turn = np.linalg.eigh(normal - of_group.T @ of_group)
        seen = turn.T @ (right - of_group.T @ off[rows])
        fitted = seen / (np.maximum(power, 0.0) + 1 / _STRENGTHS[:, None])
        squares += ((off[rows] - fitted @ (of_group @ turn).T) ** 2).sum(axis=1)
    return max(1 - float(squares.min() / (off @ off)), 0.0)


def _subjects(linear: Linearisation) -> Iterator[tuple[Subject, int | None, Array]]:
    """Yield each quantity with the changes (N, c) of the readings caused by errors that depend on it."""
    joints = range(1, linear.axes + 1)
    of_joint: dict[Subject, Callable[..., Array]] = {
        "angle": _angle, "load": _load, "speed": _speed, "approach": lambda block, joint: _sides(block)[:, [joint]]
    }  # fmt: skip
    for what, function in of_joint.items():
        for axis in joints:
            yield what, axis, _by_joint(linear, axis, partial(function, joint=axis - 1))
    yield "time", None, np.concatenate([_by_joint(linear, axis, _time) for axis in joints], axis=1)
    yield "place", None, linear.at_entries([_place(block) for block in linear.blocks])


def _by_joint(linear: Linearisation, axis: int, functions: _Functions) -> Array:
    return linear.by_joint(axis, lambda block: _UNIT_RAD * functions(block))


def _at_samples(block: Block, values: Array) -> Array:
    """Values of table rows (n, c) at the samples of a block's path; zero for circles."""
    samples = len(block.path.q)
    if not block.facts.of_places:
        return np.zeros((samples, values.shape[1]))
    return np.repeat(values, samples // len(values), axis=0)


def _sides(block: Block) -> Array:
    sides = block.table.sides
    return _at_samples(block, np.zeros(block.table.q.shape) if sides is None else sides.astype(float))


def _angle(block: Block, joint: int) -> Array:
    q = block.drives.q[:, [joint]] * _ORDERS
    return np.concatenate([np.cos(q), np.sin(q)], axis=1)


def _load(block: Block, joint: int) -> Array:
    return np.power(torque_share(block, joint)[:, None], _DEGREES)


def _speed(block: Block, joint: int) -> Array:
    """Speed of a joint, its sign and its signed square; zero if the joint rests at the readings or has no times."""
    t_s, q = block.path.t_s, block.drives.q[:, joint]
    if block.facts.of_places or not block.sampling or np.diff(t_s).min() <= 0:
        return np.zeros((len(q), 3))
    speed = np.gradient(q, t_s)
    share = speed / max(float(np.abs(speed).max()), 1e-12)
    return np.stack([share, np.sign(share), share * np.abs(share)], axis=1)


def _time(block: Block) -> Array:
    if block.path.alone:  # the order of the visits is unknown
        return np.zeros((len(block.path.q), len(_HALF_WAVES)))
    t_s = block.path.t_s - block.path.t_s[0]
    values: Array = np.cos(np.pi * _HALF_WAVES * (t_s / max(float(t_s[-1]), 1e-12))[:, None])
    return values


def _place(block: Block) -> Array:
    """Errors of each coordinate as second and third powers of the place, whitened; zero for other tests."""
    if not block.facts.of_tracker:
        return np.zeros((len(block.y_mm), 3 * 16))
    at = block.values - block.values.mean(axis=0)
    x, y, z = (at / max(float(np.abs(at).max()), 1e-12)).T
    second = [x * x, y * y, z * z, x * y, x * z, y * z]
    third = [a * b for a in second for b in (x, y, z)][:10]
    powers = np.stack([*second, *third], axis=1)
    errors = np.einsum("nk,ij->nijk", powers, np.eye(3)).reshape(len(at), 3, -1)
    return block.whitened(_UNIT_MM * errors)


# ----------------------------------------------------------------------------------------------------------------------
# Scatter between visits of a target, repeats of a circle, or places visited once, if it is larger than usual.

_FAST, _APART = (8, 120), 1.5
"""Waves a lap of fast changes between repeats, and the ratio of difference to sum of two gauges from which the
difference is unusual. Chosen: 0.9 in 95 of 96 circles of real noise; 1.6 to 4.1 with a sticking ball joint.
"""


def unusual_visits_um(result: SearchResult) -> float | None:
    """RMS distance between a visit of a target and the mean of its visits, or a circle and the mean of its repeats, if
    it exceeds the repeatability of arms of this build.
    """
    blocks = [
        (block, um) for block, um in zip(result.linear.blocks, noise_um(result.linear), strict=True) if block.measured
    ]
    usual_um = 1e3 * float(np.hypot(SLOW_MM.high, WHITE_MM.high))
    differ = [(float(um), usual_um) for block, um in blocks if block.sampling]
    squares_mm2 = [block.count * block.sd_mm**2 for block, _ in blocks if block.facts.of_places]
    if squares_mm2:
        # For industrial and light arms the data-sheet repeatability in each coordinate; for others as their backlash.
        usual_um = 1e3 * float(np.sqrt(3)) * TARGET_MM.high * play_of_joint(1, 1.0).usual_times(result.reference)
        differ.append((1e3 * float(np.sqrt(3 * np.mean(np.concatenate(squares_mm2)))), usual_um))
    return max((um for um, usual_um in differ if um > usual_um), default=None)


def gauges_apart_um(result: SearchResult) -> float | None:
    """RMS difference between two gauges that changes from repeat to repeat, at 8 to 120 waves a lap, if it exceeds the
    white noise of gauges and the change of their mean; otherwise None.

    Movements of the tool change the mean of two parallel gauges more than their difference. A ball joint that sticks
    bends the link, and changes mainly the difference.
    """
    apart, fast = [], np.isin(ORDER_OF, np.arange(*_FAST))
    for block in result.linear.blocks:
        if block.sampling and block.measured and len(block.steady_mm) > 1:
            energy = np.sum(block.steady_mm[:, : len(ORDER_OF)] ** 2, axis=0) / (len(block.steady_mm) - 1)
            # Sum and difference are unitary: each is the root of two smaller than that of the readings.
            twice_mean_um, um = 1e3 * np.sqrt(4 * (energy * fast).reshape(2, -1).sum(axis=1) / len(ORDER_OF))
            if um > max(1e3 * WHITE_MM.high, _APART * twice_mean_um):
                apart.append(float(um))
    return max(apart, default=None)


def unrepeated_um(result: SearchResult, touch: Touch | None) -> float | None:
    """RMS deviation of places from the calibrated model if it exceeds the usual scatter and no place was measured
    twice: scatter or an unknown cause. touch: how the arm was seated, if by touches.
    """
    if any(block.measured or not block.shows_noise for block in result.linear.blocks):
        return None
    stops_mm = REPEATABILITY_MM / RP_PER_SD * play_of_joint(1, 1.0).usual_times(result.reference)
    by_tip = touch is not None and touch.seat == "tip"
    usual_um = 1e3 * float(np.sqrt(3) * np.hypot(stops_mm, TIP_MM if by_tip else TRACKER_U_MM))
    off_um = float(np.sqrt(3)) * _scatter_um(result)
    return off_um if off_um > usual_um else None


def _scatter_um(result: SearchResult) -> float:
    """Standard deviation of one coordinate of the measured positions, from the residual and its degrees of freedom."""
    linear = result.linear
    residuals = linear.in_mm(linear.without_set_up(result.posterior.residual + result.free_share))
    square_mm2 = sum(float(np.sum(residual**2)) for residual in residuals)
    return 1e3 * float(np.sqrt(square_mm2 / max(len(linear.y) - linear.U.shape[1], 1)))

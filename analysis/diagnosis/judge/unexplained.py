"""Dependence of the unexplained part of the readings on the angle, load or speed of a joint, on time, or on place.

Each dependence is modelled as an error of a joint that is a smooth function of the subject. It is fitted to a part of
the readings and evaluated on the others. The share therefore refers to readings outside the fit, and noise gives about
zero. Poses are held out by neighbourhoods of joint space, and their error is the prediction error of the model fitted
to all others. On circles, every fifth entry of the spectrum is held out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.evidence.observation import ORDER_OF
from analysis.diagnosis.fit.responses import noise_um
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.judge.misses import LeftOut, share_left_out, sides_of
from analysis.diagnosis.judge.remains import Followed, Unexplained, What
from analysis.diagnosis.judge.validation import shows_noise
from analysis.procedures.shared.test_kind import facts_of
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.model.predict import pull
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
_ORDERS = np.arange(1, 9)
"""Waves per turn of an error over the joint angle. Chosen: a period of 45°, the finest that a hundred poses show."""
_DEGREES = np.arange(1, 6)
"""Powers of the torque. Chosen: they approximate a cubic spring and a one-sided knee within a tenth."""
_HALF_WAVES = np.arange(1, 5)
"""Half waves over the duration of a run: warming, a shift of the instrument, a day's cycle."""
_FOLDS = 5
"""Number of parts of a circle's spectrum, each held out once."""
_FAST, _APART = (8, 120), 1.5
"""Waves a lap of fast changes between repeats, and the ratio of difference to sum of two gauges from which the
difference is unusual. Chosen: at most 0.9 in 95 of 96 circles with all noise of real cells, 1.49 in one; 1.6 to 4.1 in
8 cells with a sticking ball joint.
"""
_NOTHING = 0.06
"""Share below which the residual depends on no quantity, and readings without repeats may be scatter. Source: plain
noise of 30 to 50 poses with nine seeds, in which the largest share of any quantity was 0.054.
"""


def with_dependences(unexplained: Unexplained, result: SearchResult, left_out: LeftOut | None) -> Unexplained:
    """Return the unexplained part of the readings with the quantities on which it depends, or with its scatter.

    left_out: entries (n,) of places as predicted by all others.
    """
    linear = result.linear
    whole = linear.without_set_up(result.posterior.residual + result.free_share)
    groups = _folds(result)
    if left_out is not None:
        whole[left_out.rows] = left_out.missed_sigma
        groups[left_out.rows] = -1 - left_out.group
    weight = np.sqrt(result.state.robust)
    off = weight * whole
    follows = []
    for what, axis, columns in _subjects(result):
        free = columns if left_out is not None else linear.without_set_up(columns)
        if np.any(free):
            follows.append(Followed(what, axis, share_left_out(weight[:, None] * free, off, groups)))
    follows.sort(key=lambda followed: -followed.share)
    scatters = left_out is not None and not any(block.measured for block in linear.blocks)
    is_scatter = scatters and all(followed.share < _NOTHING for followed in follows)
    scatter_um = _scatter_um(result) if is_scatter else None
    return replace(unexplained, follows=tuple(follows), scatter_um=scatter_um)


def unusual_visits_um(result: SearchResult) -> float | None:
    """Return the rms distance in µm between a visit of a target and the mean of its visits, or between a circle and the
    mean of its repeats, if it exceeds the repeatability of arms of this build; None if it does not, or if nothing was
    measured twice."""
    differ = [um for um in (_visits_um(result), _circles_um(result)) if um is not None]
    return max(differ, default=None)


def _circles_um(result: SearchResult) -> float | None:
    """Return the rms difference in µm between repeated circles, None if it is usual or unknown."""
    blocks = result.linear.blocks
    differ = [
        um for block, um in zip(blocks, noise_um(result.linear), strict=True) if block.sampling and block.measured
    ]
    usual_um = 1e3 * float(np.hypot(SLOW_MM.high, WHITE_MM.high))
    return max((float(um) for um in differ if um > usual_um), default=None)


def gauges_apart_um(result: SearchResult) -> float | None:
    """Return the rms difference in µm between two gauges that changes from repeat to repeat, at 8 to 120 waves a lap,
    if it exceeds the white noise of gauges and the corresponding change of their mean; otherwise None.

    Movements of the tool change the mean of two parallel gauges more than their difference, as the trials with real
    cells show. A ball joint that sticks bends the link, and changes mainly the difference.
    """
    apart = [both for block in result.linear.blocks if (both := _fast_changes_um(block)) is not None]
    limit_um = 1e3 * WHITE_MM.high
    return max((um for um, mean_um in apart if um > max(limit_um, _APART * mean_um)), default=None)


def _fast_changes_um(block: Block) -> tuple[float, float] | None:
    """Return the rms changes in µm, between repeats of a circle, of the difference of two gauges and of twice their
    mean, both in fast waves; None for other tests and circles without repeats.
    """
    if not block.sampling or not block.measured or len(block.steady_mm) < 2 or block.values.shape[1] != 2:
        return None
    count = len(ORDER_OF)
    energy = np.sum(block.steady_mm[:, :count] ** 2, axis=0) / (len(block.steady_mm) - 1)
    fast = np.isin(ORDER_OF, np.arange(*_FAST))
    of_sum, of_difference = (energy * fast).reshape(2, -1).sum(axis=1) / (count // 2)
    # Sum and difference are unitary: each is the root of two smaller than that of the readings.
    return 1e3 * float(np.sqrt(2 * of_difference)), 1e3 * float(np.sqrt(2 * of_sum))


def _visits_um(result: SearchResult) -> float | None:
    """Return the rms distance in µm between visits of a target, None if it is usual or unknown."""
    blocks = [block for block in result.linear.blocks if facts_of(block.table.test).of_places and block.measured]
    if not blocks:
        return None
    square_mm2 = np.mean(np.concatenate([block.count * block.sd_mm**2 for block in blocks]))
    visits_um = 1e3 * float(np.sqrt(3 * square_mm2))
    return visits_um if visits_um > most_usual_visits_um(result) else None


def unrepeated_um(result: SearchResult, touch: Touch | None) -> float | None:
    """Return the rms deviation in µm of places from the calibrated model if it exceeds the usual scatter of such arms
    and instruments and no place was measured twice; otherwise None. touch: how the arm was seated, if by touches.

    The deviations may then be scatter or an error of an unknown cause.
    """
    if any(block.measured or not shows_noise(block) for block in result.linear.blocks):
        return None
    stops_mm = REPEATABILITY_MM / RP_PER_SD * play_of_joint(1, 1.0).usual_times(result.reference)
    by_tip = touch is not None and touch.seat == "tip"
    usual_um = 1e3 * float(np.sqrt(3) * np.hypot(stops_mm, TIP_MM if by_tip else TRACKER_U_MM))
    off_um = float(np.sqrt(3)) * _scatter_um(result)
    return off_um if off_um > usual_um else None


def most_usual_visits_um(result: SearchResult) -> float:
    """Return the largest such distance in µm for arms of this build.

    For industrial and light arms it is the data-sheet repeatability in each of three coordinates. For other builds it
    is larger in proportion to their usual backlash.
    """
    return 1e3 * float(np.sqrt(3)) * TARGET_MM.high * play_of_joint(1, 1.0).usual_times(result.reference)


def _folds(result: SearchResult) -> Integers:
    """Return the index (N,) of the cross-validation fold of each reading."""
    folds = np.zeros(len(result.linear.y), dtype=np.int64)
    for k, rows in enumerate(result.linear.rows):
        folds[rows] = _FOLDS * k + np.arange(rows.stop - rows.start) % _FOLDS
    return folds


def _subjects(result: SearchResult) -> list[tuple[What, int | None, Array]]:
    """Return each quantity with the changes (N, c) of the readings caused by errors that depend on it."""
    linear, subjects = result.linear, list[tuple[What, int | None, Array]]()
    joints = range(1, linear.axes + 1)
    of_joint: dict[What, Callable[..., Array]] = {
        "angle": _angle, "load": _load, "speed": _speed, "approach": _approach
    }  # fmt: skip
    for what, function in of_joint.items():
        for axis in joints:
            columns = _UNIT_RAD * linear.by_joint(axis, partial(function, joint=axis - 1))
            subjects.append((what, axis, columns))
    subjects.append(("time", None, np.concatenate([linear.by_joint(axis, _time) for axis in joints], axis=1)))
    subjects.append(("place", None, linear.at_entries([_place(block) for block in linear.blocks])))
    return subjects


def _angle(block: Block, joint: int) -> Array:
    q = block.drives.q[:, [joint]] * _ORDERS
    return np.concatenate([np.cos(q), np.sin(q)], axis=1)


def _load(block: Block, joint: int) -> Array:
    torque: Array = pull(block.model.arm, block.model.load, block.path.q).torque[:, joint]
    most = float(np.abs(torque).max())
    powers: Array = np.power((torque / max(most, 1e-12))[:, None], _DEGREES)
    return powers


def _speed(block: Block, joint: int) -> Array:
    """Return speed, sign and signed square of the speed of a joint that moves during the readings."""
    t_s, q = block.path.t_s, block.drives.q[:, joint]
    if facts_of(block.table.test).of_places or not block.sampling or np.diff(t_s).min() <= 0:
        return np.zeros((len(q), 3))
    speed = np.gradient(q, t_s)
    share = speed / max(float(np.abs(speed).max()), 1e-12)
    return np.stack([share, np.sign(share), share * np.abs(share)], axis=1)


def _approach(block: Block, joint: int) -> Array:
    """Return the approach side of a joint at each place."""
    count = len(block.path.q)
    if not facts_of(block.table.test).of_places:
        return np.zeros((count, 1))
    sides = sides_of(block)[:, [joint]]
    return np.repeat(sides, count // len(sides), axis=0)


def _time(block: Block) -> Array:
    if block.path.alone:  # the order of the visits is unknown
        return np.zeros((len(block.path.q), len(_HALF_WAVES)))
    t_s = block.path.t_s - block.path.t_s[0]
    values: Array = _UNIT_RAD * np.cos(np.pi * _HALF_WAVES * (t_s / max(float(t_s[-1]), 1e-12))[:, None])
    return values


def _place(block: Block) -> Array:
    """Return errors of each coordinate as second and third powers of the place, whitened; zero for other tests."""
    if not facts_of(block.table.test).of_tracker:
        return np.zeros((len(block.y_mm), 3 * 16))
    at = block.values - block.values.mean(axis=0)
    x, y, z = (at / max(float(np.abs(at).max()), 1e-12)).T
    second = [x * x, y * y, z * z, x * y, x * z, y * z]
    third = [a * b for a in second for b in (x, y, z)][:10]
    powers = np.stack([*second, *third], axis=1)
    errors = np.einsum("nk,ij->nijk", powers, np.eye(3)).reshape(len(at), 3, -1)
    return block.whitened(_UNIT_MM * errors)


def _scatter_um(result: SearchResult) -> float:
    """Return the standard deviation in µm of one coordinate of the measured positions, estimated from the residual.

    The degrees of freedom are reduced by the number of set-up terms.
    """
    linear = result.linear
    residuals = linear.in_mm(linear.without_set_up(result.posterior.residual + result.free_share))
    square_mm2 = sum(float(np.sum(residual**2)) for residual in residuals)
    return 1e3 * float(np.sqrt(square_mm2 / max(len(linear.y) - linear.U.shape[1], 1)))

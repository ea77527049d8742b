"""What the unexplained part of the readings follows: the angle, load or speed of a joint, time, or place.

Each is fitted as an error of one joint that is a smooth function of it, to all readings but some, and held against
those: the share is of readings that had no part in the fit, so that noise gives about zero. Poses are left out by
neighbourhoods of joint space, and what is explained there is what the model of all others misses; of circles every
fifth entry of the spectrum is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.judge.misses import LeftOut, share_left_out, sides_of
from analysis.diagnosis.judge.remains import Followed, Unexplained, What
from analysis.procedures.facts import facts_of
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.model.scene import pull

_UNIT_RAD, _UNIT_MM = np.radians(1e-3), 1e-3
"""Units of an error of a joint and of a place. They have no effect on the result, because the strength is scaled."""
_ORDERS = np.arange(1, 9)
"""Waves a turn of an error over the angle of a joint. Chosen: 45° of a wave, as finely as a hundred poses show it."""
_DEGREES = np.arange(1, 6)
"""Powers of the torque. Chosen: a cubic spring and a knee on either side are within a tenth of these."""
_HALF_WAVES = np.arange(1, 5)
"""Half waves over the duration of a run: warming, a shift of the instrument, a day's cycle."""
_FOLDS = 5
"""Parts of the spectrum of a circle of which each is left out once."""
_NOTHING = 0.06
"""Share below which the residual follows no subject, and readings without repeats may be scatter. Source: plain noise
of 30 to 50 poses, nine seeds, in which the largest share of any subject was 0.054."""


def unexplained_of(result: SearchResult, left_out: LeftOut | None, rms_um: float) -> Unexplained:
    """Return what the unexplained part of the readings, rms_um in all, follows; `left_out` are the (n,) entries of
    places as all others predict them."""
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
    return Unexplained(rms_um, tuple(follows), _scatter_um(result) if is_scatter else None)


def _folds(result: SearchResult) -> Integers:
    """Return the part (N,) that each entry is left out with."""
    folds = np.zeros(len(result.linear.y), dtype=np.int64)
    for k, rows in enumerate(result.linear.rows):
        folds[rows] = _FOLDS * k + np.arange(rows.stop - rows.start) % _FOLDS
    return folds


def _subjects(result: SearchResult) -> list[tuple[What, int | None, Array]]:
    """Return each subject with the changes (N, c) of the readings by errors that follow it."""
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
    q = block.path.q[:, [joint]] * _ORDERS
    return np.concatenate([np.cos(q), np.sin(q)], axis=1)


def _load(block: Block, joint: int) -> Array:
    torque: Array = pull(block.model.arm, block.model.load, block.path.q).torque[:, joint]
    most = float(np.abs(torque).max())
    powers: Array = np.power((torque / max(most, 1e-12))[:, None], _DEGREES)
    return powers


def _speed(block: Block, joint: int) -> Array:
    """Speed, its sign and its square, of a joint that moves while it is read."""
    t_s, q = block.path.t_s, block.path.q[:, joint]
    if facts_of(block.table.test).of_places or not block.sampling or np.diff(t_s).min() <= 0:
        return np.zeros((len(q), 3))
    speed = np.gradient(q, t_s)
    share = speed / max(float(np.abs(speed).max()), 1e-12)
    return np.stack([share, np.sign(share), share * np.abs(share)], axis=1)


def _approach(block: Block, joint: int) -> Array:
    """The side from which a joint came to each place."""
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
    """Errors of each coordinate that are second and third powers of the place, whitened; zero for other tests."""
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
    """Return the standard deviation in µm of one coordinate of places: that of the residual, of which the set-ups took
    as many degrees of freedom as they have terms."""
    linear = result.linear
    residuals = linear.in_mm(linear.without_set_up(result.posterior.residual + result.free_share))
    square_mm2 = sum(float(np.sum(residual**2)) for residual in residuals)
    return 1e3 * float(np.sqrt(square_mm2 / max(len(linear.y) - linear.U.shape[1], 1)))

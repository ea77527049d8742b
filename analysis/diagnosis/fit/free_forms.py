"""Free forms: unnamed errors of unspecified shape. They are errors of an axis as a function of angle, speed or
direction of motion; of the gauges as a function of time; and of the ball as a function of position.

Effects of the library have definite shapes, so they explain with two or three parameters what a free form explains with
many. If a free form still explains much of the residual, an effect outside the library is present, and the form shows
the dependence.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.fit.background import CoefficientPosterior
from analysis.diagnosis.fit.responses import Linearisation
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Array, forward

_WAVES = 24
"""Half waves over the range of an angle, or the duration of a run, with strength inversely proportional to the
order, as for a random walk, so that bends and steps are possible. Chosen: fine enough for features of a few
degrees.
"""
_WAVES_BY_WAY = 8
"""Half waves for an error that changes with the direction of joint motion. Chosen: friction changes slowly."""
_POWERS = np.array([0.5, 1.0, 2.0])
"""Powers of the speed for speed-dependent errors. Chosen: square root, linear and quadratic, covering friction and
inertia.
"""
_SLOW = np.radians(0.2)
"""Speed in rad/s below which a joint's direction of motion is unclear. Chosen: a fraction of the slowest joint
speeds of a circle.
"""
_UNIT_RAD, _UNIT_MM = np.radians(1e-3), 1e-3
"""Units of the columns. They have no influence on the result, because the strength is scaled."""
_STRENGTHS = 4.0 ** np.arange(-4, 11)
"""Candidate squares of a form's strength, in units of _UNIT_RAD and _UNIT_MM; the best is used. The grid covers 1/16
of a unit to 1000 units in factors of two.
"""
FREE_PRICE = 6.0
"""Log number of choices: about 26 forms times 15 strengths."""


@dataclass(frozen=True)
class FreeForm:
    """Form with a description and columns (N, c) in noise standard deviations.

    A selected form has the most likely strength, and the log evidence after the price of the selection.
    """

    words: str
    columns: Array
    gain: float = 0.0


def best_free_form(forms: Sequence[FreeForm], posterior: CoefficientPosterior) -> FreeForm:
    """Return the free form with the highest evidence for the remaining residual, at the most likely strength;
    columns (N, c).
    """
    # A single product with all columns takes two thirds of the time of separate products.
    ends = np.cumsum([0, *(form.columns.shape[1] for form in forms)]).tolist()
    products, slope = posterior.cavity(np.concatenate([form.columns for form in forms], axis=1))
    gains = [_gains(products[own, own], slope[own]) for own in (slice(*both) for both in pairwise(ends))]
    k = int(np.argmax([gain.max() for gain in gains]))
    strength = float(np.sqrt(_STRENGTHS[np.argmax(gains[k])]))
    return FreeForm(forms[k].words, strength * forms[k].columns, float(gains[k].max()) - FREE_PRICE)


def discrepancy_evidence(functions: Array, posterior: CoefficientPosterior) -> tuple[float, float]:
    """Return the log evidence gained by free functions (N, c) with a common amplitude, after the price of that
    amplitude, and the likeliest amplitude.

    They represent the discrepancy between the arm and every model of the library (Kennedy and O'Hagan 2001).
    """
    products, slope = posterior.cavity(functions)
    gains = _gains(products, slope)
    best = int(np.argmax(gains))
    return float(gains[best]) - FREE_PRICE, float(np.sqrt(_STRENGTHS[best]))


def _gains(products: Array, slope: Array) -> Array:
    """Return the log evidence (s,) for columns with normally distributed coefficients, compared with no columns.

    There is a value for each of _STRENGTHS. The arguments are the whitened products (k, k) of the columns, and their
    products with the residual, slope (k,).
    """
    power, turn = np.linalg.eigh(products)
    power, strengths = np.maximum(power, 0.0), _STRENGTHS[:, None]
    gains: Array = 0.5 * ((turn.T @ slope) ** 2 / (power + 1 / strengths) - np.log1p(strengths * power)).sum(axis=1)
    return gains


def free_forms_of(linear: Linearisation) -> Iterator[FreeForm]:
    """Yield the free forms visible in the runs, with columns (N, c): functions (n, c) rad or mm at the samples of
    each block.
    """
    # On circles joints move during the readings, otherwise between them.
    blocks = tuple(block for block in linear.blocks if block.sampling) or linear.blocks
    low, high = (of([of(block.drives.q, axis=0) for block in blocks], axis=0) for of in (np.min, np.max))
    span, fastest = high - low, np.max([np.abs(drive_rates(block)).max(axis=0) for block in blocks], axis=0)

    def angle(joint: int, block: Block) -> Array:
        return half_waves((block.drives.q[:, joint] - low[joint]) / span[joint], _UNIT_RAD)

    def speed(joint: int, block: Block) -> Array:
        return np.asarray(_UNIT_RAD * np.abs(drive_rates(block)[:, [joint]] / fastest[joint]) ** _POWERS, dtype=float)

    def way(joint: int, block: Block) -> Array:
        return np.asarray(_UNIT_RAD * np.tanh(drive_rates(block)[:, [joint]] / _SLOW), dtype=float)

    for axis in range(1, linear.axes + 1):
        error = f"an error of axis {axis} that goes with"
        if span[axis - 1] > 0:
            yield FreeForm(f"{error} its angle", linear.by_joint(axis, partial(angle, axis - 1)))
        if fastest[axis - 1] > 0:
            words = f"{error} the speed, whichever way it turns"
            yield FreeForm(words, linear.by_joint(axis, partial(speed, axis - 1)))
        for joint in np.flatnonzero(fastest).tolist():
            words = f"{error} the way {'it' if joint == axis - 1 else f'axis {joint + 1}'} turns"
            yield FreeForm(words, linear.by_joint(axis, partial(way, joint)))
    for where, shares in (("both gauges", (1.0, 1.0)), ("gauge 1", (1.0, 0.0)), ("gauge 2", (0.0, 1.0))):
        yield FreeForm(f"something that changes with time in {where}", linear.by_gauge(shares, times_of_lap))
    yield FreeForm(
        "an error of the ball that varies with the position of the link", linear.by_gauge((1.0, 1.0), circle_waves)
    )


def discrepancy_functions(linear: Linearisation) -> Array:
    """Return the functions (N, c) of unit amplitude for causes outside the library.

    These are every free form and, for each joint, an error that depends on angle and direction of motion together, like
    hysteresis and the drag of cables.
    """
    q = [block.drives.q for block in linear.blocks if block.sampling]
    low, span = (
        np.min([np.min(each, axis=0) for each in q], axis=0),
        np.max([np.ptp(each, axis=0) for each in q], axis=0),
    )

    def both(joint: int, block: Block) -> Array:
        waves = half_waves((block.drives.q[:, joint] - low[joint]) / span[joint], _UNIT_RAD)[:, :_WAVES_BY_WAY]
        return np.asarray(waves * np.tanh(drive_rates(block)[:, [joint]] / _SLOW), dtype=float)

    turning = [axis for axis in range(1, linear.axes + 1) if span[axis - 1] > 0]
    by_way = [linear.by_joint(axis, partial(both, axis - 1)) for axis in turning]
    return np.concatenate([*(form.columns for form in free_forms_of(linear)), *by_way], axis=1)


def times_of_lap(block: Block) -> Array:
    """Return functions (n, c) mm of the time of a block's samples."""
    t = block.path.t_s
    return half_waves((t - t[0]) / (t[-1] - t[0]), _UNIT_MM) if block.sampling else np.zeros((len(t), _WAVES))


def circle_waves(block: Block) -> Array:
    """Return functions (n, c) mm of the circle angle of a block's samples."""
    q = block.path.q
    if not block.sampling:
        return np.zeros((len(q), 2 * _WAVES))
    tool = forward(block.model.arm, q)[:, :3, 3]
    turned = frame_of(circle_of(block.model.rig)).angle(tool)[:, None] * np.arange(1, _WAVES + 1)
    waves = np.concatenate([np.cos(turned), np.sin(turned)], axis=1)
    return _UNIT_MM * waves / np.tile(np.arange(1, _WAVES + 1), 2)


def half_waves(share: Array, unit: float) -> Array:
    """Return half waves (n, c) of a share (n,) between 0 and 1."""
    number = np.arange(1, _WAVES + 1)
    return unit * np.cos(np.pi * number * np.clip(share, 0, 1)[:, None]) / number


def drive_rates(block: Block) -> Array:
    """Return the speeds (n, 6) rad/s of the drives; zero at targets."""
    drives = block.drives
    return np.gradient(drives.q, drives.t_s, axis=0) if block.sampling else np.zeros_like(drives.q)

"""Free forms: errors without a name, whose shape is left open. They are an error of an axis as a function of its angle,
of its speed or of a direction of motion; of the gauges as a function of time; and of the ball as a function of
position.

Each effect of the library has a definite shape, so it explains with two or three parameters what a free form needs many
for. Where a free form still explains much of the residual of the names, an effect outside the library is present, and
the form describes what it depends on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from analysis.diagnosis.background import Posterior
from analysis.diagnosis.blocks import Block
from analysis.diagnosis.linearisation import Linearisation
from analysis.geometry.circle import frame_of
from analysis.geometry.programs import circle_of
from analysis.kinematics.arm import Array, forward

_WAVES = 24
"""Half waves over the range of an angle, or over the duration of a run. Their strength falls as one over their number,
as in the path of a random walk, so that a function may bend and step. Chosen: fine enough for a feature of a few
degrees."""
_POWERS = np.array([0.5, 1.0, 2.0])
"""Powers of the speed that describe an error that depends on speed. Chosen: square root, linear and quadratic, which
cover friction and inertia."""
_SLOW = np.radians(0.2)
"""Rad/s below which the direction of motion of a joint is not clear. Chosen: a fraction of the slowest joint speeds of
a circle."""
_UNIT_RAD, _UNIT_MM = np.radians(1e-3), 1e-3
"""Units of the columns. They have no effect on the result, because the strength is scaled."""
_STRENGTHS = 4.0 ** np.arange(-4, 11)
"""Squares of a form's strength in these units; the best is used. The grid reaches from 1/16 of a unit to 1000 units in
factors of two."""
FREE_PRICE = 6.0
"""Logarithm of the number of choices: some 26 forms times 15 strengths."""


@dataclass(frozen=True)
class FreeForm:
    """A form with its description and its columns (N, c) in standard deviations of the noise."""

    words: str
    columns: Array


@dataclass(frozen=True)
class FittedFreeForm:
    """The free form that explains most of what the names leave, at its most likely strength, with its log evidence
    after the price of the choice among forms and strengths."""

    form: FreeForm
    gain: float


def best_free_form(forms: Sequence[FreeForm], posterior: Posterior) -> FittedFreeForm:
    """Return the free form that explains most of what the names leave beside everything else, at its most likely
    strength; its columns are (N, c)."""
    # One product with the columns of all forms takes two thirds of the time of one product for each form.
    ends = np.cumsum([0, *(form.columns.shape[1] for form in forms)]).tolist()
    products, slope = posterior.cavity(np.concatenate([form.columns for form in forms], axis=1))
    own = [slice(begin, end) for begin, end in pairwise(ends)]
    gains = [_gains(products[one, one], slope[one]) for one in own]
    k = int(np.argmax([gain.max() for gain in gains]))
    strength = float(np.sqrt(_STRENGTHS[np.argmax(gains[k])]))
    form = FreeForm(forms[k].words, strength * forms[k].columns)
    return FittedFreeForm(form, float(gains[k].max()) - FREE_PRICE)


def free_forms_of(linear: Linearisation) -> Iterator[FreeForm]:
    """Yield the free forms that the runs could show, with columns (N, c)."""
    # On circles joints move while they are read, elsewhere between readings.
    motion = _Motion(tuple(block for block in linear.blocks if block.sampling) or linear.blocks)
    for axis in range(1, 7):
        error = f"an error of axis {axis} that goes with"
        if motion.span[axis - 1] > 0:
            yield FreeForm(f"{error} its angle", linear.by_joint(axis, partial(motion.angle, axis - 1)))
        if motion.fastest[axis - 1] > 0:
            words = f"{error} its speed, whichever way it turns"
            yield FreeForm(words, linear.by_joint(axis, partial(motion.speed, axis - 1)))
        for joint in np.flatnonzero(motion.fastest).tolist():
            words = f"{error} the way {'it' if joint == axis - 1 else f'axis {joint + 1}'} turns"
            yield FreeForm(words, linear.by_joint(axis, partial(motion.way, joint)))
    for where, shares in (("both gauges", (1.0, 1.0)), ("gauge 1", (1.0, 0.0)), ("gauge 2", (0.0, 1.0))):
        yield FreeForm(f"something that changes with time in {where}", linear.by_gauge(shares, _time))
    yield FreeForm("something of the ball that goes with where the link is", linear.by_gauge((1.0, 1.0), _around))


@dataclass(frozen=True)
class _Motion:
    """The motion of the joints in some blocks."""

    blocks: tuple[Block, ...]

    @cached_property
    def _low(self) -> Array:
        """The smallest angles (6,) rad."""
        return np.asarray(np.min([block.one.path.q.min(axis=0) for block in self.blocks], axis=0), dtype=float)

    @cached_property
    def span(self) -> Array:
        """The range (6,) rad of the joints."""
        highest: Array = np.max([block.one.path.q.max(axis=0) for block in self.blocks], axis=0)
        return highest - self._low

    @cached_property
    def fastest(self) -> Array:
        """The largest speeds (6,) rad/s of the joints."""
        return np.asarray(np.max([np.abs(_rates(block)).max(axis=0) for block in self.blocks], axis=0), dtype=float)

    def angle(self, joint: int, block: Block) -> Array:
        """Return functions (n, c) rad of the angle of a joint at the samples of a block."""
        share = (block.one.path.q[:, joint] - self._low[joint]) / self.span[joint]
        return _waves(share, _UNIT_RAD)

    def speed(self, joint: int, block: Block) -> Array:
        """Return functions (n, c) rad of the speed of a joint at the samples of a block."""
        off: Array = _UNIT_RAD * np.abs(_rates(block)[:, [joint]] / self.fastest[joint]) ** _POWERS
        return off

    def way(self, joint: int, block: Block) -> Array:
        """Return a function (n, 1) rad of the direction of motion of a joint at the samples of a block."""
        off: Array = _UNIT_RAD * np.tanh(_rates(block)[:, [joint]] / _SLOW)
        return off


def _time(block: Block) -> Array:
    """Return functions (n, c) mm of the time of the samples of a block."""
    t = block.one.path.t_s
    return _waves((t - t[0]) / (t[-1] - t[0]), _UNIT_MM) if block.sampling else np.zeros((len(t), _WAVES))


def _around(block: Block) -> Array:
    """Return functions (n, c) mm of the circle angle of the samples of a block."""
    q = block.one.path.q
    if not block.sampling:
        return np.zeros((len(q), 2 * _WAVES))
    tool = forward(block.model.arm, q)[:, :3, 3]
    turned = frame_of(circle_of(block.model.rig)).angle(tool)[:, None] * np.arange(1, _WAVES + 1)
    waves = np.concatenate([np.cos(turned), np.sin(turned)], axis=1)
    parts: Array = _UNIT_MM * waves / np.tile(np.arange(1, _WAVES + 1), 2)
    return parts


def _waves(share: Array, unit: float) -> Array:
    """Return half waves (n, c) of a share (n,) between 0 and 1."""
    number = np.arange(1, _WAVES + 1)
    waves: Array = unit * np.cos(np.pi * number * np.clip(share, 0, 1)[:, None]) / number
    return waves


def _rates(block: Block) -> Array:
    """Return the joint speeds (n, 6) rad/s; at targets they are zero."""
    path = block.one.path
    rates: Array = np.gradient(path.q, path.t_s, axis=0) if block.sampling else np.zeros_like(path.q)
    return rates


def _gains(products: Array, slope: Array) -> Array:
    """Return the log evidence (s,), for each strength, of columns with unknown normal coefficients of that strength
    over no columns, given their products with each other (c, c) and with the residual (c,)."""
    power, turn = np.linalg.eigh(products)
    power = np.maximum(power, 0.0)
    seen = (turn.T @ slope) ** 2
    strengths = _STRENGTHS[:, None]
    gains: Array = 0.5 * (seen / (power + 1 / strengths) - np.log1p(strengths * power)).sum(axis=1)
    return gains

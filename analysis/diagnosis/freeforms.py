"""Forms without a name: an error of an axis that goes with its angle, its speed or a way of turning, of the gauges that
goes with time, of the ball that goes with the place; how, is left open.

The library says how each of its effects goes, so it explains with two or three numbers what a free form needs many for.
Where a free form still explains much of what the names leave, something is there that the library does not know, and
the form says what it goes with.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from analysis.diagnosis.background import Posterior
from analysis.diagnosis.blocks import Block
from analysis.diagnosis.linear import Linear
from analysis.geometry.circle import frame_of
from analysis.geometry.programs import circle_of
from analysis.kinematics.arm import Array, forward

_WAVES = 24
"""Half waves over the range of an angle, or over a run's time; each with a strength of one over its number, as the path
of a random walk: what goes with an angle may bend and step."""
_POWERS = np.array([0.5, 1.0, 2.0])
_SLOW = np.radians(0.2)
"""Rad/s below which a joint has no clear way of turning."""
_UNIT_RAD, _UNIT_MM = np.radians(1e-3), 1e-3
_STRENGTHS = 4.0 ** np.arange(-4, 11)
"""Squares of a form's strength in these units, of which the best is taken."""
FREE_PRICE = 6.0
"""Log of the number of forms, some 26, and of strengths, 15, among which one is chosen."""


@dataclass(frozen=True)
class FreeForm:
    """words: what it looks like; columns (N, c): its parts, in standard deviations."""

    words: str
    columns: Array


@dataclass(frozen=True)
class Stranger:
    """What explains most of what names leave, without a name: its form, as strong as is likely, and its log evidence
    after the price of a choice among forms and strengths."""

    form: FreeForm
    gain: float


def strangest(forms: Sequence[FreeForm], posterior: Posterior) -> Stranger:
    """The free form that explains most of what names leave, beside all else, as strongly as is likely."""
    gains = [_gains(*posterior.cavity(form.columns)) for form in forms]
    k = int(np.argmax([gain.max() for gain in gains]))
    strength = float(np.sqrt(_STRENGTHS[np.argmax(gains[k])]))
    form = FreeForm(forms[k].words, strength * forms[k].columns)
    return Stranger(form, float(gains[k].max()) - FREE_PRICE)


def free_forms(linear: Linear) -> Iterator[FreeForm]:
    """Those that the runs could show."""
    motion = _Motion(linear.blocks)
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


class _Motion:
    """Of the circles; where there are none, of all runs. span (6,): rad that the joints turn through; fastest (6,)
    rad/s."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        told = [block for block in blocks if block.sampling] or list(blocks)
        self._low = np.min([block.one.path.q.min(axis=0) for block in told], axis=0)
        self.span = np.max([block.one.path.q.max(axis=0) for block in told], axis=0) - self._low
        self.fastest = np.max([np.abs(_rates(block)).max(axis=0) for block in told], axis=0)

    def angle(self, joint: int, block: Block) -> Array:
        """(n, c) rad."""
        share = (block.one.path.q[:, joint] - self._low[joint]) / self.span[joint]
        return _waves(share, _UNIT_RAD)

    def speed(self, joint: int, block: Block) -> Array:
        """(n, c) rad."""
        off: Array = _UNIT_RAD * np.abs(_rates(block)[:, [joint]] / self.fastest[joint]) ** _POWERS
        return off

    def way(self, joint: int, block: Block) -> Array:
        """(n, 1) rad."""
        off: Array = _UNIT_RAD * np.tanh(_rates(block)[:, [joint]] / _SLOW)
        return off


def _time(block: Block) -> Array:
    """(n, c) mm."""
    t = block.one.path.t_s
    return _waves((t - t[0]) / (t[-1] - t[0]), _UNIT_MM) if block.sampling else np.zeros((len(t), _WAVES))


def _around(block: Block) -> Array:
    """(n, c) mm."""
    q = block.one.path.q
    if not block.sampling:
        return np.zeros((len(q), 2 * _WAVES))
    tool = forward(block.model.arm, q)[:, :3, 3]
    turned = frame_of(circle_of(block.model.rig)).angle(tool)[:, None] * np.arange(1, _WAVES + 1)
    waves = np.concatenate([np.cos(turned), np.sin(turned)], axis=1)
    parts: Array = _UNIT_MM * waves / np.tile(np.arange(1, _WAVES + 1), 2)
    return parts


def _waves(share: Array, unit: float) -> Array:
    number = np.arange(1, _WAVES + 1)
    waves: Array = unit * np.cos(np.pi * number * np.clip(share, 0, 1)[:, None]) / number
    return waves


def _rates(block: Block) -> Array:
    """Of the joints (n, 6) rad/s; at targets they stand."""
    path = block.one.path
    rates: Array = np.gradient(path.q, path.t_s, axis=0) if block.sampling else np.zeros_like(path.q)
    return rates


def _gains(products: Array, slope: Array) -> Array:
    """Log evidence of columns of unknown sizes, normal about 0 and of one strength, over none, for each strength: by
    their products with each other (c, c) and with what is left (c,)."""
    power, turn = np.linalg.eigh(products)
    power = np.maximum(power, 0.0)
    seen = (turn.T @ slope) ** 2
    strengths = _STRENGTHS[:, None]
    gains: Array = 0.5 * (seen / (power + 1 / strengths) - np.log1p(strengths * power)).sum(axis=1)
    return gains

"""The effects with which the fit of a form starts on the simulator.

The response to a play or a wave is not linear in its width or order, so a fit from afar ends in a local minimum, whose
residual supports wrong names. Therefore widths and orders are scanned first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from analysis.diagnosis.background import Posterior
from analysis.diagnosis.columns import LARGEST_FAULT, Columns, Form, order_of
from analysis.diagnosis.linearisation import Linearisation
from analysis.diagnosis.selection_state import FAULT, combined_effect, is_same
from analysis.kinematics.arm import Array
from rigs.effects import Effect
from rigs.schema.effect import healthy, identity, is_play, scaled

_BETWEEN = np.linspace(-0.6, 0.6, 9)
"""Orders tried about the order of a form, as multiples of the distance to its neighbour. They cover a little more than
half of the distance to either side."""
_PARTS = 3
"""Parts into which the distances between the orders of forms are divided for a large wave. Chosen: at the ends of a
joint's range the phases of neighbours differ by 48 degrees then."""
_WIDTHS = np.concatenate([0.5 ** np.arange(5.0, 1.0, -1.0), np.geomspace(0.5, 100.0, 40)])
"""Widths of a play that are tried, in healthy sizes, up to that of the largest fault. Neighbours differ by 15 %: fits
that start within 20 % of the width reached it. Below half a healthy size the response is nearly proportional to the
width, and they differ by a factor of two."""


def starting_effects(linear: Linearisation, columns: Columns, posterior: Posterior, form: Form) -> list[Effect]:
    """Return the effects from which the fit of a form to the readings (N,) starts.

    A wave has the order between its neighbours that explains most, and that of all orders where it is large; every
    other effect but a play has the size that it would have as a fault.
    """
    effect = form.effects[0]
    if is_play(effect):
        return _plays(columns, linear, posterior, effect)
    if hasattr(effect, "order"):
        near = _wave(linear, columns, posterior, form)
        if np.linalg.norm(posterior.size(form)) <= FAULT:
            return [near]
        return [near, _large_wave(linear, columns, posterior, form)]
    return [combined_effect(form.effects, posterior.size(form))]


def _plays(columns: Columns, linear: Linearisation, posterior: Posterior, effect: Effect) -> list[Effect]:
    """Return plays of two widths: the one that is most likely beside everything else, in each shape, and the one that
    leaves least (N,) with the set-ups alone. A play of about healthy size has the two likeliest shapes, each in its
    likeliest width.

    The strengths of the residual were estimated without the play and would hide it, so the first is the most likely one
    whatever the strength of each band is. Where everything else has taken up the play already, the second is nearer.
    """
    expected = identity(effect).model_copy(update={free.field: free.expected for free in effect.FREE})
    tried = [expected.model_copy(update={free.field: free.tried}) for free in effect.FREE if free.tried is not None]
    shapes = [healthy(shape) for shape in (expected, *tried)]
    # The background expects some of this play, which the tried one replaces.
    own = [k for form in columns.forms if is_same(form, effect) for k in form.columns]
    at_mean = columns.X[:, own] @ posterior.background.mean[own]
    cost, energy = np.empty((len(shapes), len(_WIDTHS))), np.empty(0)
    for k, shape in reversed(list(enumerate(shapes))):
        added = _in_each_width(linear, shape) - at_mean[:, None]
        left = posterior.residual[:, None] - posterior.left_of(added)
        cost[k] = columns.count @ np.log([np.sum(left[rows] ** 2, axis=0) for rows in columns.rows])
        energy = np.sum(linear.without_set_up(posterior.unexplained[:, None] - added) ** 2, axis=0)
    beside, alone = float(_WIDTHS[np.argmin(cost.min(axis=0))]), float(_WIDTHS[np.argmin(energy)])
    if max(beside, alone) <= FAULT:
        likeliest = np.argsort(cost.min(axis=1))[:2].tolist()
        return [scaled(shapes[k], float(_WIDTHS[np.argmin(cost[k])])) for k in likeliest]
    return [*(scaled(shape, beside) for shape in shapes), *[scaled(shapes[0], alone)] * (alone != beside)]


def _in_each_width(linear: Linearisation, shape: Effect) -> Array:
    """Return what a play of one shape adds in each of the widths (N, w), the same however often it is tried."""
    every = [scaled(shape, float(width)) for width in _WIDTHS]
    return linear.near.of("every width", shape, {}, lambda: linear.columns(every)).columns


def _wave(linear: Linearisation, columns: Columns, posterior: Posterior, form: Form) -> Effect:
    effect: Any = form.effects[0]
    near = [abs(order_of(one.effects[0]) - effect.order) for one in columns.forms if one.name == form.name]
    tried = effect.order + (sorted(near)[1] if len(near) > 1 else 0.0) * _BETWEEN
    tried = tried[tried >= min(effect.order, max(one.low for one in effect.STRETCHED))]
    effects = [one.model_copy(update={"order": float(order)}) for order in tried for one in form.effects]
    precision, eta = posterior.cavity(linear.columns(effects) / form.size)
    return _best_of_pairs(effects, precision, eta)


def _large_wave(linear: Linearisation, columns: Columns, posterior: Posterior, form: Form) -> Effect:
    """Return the wave that leaves least (N,) with the set-ups alone, of any order between those of the forms.

    A joint is mostly near the ends of its range, so that a wave looks most like those whose phases agree at both ends,
    and least like its neighbours among the forms.
    """
    orders = sorted({order_of(one.effects[0]) for one in columns.forms if one.name == form.name})
    places = np.arange(_PARTS * (len(orders) - 1) + 1) / _PARTS
    tried = np.interp(places, np.arange(len(orders)), orders)
    effects = [one.model_copy(update={"order": float(order)}) for order in tried for one in form.effects]
    added = linear.without_set_up(linear.columns(effects) / form.size)
    return _best_of_pairs(effects, added.T @ added, added.T @ posterior.unexplained)


def _best_of_pairs(effects: Sequence[Effect], precision: Array, eta: Array) -> Effect:
    """Return the wave that explains most, of pairs of effects that differ in phase, given the precision (2 n, 2 n) and
    the vector eta (2 n,) of their sizes."""
    pairs = [slice(2 * i, 2 * i + 2) for i in range(len(effects) // 2)]
    sizes = [np.linalg.solve(precision[own, own] + np.eye(2) / LARGEST_FAULT**2, eta[own]) for own in pairs]
    best = int(np.argmax([size @ eta[own] for size, own in zip(sizes, pairs, strict=True)]))
    return combined_effect(effects[pairs[best]], np.asarray(sizes[best], dtype=float))

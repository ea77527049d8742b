"""Initial effects for the fit of a form on the simulator.

The response to a backlash or a wave is not linear in the width or order, and a fit from a distant start would end in a
local minimum. Widths and orders are therefore scanned first.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from analysis.diagnosis.fit.background import CoefficientPosterior
from analysis.diagnosis.fit.candidates import LARGEST_FAULT, Columns, Form, order_of
from analysis.diagnosis.fit.responses import Linearisation
from analysis.diagnosis.fit.selection_state import FAULT, combined_effect, is_alike
from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect
from rigs.schema.effect import healthy, identity, is_play, scaled

_BETWEEN = np.linspace(-0.6, 0.6, 9)
"""Orders tried around the order of a form, as multiples of the distance to the neighbouring form."""
_PARTS = 3
"""Number of intermediate orders tried between the orders of two forms, for a large wave. Chosen: the phases of
neighbours at the ends of a joint's range then differ by 48 degrees.
"""
_WIDTHS = np.concatenate([0.5 ** np.arange(5.0, 1.0, -1.0), np.geomspace(0.5, 100.0, 40)])
"""Widths of a play that are tried, in healthy sizes. Neighbours differ by 15 %: fits starting within 20 % of the width
converged to it. Below half a healthy size the response is nearly proportional to the width.
"""


def starting_effects(
    linear: Linearisation, columns: Columns, posterior: CoefficientPosterior, form: Form
) -> list[Effect]:
    """Initial effects for fitting a form.

    A wave starts at the order that explains most between the neighbouring forms, and a large wave also at the best of
    all orders. Every other effect except a backlash starts at the size of a fault.
    """
    effect = form.effect
    if is_play(effect):
        expected = identity(effect).model_copy(update={free.field: free.expected for free in effect.FREE})
        tried = [expected.model_copy(update={free.field: value}) for free in effect.FREE for value in free.tried]
        shapes = [healthy(shape) for shape in (expected, *tried)]
        # The background expects some of this backlash, which the tried effect replaces.
        indices = [k for form in columns.forms if is_alike(form.effect, effect) for k in form.columns]
        at_mean = columns.X[:, indices] @ posterior.background.mean[indices]
        cost, energy = np.empty((len(shapes), len(_WIDTHS))), np.empty(0)
        for k, shape in reversed(list(enumerate(shapes))):
            widths = [scaled(shape, float(width)) for width in _WIDTHS]
            each = linear.near.of("every width", shape, {}, partial(linear.columns, widths))
            added = each.columns - at_mean[:, None]
            remaining = posterior.residual[:, None] - posterior.without_absorbed(added)
            cost[k] = columns.count @ np.log([np.sum(remaining[rows] ** 2, axis=0) for rows in columns.rows])
            energy = np.sum(linear.without_set_up(posterior.residual_at_prior[:, None] - added) ** 2, axis=0)
        beside_others, by_itself = float(_WIDTHS[np.argmin(cost.min(axis=0))]), float(_WIDTHS[np.argmin(energy)])
        if max(beside_others, by_itself) <= FAULT:
            likeliest = np.argsort(cost.min(axis=1))[:2].tolist()
            return [scaled(shapes[k], float(_WIDTHS[np.argmin(cost[k])])) for k in likeliest]
        return [
            *(scaled(shape, beside_others) for shape in shapes),
            *[scaled(shapes[0], by_itself)] * (by_itself != beside_others),
        ]
    if hasattr(effect, "order"):
        return _waves(columns, linear, posterior, form)
    return [combined_effect(form.effects, posterior.size(form))]


def _waves(columns: Columns, linear: Linearisation, posterior: CoefficientPosterior, form: Form) -> list[Effect]:
    """The best wave of an order near the form and, if large, the best wave of any order, with only the set-ups fitted.

    A joint is mostly near the ends of its range. A large wave therefore resembles the waves whose phases agree at both
    ends more than the neighbouring forms.
    """
    effect: Any = form.effect
    orders = [order_of(neighbour.effect) for neighbour in columns.forms if neighbour.name == form.name]
    near = sorted(abs(order - effect.order) for order in orders)
    tried = effect.order + (near[1] if len(near) > 1 else 0.0) * _BETWEEN
    tried = tried[tried >= min(effect.order, max(shape.low for shape in effect.STRETCHED))]
    effects = [part.model_copy(update={"order": float(order)}) for order in tried for part in form.effects]
    waves = [_best_of_pairs(effects, *posterior.cavity(linear.columns(effects) / form.size))]
    if np.linalg.norm(posterior.size(form)) > FAULT:
        whole = sorted(set(orders))
        places = np.arange(_PARTS * (len(whole) - 1) + 1) / _PARTS
        tried = np.interp(places, np.arange(len(whole)), whole)
        effects = [part.model_copy(update={"order": float(order)}) for order in tried for part in form.effects]
        added = linear.without_set_up(linear.columns(effects) / form.size)
        waves.append(_best_of_pairs(effects, added.T @ added, added.T @ posterior.residual_at_prior))
    return waves


def _best_of_pairs(effects: Sequence[Effect], precision: Array, eta: Array) -> Effect:
    """The wave that explains most; each two consecutive effects are a wave in two phases. `precision` (2 n, 2 n) and
    `eta` (2 n,): information of the readings about the sizes.
    """
    pairs = [slice(2 * i, 2 * i + 2) for i in range(len(effects) // 2)]
    sizes = [np.linalg.solve(precision[pair, pair] + np.eye(2) / LARGEST_FAULT**2, eta[pair]) for pair in pairs]
    best = int(np.argmax([size @ eta[pair] for size, pair in zip(sizes, pairs, strict=True)]))
    return combined_effect(effects[pairs[best]], np.asarray(sizes[best], dtype=float))

"""Prior odds of effects: the log evidence that an effect must gain before the selection accepts it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.evidence.significance import SURE_SIGMA
from analysis.diagnosis.fit.candidates import LARGEST_FAULT, Columns, Level, fault_sizes, order_of
from analysis.diagnosis.fit.joint_curves import is_of_curve
from analysis.diagnosis.fit.responses import Linearisation
from analysis.diagnosis.fit.selection_state import DRIVEN_WAVES
from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect
from rigs.schema.effect import name_of, size_of

_FAULTS = 2.0
"""Expected number of faults of an arm sent for diagnosis, before any measurement. Chosen: between a single fault and
the 9 to 14 of an arm that was never calibrated.
"""
HEALTHY_PRICE = 6.0
"""Log evidence that a single form at healthy size must gain to be fitted. Chosen: a smaller gain changes no verdict."""
_OF_SET_UP = 0.01
"""Share of a column that remains after a set-up is fitted, below which the column is a term of the set-up.

Chosen: next to a soft joint the last length, which determines the torque, leaves 0.002. Columns of other terms leave
0.6 and more.
"""


@dataclass(frozen=True)
class EffectPrices:
    """Prior odds of the effects of a linearisation, by size, form and name."""

    linear: Linearisation
    columns: Columns

    @cached_property
    def fault_price(self) -> float:
        """Prior log odds that a named effect is a fault of the arm."""
        return float(np.log(_FAULTS / max(len(self.columns.among), 1)))

    @cached_property
    def log_choices(self) -> Array:
        """Logarithm (n,), a pure number, of the inverse likelihood of each form among the forms of the effect."""
        return np.asarray(-np.log(self.columns.likelihoods), dtype=float)

    @cached_property
    def shows_curves(self) -> bool:
        """True if the readings show curves of joints but no single waves of a healthy joint.

        Poses cover long sections of the error of a joint over its angle, and no wave of a healthy joint is dominant.
        For a UR10, 22 waves selected singly took nine tenths of the time and left the same residual as no wave.
        """
        return not any(block.sampling for block in self.linear.blocks)

    def is_of_curve(self, effect: Effect) -> bool:
        """Return whether an effect is a wave of a joint's curve, unless it is a fault."""
        return self.shows_curves and is_of_curve(effect)

    def nearest_form(self, effect: Effect) -> int | None:
        """Return the index of the form of an effect, for waves the form of the nearest order; None if the effect has
        no form.
        """
        indices, orders = self._forms_of_name.get(name_of(effect), ([], np.empty(0)))
        if not indices:
            return None
        return indices[int(np.argmin(np.nan_to_num(np.abs(orders - order_of(effect)))))]

    @cached_property
    def _forms_of_name(self) -> dict[str, tuple[list[int], Array]]:
        """Indices of the forms of each name, and their orders (n,), NaN for effects that are no waves."""
        indices: dict[str, list[int]] = {}
        for k, form in enumerate(self.columns.forms):
            indices.setdefault(form.name, []).append(k)
        orders = np.array([order_of(form.effect) for form in self.columns.forms])
        return {name: (of_name, orders[of_name]) for name, of_name in indices.items()}

    def choice_cost(self, effect: Effect) -> float:
        """Return the log evidence required for choosing an effect among several possible forms.

        Waves are as likely as in the background: each octave of orders is equally likely. If all 125 orders were
        equally likely, order 2 would require 2.6 more, and a form error of the ball then replaced a gear error of the
        driving axis.
        """
        nearest = self.nearest_form(effect) if np.isfinite(order_of(effect)) else None
        if nearest is not None:
            return float(self.log_choices[nearest])
        return float(np.log(self.columns.among.get(name_of(effect), 1)))

    def price(self, effect: Effect, level: Level) -> float:
        """Return the log prior probability of an effect with its size and form, relative to the wide prior used in
        the fit.
        """
        size, of_it, healthy = size_of(effect), level.of(effect), -np.inf
        if not self.is_of_curve(effect):
            healthy = -HEALTHY_PRICE - 0.5 * (size / of_it) ** 2 - np.log(of_it)
        odds = float(self._size_odds(size, of_it, healthy))
        return odds - self.choice_cost(effect) - self.stated_penalty(effect)

    def usual_gain(self, effect: Effect, level: Level) -> float:
        """Return the log odds that offset the penalty of an effect, because the effect may be one of usual size."""
        return float(self.usual_gains([effect], np.array([size_of(effect)]), level)[0])

    def usual_gains(self, effects: Sequence[Effect], size: Array, level: Level) -> Array:
        """Return the log odds (n,) that offset the penalties of effects with given sizes (n,), in healthy sizes.

        Every arm has a usual amount of every effect. It is therefore no evidence against an effect that a search
        ignores it below a given gain, or that the arm shows little of most other effects.
        """
        reference = self.linear.blocks[0].model.rig.reference
        levels = np.array([level.of(effect) for effect in effects])
        usual = np.maximum(levels, [effect.usual_times(reference) for effect in effects])
        healthy = -HEALTHY_PRICE - 0.5 * (size / levels) ** 2 - np.log(levels)
        as_usual, gains = -0.5 * (size / usual) ** 2 - np.log(usual), np.zeros(len(effects))
        for of_these in np.unique(levels).tolist():
            k = levels == of_these
            gains[k] = self._size_odds(size[k], of_these, as_usual[k]) - self._size_odds(size[k], of_these, healthy[k])
        return np.where([self.is_of_curve(effect) for effect in effects], 0.0, gains)

    def _size_odds(self, size: Array | float, level: float, healthy: Array | float) -> Array:
        """Return the prior log odds (n,) of sizes (n,), in healthy sizes, relative to the wide prior of the fit.

        A size belongs to a fault, or with the log odds `healthy` (n,) to an effect present in every arm.
        """
        sizes, each = fault_sizes(level), np.asarray(size, dtype=float)[..., None]
        fault = self.fault_price + np.log(np.mean(np.exp(-0.5 * (each / sizes) ** 2) / sizes, axis=-1) + 1e-300)
        wide = -0.5 * (np.asarray(size) / LARGEST_FAULT) ** 2 - np.log(LARGEST_FAULT)
        return np.asarray(np.logaddexp(fault, healthy) - wide, dtype=float)

    def stated_penalty(self, effect: Effect) -> float:
        """Return the log evidence that readings must provide for shapes of an effect that differ from the rig file.
        With unknown link masses, a soft joint and a heavy load look the same.
        """
        free = effect.free(self.linear.payload_kg)
        off = [abs(getattr(effect, one.field) - one.expected) > SURE_SIGMA * one.spread for one in free if one.stated]
        return HEALTHY_PRICE * float(sum(off))

    @cached_property
    def waves_of_curves(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Masks (n,) of the forms that are waves of a joint's curve, and of forms of such low order that the joint
        was driven over few waves in any run.
        """
        effects = [form.effect for form in self.columns.forms]
        turned = np.max([block.turns for block in self.linear.blocks], axis=0)
        driven = [
            order_of(effect) * float(turned[getattr(effect, "axis", 1) - 1]) if is_of_curve(effect) else np.inf
            for effect in effects
        ]
        return np.array([self.is_of_curve(effect) for effect in effects], dtype=bool), np.array(driven) < DRIVEN_WAVES

    @cached_property
    def thresholds(self) -> Array:
        """Log evidence (n,) that a form must gain in addition to the penalty.

        It is infinite if a set-up of poses or touches has the same effect, as the last length is a length of the tool.
        It is lower along directions that are hardly visible.
        """
        against = np.array([self.stated_penalty(form.effect) for form in self.columns.forms], dtype=float)
        if self.shows_curves:
            columns = self.columns.X[:, : self.columns.set_ups.start]
            remaining = np.linalg.norm(self.linear.without_set_up(columns), axis=0)
            is_absorbed = remaining < _OF_SET_UP * np.linalg.norm(columns, axis=0)
            against[[bool(is_absorbed[list(form.columns)].all()) for form in self.columns.forms]] = np.inf
        return against

"""Which names explain the readings: names, a healthy arm's gears and what no effect explains compete by evidence.

What is left in a band of orders, or at targets, beyond the noise has a strength of its own, found anew each round: a
free form that every name has to beat. Each round the better of two is added: a form as a fault, or a form as the one
gear (or spike) that a healthy arm shows of its name. Names that no longer pay are dropped; sizes and shapes of names
are fitted on the simulator before the next is looked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from analysis.diagnose.background import Background, Posterior, gain_over_healthy
from analysis.diagnose.columns import LARGEST, Columns, Form
from analysis.diagnose.linear import Linear
from analysis.diagnose.noise import LEAST_ASSUMED
from analysis.diagnose.refine import Refined, refine
from analysis.kinematics.arm import Array
from rigs.effect import PHASE, name_of
from rigs.effects import Effect, healthy_size, size_field

_FAULTS = 2.0
"""Names that an arm which somebody diagnoses may have, before anything is measured."""
_DEPTH = 24
"""Most names: real arms that nobody calibrated have 9 to 14."""
_ROUNDS = 30
"""Names and forms looked for in a row, most."""
_PICK_PRICE = 3.0
"""Log evidence that a healthy arm's single form must win: less changes no verdict."""
_BAND_PRICE, _TARGET_PRICE = 3.0, 8.0
"""Log evidence that a strength of its own must win in a band of orders, and at targets, where tails are heavy."""
_TAIL = 4.0
"""Degrees of freedom of readings at targets, as robust weights have it."""
_LEVELS = np.geomspace(0.003, 8.0, 80)
"""Levels of a background that are tried."""
_LEVEL_TAIL = 4.0
_LEVEL_SPREAD = 1.4
"""Of the logarithm of a level about that of a healthy arm: a factor of four either way."""
_NEAR_ORDER = 1.15
"""Orders of one gear nearer than this are one wave."""
_SETTLING = 2
_BETWEEN = np.linspace(-0.6, 0.6, 9)
"""Orders that are tried about the one of a form, in distances to its neighbour."""
_SEEN = 4.0
"""Sigmas at which the largest fault would be named at all."""


@dataclass(frozen=True)
class State:
    """What is taken to be there. refined: names, fitted; picks: forms that a healthy arm shows alone of their name;
    level of the background, and the most that it may be; strength (b,) of what is left in each band, over noise;
    robust (N,): weights of readings; refused: names that did not pay."""

    refined: Refined
    picks: frozenset[int] = frozenset()
    level: float = 1.0
    strength: Array = field(default_factory=lambda: np.ones(0))
    robust: Array = field(default_factory=lambda: np.ones(0))
    refused: frozenset[str] = frozenset()
    most: float = 1.0


class Naming:
    """Names for what one linearisation leaves."""

    def __init__(self, linear: Linear, columns: Columns) -> None:
        self.linear, self.columns = linear, columns
        self.prior = float(np.log(_FAULTS / max(len(columns.among), 1)))
        self._among = np.log([form.among for form in columns.forms])
        assumed = np.concatenate([np.full(len(b.y_mm), not b.measured) for b in linear.blocks])
        self._least = np.where(np.bincount(columns.band, assumed) > 0, LEAST_ASSUMED, 1.0)
        targets = np.concatenate([np.full(len(b.y_mm), b.sampling is None) for b in linear.blocks])
        self._targets = targets
        self._band_price = np.where(np.bincount(columns.band, targets) > 0, _TARGET_PRICE, _BAND_PRICE)

    def explained(self, effects: Sequence[Effect] = ()) -> tuple[State, Posterior]:
        """The names that pay, beginning with some."""
        ones = np.ones(len(self.columns.count))
        state = State(self._empty(), strength=ones, robust=np.ones(len(self.linear.y)))
        state = replace(state, refined=refine(self.linear, self.background(state), effects))
        state = self._settled(self._settled(state)[0])[0]
        # Faults not named yet look like an arm that shows more of everything: names come first, then the level.
        for most in (1.0, _LEVELS[-1]):
            state = replace(state, most=most)
            for _ in range(_ROUNDS):
                state, posterior = self._settled(state)
                changed = self._dropped(state, posterior) or self._grown(state, posterior)
                if changed is None:
                    break
                state = changed
        return self._settled(self.fitted(state, state.refined.effects))

    def not_testable(self, state: State, posterior: Posterior) -> tuple[str, ...]:
        """Names that these tests would not show at the size of a large fault, beside all that may be there anyway."""
        sigma = posterior.gains(self.columns.forms, state.level)[2]
        named = {name_of(effect) for effect in state.refined.effects}
        seen = {form.name for form, one in zip(self.columns.forms, sigma, strict=True) if LARGEST * one > _SEEN}
        hidden = dict.fromkeys([*self.columns.not_seen, *(form.name for form in self.columns.forms)])
        return tuple(name for name in hidden if name not in seen | named)

    def _empty(self) -> Refined:
        none = np.empty((len(self.linear.y), 0))
        return Refined((), (), np.empty(0), np.empty((0, 0)), self.linear.y, none, none)

    def background(self, state: State) -> Background:
        """All that is not named, in a state."""
        columns = self.columns
        variance = columns.variance(state.level)
        for k in state.picks:
            form = columns.forms[k]
            variance[list(form.columns)] = state.level**2 / len(form.columns)
        for form in columns.forms:
            if any(is_same(form, effect) for effect in state.refined.effects):
                variance[list(form.columns)] = 0.0
        return Background(columns, state.robust / state.strength[columns.band], variance)

    def _settled(self, state: State) -> tuple[State, Posterior]:
        """Level, strengths and robust weights as likely as what is taken to be there makes them."""
        for _ in range(_SETTLING):
            posterior = self.background(state).posterior(state.refined.known)
            state = replace(
                state, level=self._level(state, posterior), strength=self._strength(state, posterior),
                robust=self._robust(posterior),
            )  # fmt: skip
        return state, self.background(state).posterior(state.refined.known)

    def _level(self, state: State, posterior: Posterior) -> float:
        """Of the background: the mean square of what each name shows over what it could show in an arm at level one.

        A name counts once however many forms it has, since a gear shows in a few of its orders; a fault not yet named
        has little weight."""
        columns, variance = self.columns, posterior.background.variance
        cols = np.flatnonzero(columns.healthy > 0)
        there = variance[cols] > 0
        cols = cols[there]
        names = columns.name_of_column[cols]
        expected = columns.healthy[cols]
        freedom = np.clip(1 - np.diag(posterior.A)[cols] / variance[cols], 0.0, 1.0)
        squares = np.asarray(np.bincount(names, posterior.mean[cols] ** 2), dtype=float)
        whole, seen = np.bincount(names, expected), np.bincount(names, expected * freedom)
        weight = (_LEVEL_TAIL + 1) / (_LEVEL_TAIL + squares / np.maximum(seen, 1e-3) / state.level**2)
        share = seen / np.maximum(whole, 1e-9)
        squares = squares / np.maximum(whole, 1e-9)
        likely = -share.sum() * np.log(_LEVELS) - float(weight @ squares) / (2 * _LEVELS**2)
        likely -= np.log(_LEVELS) ** 2 / (2 * _LEVEL_SPREAD**2)
        return float(min(_LEVELS[np.argmax(likely)], state.most))

    def _robust(self, posterior: Posterior) -> Array:
        """Weights (N,) of readings: at targets as Student's law has them, elsewhere 1."""
        weight, targets = np.ones(len(self._targets)), self._targets
        if targets.any():
            left = posterior.left[targets]
            scale = max(1.0, 1.4826 * float(np.median(np.abs(left))))
            weight[targets] = np.minimum(1.0, (_TAIL + 1) / (_TAIL + (left / scale) ** 2))
        return weight

    def _energy(self, state: State, posterior: Posterior) -> tuple[Array, Array]:
        """By band: energy that is left, robust, and how many readings are free to leave it."""
        columns = self.columns
        raw = posterior.background.weight * state.strength[columns.band] * posterior.left**2
        energy = np.asarray(np.bincount(columns.band, raw), dtype=float)
        spent = np.einsum("bij,ji->b", columns.K, posterior.A) / state.strength
        return energy, np.maximum(columns.count - spent, 0.25 * columns.count)

    def _strength(self, state: State, posterior: Posterior) -> Array:
        """Of each band: as much as is left, where that is more than noise by more than its price. Noise that is
        assumed, and so wide, may be less."""
        energy, free = self._energy(state, posterior)
        ratio = np.maximum(energy / free, 1e-9)
        gain = 0.5 * free * (ratio - 1 - np.log(ratio)) - self._band_price
        return np.where((ratio > 1) & (gain > 0), ratio, np.clip(ratio, self._least, 1.0))

    def _dropped(self, state: State, posterior: Posterior) -> State | None:
        """Without the name that pays least, if one does not pay."""
        gains = [self.gain_of(state, posterior, k) for k in range(len(state.refined.effects))]
        if not gains or min(gains) >= 0:
            return None
        place = int(np.argmin(gains))
        refused = state.refused | {name_of(state.refined.effects[place])}
        return replace(self.without(state, place), refused=refused)

    def gain_of(self, state: State, posterior: Posterior, place: int) -> float:
        """Log evidence for a name over its healthy share, by the cavity of its size, prices paid."""
        refined = state.refined
        effect = refined.effects[place]
        row = next(k for k, u in enumerate(refined.unknowns) if u.effect == place)
        healthy, variance = healthy_size(effect), posterior.known_covariance[row, row]
        precision = max(1 / variance - refined.unknowns[row].spread ** -2, 0.0) * healthy**2
        eta = (refined.values[row] + posterior.known[row]) / variance * healthy
        return gain_over_healthy(precision, eta, state.level) + self.price(effect)

    def price(self, effect: Effect) -> float:
        """Log odds of a name beforehand, and of its form among its forms."""
        return self.prior - float(np.log(self.columns.among[name_of(effect)] or 1))

    def without(self, state: State, place: int) -> State:
        """Without one name, the others fitted again."""
        effects = state.refined.effects
        return self.fitted(state, [*effects[:place], *effects[place + 1 :]])

    def gains(self, state: State, posterior: Posterior) -> tuple[Array, Array]:
        """Log odds (n,) of each form as a fault over a healthy arm, which may show all of its name in this one form,
        and of that over an even share."""
        forms = self.columns.forms
        fault, pick, _ = posterior.gains(forms, state.level)
        pick = np.where(self._among > 0, pick - self._among - _PICK_PRICE, -np.inf)
        pick[list(state.picks)] = -np.inf
        fault = fault + self.prior - self._among - np.maximum(pick, 0.0)
        return fault, pick

    def _grown(self, state: State, posterior: Posterior) -> State | None:
        """With the better of a name and of a healthy arm's single form, if one pays."""
        forms = self.columns.forms
        fault, pick = self.gains(state, posterior)
        fault[[form.name in state.refused for form in forms]] = -np.inf
        if len(state.refined.effects) >= _DEPTH:
            fault[:] = -np.inf
        best = max(float(fault.max()), float(pick.max()))
        if best <= 0:
            return None
        if float(fault.max()) < best:
            k = int(np.argmax(pick))
            self._tune(state, posterior, k)
            return replace(state, picks=state.picks | {k})
        k = int(np.argmax(fault))
        self._tune(state, posterior, k)
        form = self.columns.forms[k]
        return self.fitted(state, (*state.refined.effects, started(form, posterior.size(form))))

    def _tune(self, state: State, posterior: Posterior, k: int) -> None:
        """Give a wave the order, between those of its neighbours, that explains most."""
        form, columns = self.columns.forms[k], self.columns
        effect: Any = form.effects[0]
        if not hasattr(effect, "order"):
            return
        orders = np.array([getattr(one.effects[0], "order", np.nan) for one in columns.forms if one.name == form.name])
        nearest = float(np.sort(np.abs(orders - effect.order))[1]) if len(orders) > 1 else 0.0
        tried = effect.order + nearest * _BETWEEN
        effects = [one.model_copy(update={"order": float(order)}) for order in tried for one in form.effects]
        waves = self.linear.columns(effects) / form.size
        pairs = [waves[:, 2 * i : 2 * i + 2] for i in range(len(tried))]
        best = int(np.argmax([posterior.gain_of_columns(pair, state.level) for pair in pairs]))
        self.columns = columns.tuned(k, tuple(effects[2 * best : 2 * best + 2]), pairs[best])

    def fitted(self, state: State, effects: Sequence[Effect]) -> State:
        """With some names, fitted together."""
        picks = frozenset(
            k for k in state.picks if not any(is_same(self.columns.forms[k], effect) for effect in effects)
        )
        bare = replace(state, picks=picks, refined=replace(self._empty(), effects=tuple(effects)))
        return replace(bare, refined=refine(self.linear, self.background(bare), effects))


def started(form: Form, size: Array) -> Effect:
    """A form as an effect of a size given by its coefficients, in healthy sizes."""
    effect = form.effects[0]
    field_name, healthy = size_field(effect), healthy_size(effect)
    if len(size) == 2:
        phase = float(np.degrees(np.arctan2(size[1], size[0])))
        return effect.model_copy(update={field_name: float(np.hypot(*size)) * healthy, PHASE: phase})
    return effect.model_copy(update={field_name: float(size[0]) * healthy})


def is_same(form: Form, effect: Effect) -> bool:
    """Whether a form is another way of the same name to show; waves of other orders are not."""
    return is_alike(form.effects[0], effect)


def is_alike(one: Effect, effect: Effect) -> bool:
    """Whether two effects are the same name in other sizes and shapes; waves of other orders are not."""
    if name_of(one) != name_of(effect):
        return False
    order, other = getattr(one, "order", None), getattr(effect, "order", None)
    return order is None or other is None or max(order, other) / min(order, other) < _NEAR_ORDER

"""Which effects explain the readings: faults, what a healthy arm shows, and what has no name compete by evidence.

What is left in a band of orders, or at targets, beyond the noise has a strength of its own, found anew each round: a
free form that every effect has to beat. Each round the form that explains most is added as an effect, its size and
shape fitted on the simulator before the next is looked for, for what a wrong shape leaves would draw wrong names. A
healthy arm's play or gear that shows is fitted like a fault: which of the two an effect is, its size says. Effects that
no longer pay are dropped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from analysis.diagnosis.background import Background, Posterior, cavity_evidence, fault_evidence, fault_sizes
from analysis.diagnosis.columns import LARGEST, Columns, Form
from analysis.diagnosis.freeforms import FREE_PRICE, free_forms, strangest
from analysis.diagnosis.linear import Linear
from analysis.diagnosis.refine import nothing, refine
from analysis.diagnosis.state import State, is_same, order_of, size_of, started
from analysis.diagnosis.surroundings import MOST_LEVEL, Surroundings
from analysis.kinematics.arm import Array
from rigs.effects import Effect, healthy_size
from rigs.schema.effect import is_play, name_of, scaled

_FAULTS = 2.0
"""Faults that an arm which somebody diagnoses may have, before anything is measured."""
_DEPTH = 40
"""Most effects that are fitted: real arms that nobody calibrated have 9 to 14 faults, and as many healthy ones show."""
_ROUNDS = 40
"""Effects looked for in a row, most."""
_HEALTHY_PRICE = 6.0
"""Log evidence that a healthy arm's single form must win to be fitted: less changes no verdict."""
_BETWEEN = np.linspace(-0.6, 0.6, 9)
"""Orders that are tried about the one of a form, in distances to its neighbour."""
_SEEN = 4.0
"""Sigmas at which the largest fault would be named at all."""
_SURE = 5.0
"""Log evidence by its cavity from which on an effect is not tried to be left out."""
_MUCH = 50.0
"""Log evidence of an effect that must beat what has no name, and beside which the others are fitted again before the
next is looked for."""
_MARGIN = 1.2
"""By which what has no name must explain more than the best name: names in a first fit are not at their best."""
_KEPT = 12
"""Backgrounds that are kept, of some 8 MB each: about as many as a round of a search returns to."""
_TRIED, _CLOSE = 3, 0.5
"""Names that are fitted before one is added, most, and the share of the best one's gain that the others must have."""
_PLAY_STARTS = (0.5, 1.0, 1.9)
"""Widths, in those that a linear fit finds, from which the width of a play is fitted."""


class Naming:
    """Effects for what one linearisation leaves."""

    def __init__(self, linear: Linear, columns: Columns) -> None:
        self.linear, self.columns = linear, columns
        self._fault_price = float(np.log(_FAULTS / max(len(columns.among), 1)))
        self._among = np.log([form.among for form in columns.forms])
        self._surroundings = Surroundings(linear, columns)
        self._backgrounds: dict[tuple[bytes, bytes], Background] = {}
        # Over targets alone a free form follows the scatter: on poses of a UR10 it took the place of names, and what it
        # explained was no part of the model (0.317 mm left of poses held out, 0.141 with names alone).
        self._free = tuple(free_forms(linear)) if any(block.sampling for block in linear.blocks) else ()

    def begun(self, effects: Sequence[Effect] = ()) -> State:
        """Some effects, fitted, in an arm of healthy level and noise as it was found."""
        strength, robust = np.ones(len(self.columns.count)), np.ones(len(self.linear.y))
        bare = State(replace(nothing(self.linear), effects=tuple(effects)), (-1,) * len(effects), 1.0, strength, robust)
        state = replace(bare, refined=refine(self.linear, self.background(bare), effects))
        for _ in range(2):
            state = self._settled(state, self.posterior(state))
        return state

    def explained(self, state: State) -> State:
        """With the effects that pay, and without those that do not; where a form without a name did better than the
        best name, what comes of that is tried too, and the likelier of the two stands."""
        named, strange = self._searched(state, strange=False)
        if strange is None:
            return named
        return max((named, self._searched(strange, strange=True)[0]), key=self.evidence)

    def _searched(self, state: State, *, strange: bool) -> tuple[State, State | None]:
        """A search, and the first state in which something without a name did better than the best name, if any;
        strange: whether that is taken then."""
        doubted = None
        # Faults not named yet look like an arm that shows more of everything: names come first, then the level.
        for most in (1.0, MOST_LEVEL):
            state = replace(state, most=most)
            for _ in range(_ROUNDS):
                posterior = self.posterior(state)
                state = self._settled(state, posterior)
                changed = self._dropped(state, posterior, 0.0)
                if changed is None and (more := self._grown(state, posterior)):
                    changed, unnamed = more
                    doubted = doubted or unnamed
                    changed = unnamed if strange and unnamed else changed
                changed = changed or self._dropped(state, posterior, _SURE) or self._freed(state)
                if changed is None:
                    break
                state = changed
        state = self._fitted_again(state)
        return self._settled(state, self.posterior(state)), doubted

    def posterior(self, state: State) -> Posterior:
        """Of everything, in a state."""
        return self.background(state).posterior(state.refined.known)

    def not_testable(self, state: State, posterior: Posterior) -> tuple[str, ...]:
        """Names that these tests would not show at the size of a large fault, beside all that may be there anyway."""
        sigma = posterior.gains(self.columns.forms, state.level)[2]
        named = {name_of(effect) for effect in state.refined.effects}
        seen = {form.name for form, one in zip(self.columns.forms, sigma, strict=True) if LARGEST * one > _SEEN}
        hidden = dict.fromkeys([*self.columns.not_seen, *(form.name for form in self.columns.forms)])
        return tuple(name for name in hidden if name not in seen | named)

    def background(self, state: State) -> Background:
        """All that is not fitted as an effect, in a state. The last few are kept: states that differ in what is fitted
        of the same names share one."""
        columns = self.columns
        variance = columns.variance(state.level)
        fitted: dict[str, list[Effect]] = {}
        for effect in state.refined.effects:
            fitted.setdefault(name_of(effect), []).append(effect)
        for form in columns.forms:
            if any(is_same(form, effect) for effect in fitted.get(form.name, ())):
                variance[list(form.columns)] = 0.0
        weight = state.robust / state.strength[columns.band]
        key = (weight.tobytes(), variance.tobytes())
        if key in self._backgrounds:
            self._backgrounds[key] = self._backgrounds.pop(key)
        else:
            self._backgrounds[key] = Background(columns, weight, variance)
            if len(self._backgrounds) > _KEPT:
                del self._backgrounds[next(iter(self._backgrounds))]
        return self._backgrounds[key]

    def _settled(self, state: State, posterior: Posterior) -> State:
        """Strengths, robust weights and level that make what is taken to be there likelier.

        Each is estimated with the others as they were, so that an estimate may go too far: then a shorter step is
        tried, and where that does not help either, nothing changes.
        """
        around = self._surroundings
        whole, robust = self.evidence(state), around.robust(posterior)
        for estimate in (around.strength, around.nearer_strength):
            tried = replace(state, strength=estimate(state, posterior), robust=robust)
            if (own := self.evidence(tried)) > whole:
                state, whole = tried, own
                break
        level = around.level(state, posterior)
        for nearer in (level, float(np.sqrt(level * state.level))):
            tried = replace(state, level=nearer)
            if nearer != state.level and self.evidence(tried) > whole:
                return tried
        return state

    def _dropped(self, state: State, posterior: Posterior, sure: float) -> State | None:
        """Without the effect that pays least, if one does not pay; those whose cavity gains more than `sure` do."""
        doubtful = [k for k in range(len(state.refined.effects)) if self.gain_of(state, posterior, k) < sure]
        if not doubtful:
            return None
        whole = self.evidence(state)
        gains = {k: whole - self.evidence(self._lacking(state, k)) for k in doubtful}
        place = min(gains, key=lambda k: gains[k])
        rest = self.without(state, place)
        if whole >= self.evidence(rest):
            return None
        return self._refusing(rest, state.refined.effects[place], state.origins[place])

    def _refusing(self, state: State, effect: Effect, origin: int = -1) -> State:
        """With all forms of an effect, and the one it came from, among those that did not pay."""
        own = {k for k, form in enumerate(self.columns.forms) if is_same(form, effect)} | {origin}
        return replace(state, refused=state.refused | own)

    def _freed(self, state: State) -> State | None:
        """Without what had no name, where the best name in its place, or nothing, explains as much."""
        whole = self.evidence(state) if state.strangers else 0.0
        for k in range(len(state.strangers)):
            kept = (*state.strangers[:k], *state.strangers[k + 1 :])
            rest = self._fitted_again(replace(state, strangers=kept))
            posterior = self.posterior(rest)
            best = int(np.argmax(np.maximum(*self.gains(rest, posterior))))
            for tried in (rest, self._fitted_again(self.grown(rest, posterior, best))):
                if self.evidence(tried) > whole:
                    return replace(tried, freed=state.freed | {state.strangers[k].form.words})
        return None

    def gain_of(self, state: State, posterior: Posterior, place: int) -> float:
        """Log evidence, about, for an effect over an even share of a healthy arm, by the cavity of its size."""
        refined = state.refined
        effect = refined.effects[place]
        row = next(k for k, u in enumerate(refined.unknowns) if u.effect == place)
        healthy, variance = healthy_size(effect), posterior.known_covariance[row, row]
        values = np.array([max(1 / variance - refined.unknowns[row].spread ** -2, 0.0) * healthy**2])
        seen = np.array([((refined.values[row] + posterior.known[row]) / variance * healthy) ** 2])
        among = self.columns.among[name_of(effect)] or 1
        share = cavity_evidence(values, seen, state.level**2 / among)
        fault = fault_evidence(values, seen, state.level) - share + self._fault_price
        healthy_one = cavity_evidence(values, seen, state.level**2) - share - _HEALTHY_PRICE
        return float(max(fault, healthy_one)) - float(np.log(among))

    def price(self, effect: Effect, level: float) -> float:
        """Log odds of an effect of its size and form beforehand, over those of the fit's wide prior."""
        size, sizes = size_of(effect), fault_sizes(level)
        fault = self._fault_price + np.log(np.mean(np.exp(-0.5 * (size / sizes) ** 2) / sizes) + 1e-300)
        healthy_one = -_HEALTHY_PRICE - 0.5 * (size / level) ** 2 - np.log(level)
        wide = -0.5 * (size / LARGEST) ** 2 - np.log(LARGEST)
        return float(np.logaddexp(fault, healthy_one) - wide - np.log(self.columns.among[name_of(effect)] or 1))

    def evidence(self, state: State) -> float:
        """Log evidence of what is taken to be there, but for a constant."""
        own = self.background(state).evidence(state.refined.known)
        prices = sum(self.price(effect, state.level) for effect in state.refined.effects)
        return own + prices - FREE_PRICE * len(state.strangers)

    def without(self, state: State, place: int) -> State:
        """Without one effect, the others moved into its place as far as they can."""
        bare = self._lacking(state, place)
        return replace(bare, refined=refine(self.linear, self.background(bare), bare.refined.effects, bare.refined))

    def _lacking(self, state: State, place: int) -> State:
        """Without one effect, the others as they were: the posterior moves them, along straight lines."""
        kept = state.refined.without(place)
        origins = (*state.origins[:place], *state.origins[place + 1 :])
        return replace(state, refined=replace(kept, left=self.linear.left(kept.effects)), origins=origins)

    def gains(self, state: State, posterior: Posterior) -> tuple[Array, Array]:
        """Log odds (n,) of each form as a fault, and as what a healthy arm shows of its name, over an even share."""
        fault, alone, _ = posterior.gains(self.columns.forms, state.level)
        return fault + self._fault_price - self._among, alone - _HEALTHY_PRICE - self._among

    def _grown(self, state: State, posterior: Posterior) -> tuple[State, State | None] | None:
        """With the effect that explains most, if one pays; and, where a form without a name does better, with that."""
        gain = np.maximum(*self.gains(state, posterior))
        gain[[k for k in state.refused if k >= 0]] = -np.inf
        best = self._best_names(gain)
        if not best or len(state.refined.effects) >= _DEPTH:
            return None
        # A straight line may do less, or more, than the shape that is fitted on the simulator.
        tried = [self.grown(state, posterior, k) for k in best]
        whole = self.evidence(state)
        changed = max(tried, key=self.evidence)
        most = float(gain[best[0]])
        if most < _MUCH:
            if self.evidence(changed) > whole:
                return changed, None
            for k in best:
                state = self._refusing(state, self.columns.forms[k].effects[0])
            return self._grown(state, posterior)
        known = state.freed | {one.form.words for one in state.strangers}
        forms = [form for form in self._free if form.words not in known]
        if not forms:
            return self._fitted_again(changed), None
        stranger = strangest(forms, posterior)
        # A fit may do worse than its straight line where it moves the set-up far; the next look begins there.
        named = max(most, self.evidence(changed) - whole)
        changed = self._fitted_again(changed)
        if stranger.gain < _MARGIN * named:
            return changed, None
        return changed, self._fitted_again(replace(state, strangers=(*state.strangers, stranger)))

    def _best_names(self, gain: Array) -> list[int]:
        """Forms, best first, that gain most of each of a few names, by the gain (n,) of each form."""
        best: dict[str, int] = {}
        for k in np.argsort(-gain).tolist():
            if not gain[k] > max(_CLOSE * gain.max(), 0.0) or len(best) == _TRIED:
                break
            best.setdefault(self.columns.forms[k].name, k)
        return list(best.values())

    def grown(self, state: State, posterior: Posterior, k: int) -> State:
        """With a form as an effect, fitted; the others move along the tangents that they had."""
        effect = self._tuned(state, posterior, self.columns.forms[k])
        # What a play does to a joint that turns back is not proportional to it: a fit may end in the wrong place.
        sizes = _PLAY_STARTS if is_play(effect) else (1.0,)
        tried = [self._beside(state, scaled(effect, size), k) for size in sizes]
        return tried[0] if len(tried) == 1 else max(tried, key=self.evidence)

    def _beside(self, state: State, effect: Effect, k: int) -> State:
        """With one more effect, which comes from a form, fitted."""
        effects = (*state.refined.effects, effect)
        bare = replace(state, refined=replace(state.refined, effects=effects), origins=(*state.origins, k))
        return replace(bare, refined=refine(self.linear, self.background(bare), effects, state.refined))

    def _tuned(self, state: State, posterior: Posterior, form: Form) -> Effect:
        """A form of the size that it would have as a fault; a wave of the order, between those of its neighbours, that
        explains most."""
        effect: Any = form.effects[0]
        if not hasattr(effect, "order"):
            return started(form.effects, posterior.size(form))
        near = [abs(order_of(one.effects[0]) - effect.order) for one in self.columns.forms if one.name == form.name]
        tried = effect.order + (sorted(near)[1] if len(near) > 1 else 0.0) * _BETWEEN
        tried = tried[tried >= min(effect.order, max(one.low for one in effect.STRETCHED))]
        effects = [one.model_copy(update={"order": float(order)}) for order in tried for one in form.effects]
        precision, eta = posterior.cavity(self.linear.columns(effects) / form.size)
        pairs = [slice(2 * i, 2 * i + 2) for i in range(len(tried))]
        sizes = [np.linalg.solve(precision[own, own] + np.eye(2) / LARGEST**2, eta[own]) for own in pairs]
        best = int(np.argmax([size @ eta[own] for size, own in zip(sizes, pairs, strict=True)]))
        return started(effects[pairs[best]], np.asarray(sizes[best], dtype=float))

    def _fitted_again(self, state: State) -> State:
        """All effects fitted together."""
        free = np.concatenate(
            [np.empty((len(self.linear.y), 0)), *(one.form.columns for one in state.strangers)], axis=1
        )
        refined = refine(self.linear, self.background(state), state.refined.effects, free=free)
        return replace(state, refined=refined)

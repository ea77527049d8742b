"""Steps of a selection: a state with an effect added, removed or fitted again, and the noise estimated again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.fit.background import CoefficientPosterior
from analysis.diagnosis.fit.refine import FIT_ROUNDS, refine
from analysis.diagnosis.fit.responses import Response
from analysis.diagnosis.fit.selection_state import (
    SelectionState,
    is_alike,
    is_duplicate,
    settled,
)
from analysis.diagnosis.fit.starting_effects import starting_effects
from analysis.diagnosis.fit.state_evidence import StateEvidence
from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect
from rigs.schema.effect import is_wave

_DEPTH = 40
"""Largest number of fitted effects: real arms that were never calibrated have 9 to 14 faults, and as many visible
healthy effects."""
_MUCH = 50.0
"""Log evidence from which an unknown cause competes with names. Chosen: foreign effects leave 50 to 500, and effects of
the library mostly less than 8."""
_MARGIN = 1.2
"""Factor by which an unknown cause must explain more than the best name, whose first fit is not optimal. Chosen."""
_UNEXPLAINED, _ENOUGH_FROM_NOISE = 4.0, 5.0
"""Strength of a band, relative to the noise, from which effects are tried in its place, and the log evidence that they
must gain. Chosen: twice the noise, and odds of 150 to 1.
"""
_TRIED, _CLOSE = 3, 0.5
"""Largest number of names fitted before a name is added, and the share of the largest gain that the others must
have. Chosen: each fit costs a fraction of a round.
"""
_BENT, _PLAIN_TO_SEE = -5.0, 10.0
"""Log evidence a form must have for its name to be fitted although no name gains much, and its significance in sigmas.

The shape tried for a form may differ too much from the true shape for a gain. A spike of an axis that fades in 0.93 s,
with 21 sigma, lost 2.5 with the shape of 1 s and gained 420 when fitted. Without this fit a lag of 0.6 ms became 33 ms.
"""
_FEW_ROUNDS = 3
"""Number of rounds of preliminary fits: fits from several starts, of which only the likeliest continues, and fits
alternating with the noise. Chosen: in a development case the first two gained nearly all that a fit gained.
"""


@dataclass(frozen=True)
class SelectionSteps(StateEvidence):
    """Steps from one state to the next: forward, backward, and settling."""

    def forward_step(
        self, state: SelectionState, posterior: CoefficientPosterior, *, try_unknown: bool
    ) -> tuple[SelectionState | None, SelectionState | None]:
        """Return the state with the effect of largest gain, if an effect covers the penalty, and the state with an
        unknown cause instead, if those are tried and any explains much more.
        """
        gain = self._gains_of_allowed(state, posterior)
        most_gain, changed, best = 0.0, None, self._worth_trying(state, posterior, gain)
        if best:
            # The linear prediction may gain less, or more, than the shape that is fitted on the simulator.
            with_each = {k: self.with_form(state, posterior, k) for k in best}
            if twice := frozenset(k for k, added in with_each.items() if is_duplicate(added.effects)):
                state = replace(state, refused=state.refused | twice)
                return self.forward_step(state, posterior, try_unknown=try_unknown)
            # The level remaining after each name may decide: with the right name the arm is quieter.
            # The present state is renewed too, because a new estimate of noise or level alone would look like a gain.
            renewed = self.renewed if len(with_each) > 1 else (lambda added: added)
            rise, changed = self.likeliest([renewed(added) for added in with_each.values()])
            before = renewed(state)
            rise -= self.likeliest([before, replace(before, level=changed.level)])[0]
            if gain[best[0]] < _MUCH and rise <= 0:
                for k in best:
                    state = self.refusing(state, self.columns.forms[k].effect)
                return self.forward_step(state, posterior, try_unknown=try_unknown)
            most_gain = max(float(gain[best[0]]), rise)
        taken = state.replaced | {cause.kind for cause in state.unknown}
        cause = self.causes_of_circles.likeliest(posterior, taken) if try_unknown else None
        # A fit may be worse than the linear prediction if it moves the set-up by a large amount; the next turn corrects
        # that.
        if cause is None or cause.gain < max(_MUCH, _MARGIN * most_gain):
            return changed, None
        return changed, self.refitted(replace(state, unknown=(*state.unknown, cause)))

    def _gains_of_allowed(self, state: SelectionState, posterior: CoefficientPosterior) -> Array:
        """Return the gains (n,) of the forms, minus infinity for refused forms, as log evidence."""
        gain = self.gains(state, posterior)
        gain[[k for k in state.refused if k >= 0]] = -np.inf
        return gain

    def step_from_noise(self, state: SelectionState) -> SelectionState | None:
        """Return a state in which an effect explains a residual that counted as noise, or None if none is more likely.

        If the complete residual of a band counts as noise, no effect gains any more: a local optimum. A gear error of
        3 µm under yaw was therefore reported as an unknown cause, although its evidence was 360 times larger.
        """
        if (state.strength < _UNEXPLAINED).all():
            return None
        quiet = replace(state, strength=np.minimum(state.strength, 1.0))
        posterior = self.posterior(quiet)
        gain = self._gains_of_allowed(quiet, posterior)
        added = [self.with_form(quiet, posterior, k) for k in self._worth_trying(quiet, posterior, gain)]
        settled = [self.settled(each) for each in added if not is_duplicate(each.effects)]
        if not settled:
            return None
        evidence, likeliest = self.likeliest(settled)
        explains = evidence > self.evidence(state) + _ENOUGH_FROM_NOISE and (likeliest.strength < _UNEXPLAINED).all()
        return likeliest if explains else None

    def _worth_trying(self, state: SelectionState, posterior: CoefficientPosterior, gain: Array) -> list[int]:
        """Return the best form of each of the few effects with the largest gains (n,), best first.

        If none gains much, also return the form of a clearly visible effect whose gain may be low only because of its
        shape.
        """
        forms, best_of = self.columns.forms, dict[str, int]()
        for k in np.argsort(-gain).tolist() if len(state.effects) < _DEPTH else ():
            if not gain[k] > max(_CLOSE * gain.max(), 0.0) or len(best_of) == _TRIED:
                break
            best_of.setdefault(forms[k].name, k)
        if gain.max(initial=-np.inf) < _MUCH and len(state.effects) < _DEPTH:
            shown = posterior.gains(forms, state.level)
            plain = np.flatnonzero((gain > _BENT) & (shown.size * shown.sigma > _PLAIN_TO_SEE)).tolist()
            bent = [k for k in plain if forms[k].effect.STRETCHED and not is_wave(forms[k].effect)]
            if bent:
                best = max(bent, key=lambda k: float(gain[k]))
                best_of.setdefault(forms[best].name, best)
        return list(best_of.values())

    def backward_step(
        self, state: SelectionState, posterior: CoefficientPosterior, *, below: float
    ) -> SelectionState | None:
        """Return the state with the effect of least evidence removed, if that does not cover the penalty, and None
        otherwise.

        Only effects whose cavity gains log evidence below `below` are tested.
        """
        doubtful = [k for k in range(len(state.effects)) if self.gain_of(state, posterior, k) < below]
        if not doubtful:
            return None
        whole = self.evidence(state)
        gains = {k: whole - self.evidence(self._without_refit(state, k)) for k in doubtful}
        place = min(gains, key=lambda k: gains[k])
        without = self.without(state, place)
        if whole >= self.evidence(without):
            return None
        return self.refusing(without, state.effects[place], state.origins[place])

    def without_unknown_cause(self, state: SelectionState) -> SelectionState | None:
        """Return the state with an unknown cause removed if the best name in the same role, or no effect, explains as
        much, and None otherwise.
        """
        whole = self.evidence(state) if state.unknown else 0.0
        for k, cause in enumerate(state.unknown):
            without_it = self.refitted(replace(state, unknown=(*state.unknown[:k], *state.unknown[k + 1 :])))
            posterior = self.posterior(without_it)
            best = int(np.argmax(self.gains(without_it, posterior)))
            for simpler in (without_it, self.refitted(self.with_form(without_it, posterior, best))):
                if self.evidence(simpler) > whole:
                    return replace(simpler, replaced=state.replaced | {cause.kind})
        return None

    def refusing(self, state: SelectionState, effect: Effect, origin: int = -1) -> SelectionState:
        """Return the state in which all forms of an effect, and the form of origin, are refused."""
        of_effect = {k for k, form in enumerate(self.columns.forms) if is_alike(form.effect, effect)} | {origin}
        return replace(state, refused=state.refused | of_effect)

    def with_form(self, state: SelectionState, posterior: CoefficientPosterior, k: int) -> SelectionState:
        """Return the state with form k added as an effect and fitted; the other effects move along their earlier
        tangents."""
        effects = starting_effects(self.linear, self.columns, posterior, self.columns.forms[k])
        if len(effects) > 1:
            begun = [self._with_effect(state, effect, k, begins=True) for effect in effects]
            effects = [self.likeliest(begun)[1].refined.effects[-1]]
        return self._with_effect(state, effects[0], k)

    def _with_effect(self, state: SelectionState, effect: Effect, k: int, *, begins: bool = False) -> SelectionState:
        """Return the state with an additional effect, from form k, fitted, in few rounds if `begins` is set."""
        effects, rounds = (*state.effects, effect), _FEW_ROUNDS if begins else FIT_ROUNDS
        bare = replace(state, refined=replace(state.refined, effects=effects), origins=(*state.origins, k))
        background = self.backgrounds.of(bare)
        refined = refine(self.linear, background, effects, state.refined, rounds=rounds, begins=begins)
        return replace(bare, refined=refined)

    def without(self, state: SelectionState, place: int) -> SelectionState:
        """Return the state with an effect removed and the others fitted again along their tangents."""
        bare = self._without_refit(state, place)
        return replace(bare, refined=refine(self.linear, self.backgrounds.of(bare), bare.effects, bare.refined))

    def _without_refit(self, state: SelectionState, place: int) -> SelectionState:
        """Return the state with an effect removed and the others unchanged; the posterior moves them linearly."""
        kept = state.refined.without(place)
        origins = (*state.origins[:place], *state.origins[place + 1 :])
        return replace(state, refined=replace(kept, residual=self.linear.residual(kept.effects)), origins=origins)

    def with_names_only(self, state: SelectionState) -> SelectionState:
        """Return the state without unknown causes, with the same effects and the noise reestimated."""
        none = Response(np.empty((len(self.linear.y), 0)))
        return self.renewed(replace(state, unknown=(), refined=replace(state.refined, free=none)))

    def renewed(self, state: SelectionState) -> SelectionState:
        """Return the state with strengths, robust weights and level estimated again."""
        return self.hyperparameters.update(state, self.posterior(state), self.evidence, self.posterior)

    def refitted(self, state: SelectionState, rounds: int = FIT_ROUNDS) -> SelectionState:
        """Return the state with all effects fitted together in at most this number of rounds."""
        free = np.concatenate([np.empty((len(self.linear.y), 0)), *(cause.columns for cause in state.unknown)], axis=1)
        refined = refine(self.linear, self.backgrounds.of(state), state.effects, free=free, rounds=rounds)
        return replace(state, refined=refined)

    def settled(self, *begins: SelectionState, least: float = -np.inf) -> SelectionState:
        """Return the likeliest state reached from several states by fitting all effects and the noise until the
        evidence hardly rises, or could hardly reach the log evidence `least`.
        """
        return settled(begins, lambda state: self.refitted(state, _FEW_ROUNDS), self.renewed, self.evidence, least)

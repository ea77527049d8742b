"""State of a selection: fitted effects, noise and levels, and the alternating fit of both."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from analysis.diagnosis.evidence.blocks import recent
from analysis.diagnosis.evidence.noise import LEAST_ASSUMED
from analysis.diagnosis.fit.background import Background, CoefficientPosterior, cavity_evidence
from analysis.diagnosis.fit.candidates import (
    WEIGHT_DIGITS,
    Columns,
    Level,
    order_of,
    remaining_column_shares,
)
from analysis.diagnosis.fit.joint_curves import JointCurves
from analysis.diagnosis.fit.refine import Refined
from analysis.diagnosis.fit.responses import Linearisation
from analysis.diagnosis.fit.unknown import UnknownCause
from analysis.robot.kinematics.arm import Array, Mask
from rigs.calibration import Term, effects_of, is_nothing
from rigs.effects import Effect, healthy_size, size_field
from rigs.schema.effect import PHASE, is_wave, name_of, size_of
from rigs.schema.reference import Reference

# ----------------------------------------------------------------------------------------------------------------------
# The state of a selection: the fitted effects, and the noise and healthy level of everything else.

FAULT = 5.0
"""Size in healthy sizes above which an effect is a fault: faults of real arms are 5 to 100 healthy sizes. In an arm
with a level below 1, smaller effects may be faults.
"""


def least_fault(effect: Effect, reference: Reference) -> float:
    """Return the size, in healthy sizes, above which an effect is a fault.

    It is infinite for a link constant that is compared with a data sheet: constants do not wear, and every real arm
    differs from its data sheet.
    """
    is_difference = reference.is_data_sheet and not effect.WEARS
    return math.inf if is_difference else FAULT * effect.usual_times(reference)


DRIVEN_WAVES = 2.0
"""Waves that a joint must drive before any of them is called a gear: fewer are a piece of a smooth curve."""
_NEAR_ORDER = 1.15
"""Ratio of orders of a gear below which they count as the same wave. Chosen: a lap does not separate closer orders
of a slow joint.
"""
_SAME_ORDER = 0.5
"""Difference of the orders of a gear below which they are the same wave. Chosen: most orders are integers, like
numbers of teeth.
"""
_MOST_WAVES = 6
"""Largest number of waves of a joint that are gears. A sum of waves describes any error following the angle of a
joint: a slipping joint was named as 22. Of 240 other generated cases none had more than three per joint.
"""


@dataclass(frozen=True)
class SelectionState:
    """A single state.

    `refined` contains the fitted effects and `origins` the indices of the forms of origin, -1 for none. `level` is that
    of the background and `level_cap` the upper limit. `strength` (b,) is the ratio of the variance of the residual in
    each band to that of the noise, and `robust` (N,) the weights of the entries. `refused` contains the indices of
    forms that did not cover their penalty, `unknown` the unknown causes in use and `replaced` the kinds of those
    replaced by a named effect. `curves` is the size of the curves of joints, None unless all readings are poses.
    """

    refined: Refined
    origins: tuple[int, ...]
    level: Level
    strength: Array
    robust: Array
    refused: frozenset[int] = frozenset()
    level_cap: float = 1.0
    curves: JointCurves | None = None
    unknown: tuple[UnknownCause, ...] = ()
    replaced: frozenset[str] = frozenset()

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The fitted effects."""
        return self.refined.effects

    def may_be_fault(self, place: int) -> bool:
        """Return whether an effect is a possible fault."""
        return bool(self.possible_faults([self.refined.effects[place]]))

    def possible_faults(self, effects: Sequence[Effect]) -> tuple[Effect, ...]:
        """Return the effects larger than in healthy arms, or, if this arm is better than those, than usual in this arm.

        A search recomputes all other terms with them, and compares them with rivals. The verdict decides about faults.
        """
        return tuple(effect for effect in effects if abs(size_of(effect)) > FAULT * min(self.level.of(effect), 1.0))


def combined_effect(effects: Sequence[Effect], size: Array) -> Effect:
    """Return the effect that the columns of `effects` form with coefficients size (q,) in healthy sizes."""
    effect = effects[0]
    field_name, healthy = size_field(effect), healthy_size(effect)
    if len(size) == 2:
        phase = float(np.degrees(np.arctan2(size[1], size[0])))
        return effect.model_copy(update={field_name: float(np.hypot(*size)) * healthy, PHASE: phase})
    return effect.model_copy(update={field_name: float(size[0]) * healthy})


def is_alike(effect: Effect, other_effect: Effect) -> bool:
    """Return whether two effects have the same name, with any size and shape. Waves of different order are not
    alike.
    """
    if name_of(effect) != name_of(other_effect):
        return False
    order, order_there = order_of(effect), order_of(other_effect)
    return np.isnan(order) or np.isnan(order_there) or max(order, order_there) / min(order, order_there) < _NEAR_ORDER


def is_one(effect: Effect, other_effect: Effect) -> bool:
    """Return whether two effects, of any size and shape, are the same: equal name and, for waves, equal order."""
    apart = abs(order_of(effect) - order_of(other_effect))
    return name_of(effect) == name_of(other_effect) and not apart >= _SAME_ORDER


def is_duplicate(effects: Sequence[Effect]) -> bool:
    """Return whether the last of several effects is a wave already present, with the same name and order."""
    *others, last = effects
    return any(is_one(effect, last) for effect in others if np.isfinite(order_of(effect)))


def spurious_wave_series(effects: Sequence[Effect]) -> frozenset[str]:
    """Return the named effects with too many waves for gears among several effects: the series of an error of a
    different form.
    """
    waves = Counter(name_of(effect) for effect in effects if is_wave(effect) and effect.STAGE == "joint")
    return frozenset(name for name, count in waves.items() if count > _MOST_WAVES)


_SHOULDER = 2
"""The second axis, which carries nearly the same moment as the base: the first axis perpendicular to gravity."""


def _is_soft_shoulder(effect: Effect) -> bool:
    return effect.part == "gravity" and effect.STAGE == "joint" and getattr(effect, "axis", 0) == _SHOULDER


def has_compliant_base_only(effects: Sequence[Effect]) -> bool:
    """Return whether the effects include a compliant base but no compliance of the shoulder."""
    yields = any(e.part == "gravity" and e.STAGE == "tool" and not hasattr(e, "axis") for e in effects)
    return yields and not any(map(_is_soft_shoulder, effects))


# ----------------------------------------------------------------------------------------------------------------------
# The backgrounds of selection states, with a cache of the most recent.

_KEPT = 6
"""Number of backgrounds that are cached, at some 20 MB each with their marginals (1000 columns and 150 terms of 4600
entries). With twelve, 1495 poses of a UR10 took 145 factors instead of 153, and 25 MB more.
"""
_GRAMS = 4
"""Number of weighted products of the columns that are cached, at some 8 MB each: a round tries two strengths."""


@dataclass(frozen=True)
class Backgrounds:
    """Backgrounds of states about given columns, for an arm compared with a reference.

    States that differ only in the fitted sizes and shapes of the same effects share a background. States that differ
    only in named effects and level share the weighted products of the columns.
    """

    columns: Columns
    reference: Reference
    _recent: dict[tuple[bytes, bytes], Background] = field(default_factory=dict, init=False, repr=False)
    _grams: dict[bytes, Array] = field(default_factory=dict, init=False, repr=False)
    _shares: dict[tuple[str, str], Array] = field(default_factory=dict, init=False, repr=False)

    def of(self, state: SelectionState) -> Background:
        """Return the background of all contributions not fitted as an effect in a state."""
        columns = self.columns
        variance, mean = columns.variance(state.level, state.curves), columns.mean(state.level)
        if has_compliant_base_only(state.effects):
            variance, mean = self._usual_load**2 * variance, self._usual_load * mean
        for effect in state.effects:
            name = (name_of(effect), str(order_of(effect)))
            if name not in self._shares:
                self._shares[name] = remaining_column_shares(columns.forms, effect, len(columns.healthy))
            variance, mean = self._shares[name] * variance, self._shares[name] * mean
        weight = state.robust / state.strength[columns.band]
        seen = weight.tobytes()
        weighted_gram = partial(recent, self._grams, seen, partial(columns.weighted_gram, weight), _GRAMS)
        key = (seen, variance.tobytes())  # the means follow from the level and the names, as the variances do
        return recent(self._recent, key, lambda: Background(columns, weight, variance, mean, weighted_gram), _KEPT)

    @cached_property
    def _usual_load(self) -> Array:
        """Ratio (p,) of the usual to the healthy size for columns of the shoulder's compliance; 1 for all others.

        A compliant foundation rotates the arm like a compliant axis 2, about a lower point. Next to a compliant
        foundation, axis 2 is therefore permitted the usual compliance of the build; otherwise its compliance was
        attributed to the base, at three times the true value.
        """
        usual = np.ones(len(self.columns.healthy))
        for form in self.columns.forms:
            if _is_soft_shoulder(form.effect):
                usual[list(form.columns)] = form.effect.usual_times(self.reference)
        return usual


# ----------------------------------------------------------------------------------------------------------------------
# The hyperparameters of a state: the healthy level of the arm, the strength of the residual in each band, and the
# robust weights.

_BAND_PRICE, _TARGET_PRICE = 3.0, 8.0
"""Log evidence that the strength of a band of orders, and of targets, must gain to exceed that of the noise. Chosen:
targets have the higher price, because their noise has heavy tails.
"""
_MOST_STRENGTH = 1e6
"""Largest strength of the noise: a thousand times the scatter of a real pose, exceeded only by a wrong arm."""
_TAIL = 4.0
"""Degrees of freedom of Student's distribution of readings at targets. Chosen: stops of robots have heavy tails."""
MOST_LEVEL = 8.0
"""Largest level of a background. Chosen: an arm that shows eight times the healthy size of every effect has faults
instead.
"""
LEAST_LEVEL = 0.003
"""Smallest level of a background. Chosen: a simulated arm that has only named effects."""
_LEVELS = np.geomspace(LEAST_LEVEL, MOST_LEVEL, 80)
"""Levels of a background that are tried; consecutive levels differ by a tenth."""
_LEVEL_ROUNDS, _SAME_LEVEL = 12, 0.15
"""Largest number of successive estimates of the level, and the logarithm of their ratio at which they agree. An
estimate moves a third of the distance; twelve rounds lead from a healthy arm to a hundred times quieter arm.
"""
_QUIETER = 1.4
"""Factor between levels that are compared by evidence. Chosen: a tenth of the width of the prior."""
_NO_GAIN = -0.5
"""Approximate log evidence below which a lower level is not tried. Chosen: of 171 levels whose approximate gain was
negative in a search with 17 names, none gained anything.
"""
_QUIETEST = 0.03
"""Level below which the evidence is not used to try a lower level.

In cells with a single effect, the right effects win from level 0.1 on. Below it, a search continues to ever smaller
named effects.
"""
_SAME_STRENGTH = 0.01
"""Largest logarithm of the ratio of strengths treated as equal: half a percent of an uncertainty."""
_LEVEL_TAIL = 4.0
"""Degrees of freedom of Student's distribution of the effects of an arm, which limits the weight of a fault in the
level. Chosen.
"""
_LEVEL_SPREAD = 1.4
"""Prior standard deviation of the logarithm of a level about that of a healthy arm: a factor of four in either
direction. Chosen.
"""


def _level_costs(levels: Array) -> Array:
    """Return the cost of each level by the prior, in log evidence."""
    return np.asarray(np.log(levels) ** 2 / (2 * _LEVEL_SPREAD**2))


@dataclass(frozen=True)
class Hyperparameters:
    """Hyperparameters of a linearisation, with N entries in b bands."""

    linear: Linearisation
    columns: Columns

    @cached_property
    def _targets(self) -> Mask:
        """Mask (N,) of the entries at targets."""
        return self.linear.at_entries([np.full(len(b.y_mm), b.sampling is None) for b in self.linear.blocks])

    @cached_property
    def _band_price(self) -> Array:
        """Log evidence (b,) that the strength of each band must gain; known distances have their stated uncertainty."""
        price = np.where(np.bincount(self.columns.band, self._targets) > 0, _TARGET_PRICE, _BAND_PRICE)
        price[self.columns.band[self.linear.of_distances]] = np.inf
        return price

    def level(self, state: SelectionState, posterior: CoefficientPosterior) -> Level:
        """Return the level of the background: the ratio of the mean square of the coefficients of each effect to the
        expectation in an arm at level 1.

        A named effect with any number of forms counts only once, because a gear shows only a few orders; a fault has
        little weight. Expected but unobserved effects do not count.
        """
        columns, background, now = self.columns, posterior.background, state.level
        cols = np.flatnonzero(self._leveled(state, background))
        freedom = np.clip(1 - posterior.variance[cols] / background.variance[cols], 0.0, 1.0)
        # Contribution of the prior means to the coefficients; readings show the rest.
        unseen = posterior.covariance_times(background.pull)
        shown = (posterior.mean - unseen)[cols] ** 2
        expected = columns.healthy[cols] * freedom
        expected += ((background.mean - unseen)[cols] / columns.levels(now)[cols]) ** 2
        names, of_columns, count = columns.name_of_column[cols], columns.level_indices(now)[cols], len(columns.among)
        likeliest = []
        for k, value in enumerate(now.values.tolist()):
            leveled_k = of_columns == k
            squares = np.asarray(np.bincount(names[leveled_k], shown[leveled_k], count), dtype=float)
            seen = np.asarray(np.bincount(names[leveled_k], expected[leveled_k], count), dtype=float)
            for place, name in enumerate(columns.among):
                named = [effect for effect in state.effects if name_of(effect) == name and now.index(effect) == k]
                if named:
                    squares[place] += sum(size_of(effect) ** 2 for effect in named)
                    seen[place] = 1.0
            weight = (_LEVEL_TAIL + 1) / (_LEVEL_TAIL + squares / np.maximum(seen, 1e-3) / value**2)
            likely = -seen.sum() * np.log(_LEVELS) - float(weight @ squares) / (2 * _LEVELS**2) - _level_costs(_LEVELS)
            likeliest.append(min(_LEVELS[np.argmax(likely)], state.level_cap))
        return Level.of_values(np.array(likeliest))

    def _leveled(self, state: SelectionState, background: Background) -> Mask:
        """Return the mask (p,) of the columns whose variance grows with a level."""
        leveled = (self.columns.healthy > 0) & (background.variance > 0)
        if state.curves is not None:
            leveled[self.columns.curves.columns] = False  # curves have separate widths
        return leveled

    def robust(self, posterior: CoefficientPosterior) -> Array:
        """Return the weights (N,) of the entries: those of Student's distribution at targets, and 1 elsewhere."""
        weight, targets = np.ones(len(self._targets)), self._targets
        if targets.any():
            at_targets = posterior.residual[targets]
            scale = max(1.0, 1.4826 * float(np.median(np.abs(at_targets))))
            fair = np.minimum(1.0, (_TAIL + 1) / (_TAIL + (at_targets / scale) ** 2))
            weight[targets] = np.round(fair, WEIGHT_DIGITS)
        return weight

    def strength(self, state: SelectionState, posterior: CoefficientPosterior) -> Array:
        """Return the strength (b,) of each band: that of the residual if it exceeds the noise by more than the
        penalty. Assumed noise, which is wide, may also be reduced.
        """
        count = self.columns.count
        free: Array = np.maximum(count - posterior.spent / state.strength, 0.25 * count)
        ratio: Array = np.maximum(self._energy(state, posterior) / free, 1e-9)
        gain = 0.5 * free * (ratio - 1 - np.log(ratio)) - self._band_price
        return np.where((ratio > 1) & (gain > 0), ratio, np.clip(ratio, self.strength_limits[0], 1.0))

    @cached_property
    def strength_limits(self) -> Array:
        """Smallest and largest strength (2, b) of each band, relative to the noise: at least 1 if repeats show it,
        less if it is assumed. Known distances have their stated uncertainty.
        """
        assumed = self.linear.at_entries([np.full(len(b.y_mm), not b.measured) for b in self.linear.blocks])
        least = np.where(np.bincount(self.columns.band, assumed) > 0, LEAST_ASSUMED, 1.0)
        return np.stack([least, np.where(np.isfinite(self._band_price), _MOST_STRENGTH, 1.0)])

    def by_strength(self, posterior: CoefficientPosterior) -> Array:
        """Return the derivatives (b,) of the log evidence by the logarithms of the strengths."""
        energy = np.bincount(self.columns.band, posterior.background.weight * posterior.residual**2)
        return 0.5 * (energy + posterior.weighted_spent - self.columns.count)

    def nearer_strength(self, state: SelectionState, posterior: CoefficientPosterior) -> Array:
        """Return the strength (b,) after a shorter step, which never makes the readings less likely (expectation
        maximisation: Dempster, Laird and Rubin 1977).
        """
        energy = self._energy(state, posterior) + posterior.spent
        return np.clip(energy / self.columns.count, *self.strength_limits)

    def update(
        self,
        state: SelectionState,
        posterior: CoefficientPosterior,
        evidence: Callable[[SelectionState], float],
        posterior_of: Callable[[SelectionState], CoefficientPosterior],
    ) -> SelectionState:
        """Return a state with strengths and robust weights that increase the evidence, and the level estimated from it.

        Strengths are estimated from the state's posterior with all other values unchanged, and an estimate may
        therefore overshoot. A clearly shorter step is then tried, and if that does not help either, they do not change.
        """
        whole, robust = evidence(state), self.robust(posterior)
        whole_step, nearer = self.strength(state, posterior), self.nearer_strength(state, posterior)
        apart = float(np.abs(np.log(whole_step / nearer)).max())
        for strength in (whole_step, nearer) if apart > _SAME_STRENGTH else (whole_step,):
            tried = replace(state, strength=strength, robust=robust)
            if evidence(tried) > whole:
                state = tried
                break

        def with_prior(tried: SelectionState) -> float:
            return evidence(tried) - float(_level_costs(tried.level.values).sum())

        for _ in range(_LEVEL_ROUNDS):
            level, now = self.level(state, posterior).values, state.level.values
            # Effects not yet named look like an arm with a higher level.
            raised = replace(state, level=Level.of_values(level))
            if (level > now).any() and with_prior(raised) <= with_prior(state):
                level = np.minimum(level, now)
            if np.abs(np.log(level / now)).max() < _SAME_LEVEL:
                break
            state = replace(state, level=Level.of_values(level))
            posterior = posterior_of(state)
        return state if state.unknown else self._at_quieter_level(state, posterior, with_prior)

    def _at_quieter_level(
        self, state: SelectionState, posterior: CoefficientPosterior, with_prior: Callable[[SelectionState], float]
    ) -> SelectionState:
        """Return the state with the most likely level up to the present one.

        `posterior` is the latest one, and `with_prior` returns the log evidence of a state and of the level.
        Estimates from the posterior converge ever more slowly to a quiet level. At 2.5 times too high a level, wrong
        named effects were confirmed against a right effect that gained 100 more in log evidence at the right level.
        """
        whole = with_prior(state)
        for k in range(state.level.values.size):
            if self._gain_when_quieter(state, posterior, k) < _NO_GAIN:
                continue
            while state.level.values[k] / _QUIETER >= _QUIETEST:
                levels = state.level.values
                levels[k] /= _QUIETER
                tried = replace(state, level=Level.of_values(levels))
                if (quieter := with_prior(tried)) <= whole:
                    break
                state, whole = tried, quieter
        return state

    def _gain_when_quieter(self, state: SelectionState, posterior: CoefficientPosterior, k: int) -> float:
        """Return the approximate log evidence that the next lower value of level k gains.

        It is the sum over the coefficients, each with its own prior changed while all others stay.
        """
        background, columns = posterior.background, self.columns
        cols = self._leveled(state, background) & (columns.level_indices(state.level) == k)
        variance, mean = background.variance[cols], background.mean[cols]
        precision = np.maximum(1 / posterior.variance[cols] - 1 / variance, 0.0)
        eta = posterior.mean[cols] / posterior.variance[cols] - background.pull[cols]

        def evidence(times: float) -> float:
            expected = times * mean
            of_variance = cavity_evidence(precision, (eta - precision * expected) ** 2, times**2 * variance)
            return float(of_variance + expected @ eta - 0.5 * precision @ expected**2)

        levels = state.level.values[k] / np.array([1.0, _QUIETER])
        return evidence(1 / _QUIETER) - evidence(1.0) - float(np.diff(_level_costs(levels))[0])

    def _energy(self, state: SelectionState, posterior: CoefficientPosterior) -> Array:
        """Return the robust energy (b,) of the residual of each band, in variances of the noise."""
        raw = posterior.background.weight * state.strength[self.columns.band] * posterior.residual**2
        return np.asarray(np.bincount(self.columns.band, raw), dtype=float)


# ----------------------------------------------------------------------------------------------------------------------
# Mean of the background, as terms and as effects of the arm.
#
# Every form of the background is the effect at the size used for the column, with the multiple shown by the readings.
# Single forms are rarely certain, but their sum is: it reaches a tenth of a millimetre if named effects reach half a
# millimetre.


def background_terms(posterior: CoefficientPosterior) -> list[Term]:
    """Return the forms of the background, each with the mean multiple."""
    mean, terms = posterior.mean, []
    for form in posterior.background.columns.forms:
        for effect, column in zip(form.effects, form.columns, strict=True):
            times = float(mean[column] / form.size)
            # Parts excluded from a model are not written either, so that every reader of the file has the same model.
            times = 0.0 if is_nothing(effect, times) else times
            terms.append(Term.model_construct(effect=effect, times=times, named=False))
    return terms


def background_effects(posterior: CoefficientPosterior) -> tuple[Effect, ...]:
    """Return the sum of the forms of the background, as effects of the arm."""
    return tuple(effects_of([(term.effect, term.times) for term in background_terms(posterior)]))


# ----------------------------------------------------------------------------------------------------------------------
# Settling: the effects and the noise of a state fitted in turn, until the evidence hardly rises.
#
# Strengths estimated before a large effect was found do not determine the shape, and a wrong shape keeps them large;
# the residual then supports wrong names. After such an effect the fits therefore start twice: from these strengths and,
# if different, from those of the noise.

_SETTLING_ROUNDS = 6
"""Largest number of fits after an update of the noise. Chosen: most states need three."""
_ENOUGH = 5.0
"""Log evidence that a round must gain for the next round. Chosen: odds of 150 to 1."""
_Change = Callable[[SelectionState], SelectionState]


def beginnings(state: SelectionState) -> list[SelectionState]:
    """Return a state and, if different, the same state with only the strengths (b,) of the noise."""
    return [state, replace(state, strength=np.ones_like(state.strength))] if (state.strength != 1).any() else [state]


def settled(
    begins: Sequence[SelectionState],
    fitted: _Change,
    with_noise: _Change,
    evidence: Callable[[SelectionState], float],
    least: float = -np.inf,
) -> SelectionState:
    """Return the likeliest of the states reached from several initial states.

    `fitted` fits all effects, `with_noise` estimates the noise, and `evidence` returns the log evidence of a state.
    Fits end early if the gains decrease and the remaining rounds, each with the gain of the last round, could not reach
    the log evidence `least`.
    """
    states = []
    for begin in begins:
        now, gain = fitted(begin), np.inf
        for rounds in reversed(range(_SETTLING_ROUNDS)):
            previous, now, last_gain = now, fitted(with_noise(now)), gain
            gain = evidence(now) - evidence(previous)
            if gain < _ENOUGH or (gain < last_gain < np.inf and evidence(now) + rounds * gain < least):
                break
        states += [previous, now]
    return max(states, key=evidence)

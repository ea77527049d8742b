"""Alternatives to each named effect: the hypotheses that compete with it, each with its own evidence.

The log odds of a name are its log evidence minus that of all alternatives: nothing but noise, a healthy arm, a rival, a
cause that rig does not know, or such a cause behind several of the names together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from analysis.diagnosis.fit.joint_curves import is_of_curve
from analysis.diagnosis.fit.leave_out import UNDECIDED, LeaveOut
from analysis.diagnosis.fit.refine import ended_at_limit
from analysis.diagnosis.fit.responses import Response
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.fit.selection_state import SelectionState, least_fault
from analysis.diagnosis.fit.unknown import likeliest_kind, total_gain
from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect
from rigs.schema.effect import scaled, size_of
from rigs.schema.scene import OUTSIDE_ARM

Alternative = Literal["nothing", "healthy", "rival", "unknown", "several", "commanded"]
"""No effect but more noise; an effect of a healthy arm; another effect; a cause that rig does not know; such a cause
behind this name and others; or an angle that the arm was commanded but did not reach."""
_SAME_SIGMA = 0.5
"""Difference of the readings in noise standard deviations, apart from the sizes, up to which an effect and a rival are
twins. Chosen: at 1.0, both would be confused in a third of all repeats.
"""
_LOUDER = 1.5
"""Strength of a band above which its residual counts as more than noise. Chosen: cells without unknown causes have up
to 1.2.
"""
_MOST = 6
"""Largest number of least certain names that an unknown cause replaces step by step. Chosen: each may cost a fit."""
_TINY = 1e-300
_Share = tuple[SelectionState, float]
_NONE = -690.0
"""Log evidence of an alternative without any."""


@dataclass(frozen=True)
class Hypotheses:
    """A named effect with its alternatives."""

    log_evidence: Mapping[Alternative, float]
    """Log evidence of each alternative, relative to that of the name."""
    rivals: Sequence[tuple[SelectionState, float]] = ()
    """Rivals, each as the state with the rival in place of the name, with their shares of the evidence of all."""
    twins: Sequence[Effect] = ()
    """Effects that change the readings in the same way as the name, and count as the name."""

    def log_odds(self, *, with_rivals: bool = False) -> float:
        """Log odds of the name against all alternatives; with rivals, of the name or a rival."""
        others = [value for key, value in self.log_evidence.items() if key != "rival" or not with_rivals]
        return -float(np.logaddexp.reduce(others))


def hypotheses_of(result: SearchResult, *, only_commanded: bool = False) -> list[Hypotheses]:
    """The alternatives to each named effect. only_commanded: the runs contain commanded angles, and an angle that the
    arm did not reach explains the readings as well as any error of the arm.
    """
    compared = _Comparison(result)
    without = [compared.without([k]) for k in range(len(result.effects))]
    of_unknown = [with_unknown for _, with_unknown in without]
    of_several, hypotheses = compared.of_several(of_unknown), []
    for k, (effect, odds) in enumerate(zip(result.effects, result.rival_odds, strict=True)):
        twins, rivals = list[_Share](), list[_Share]()
        for tried, share in odds.rivals:
            if not ended_at_limit(tried.effects[-1]):  # no effect of that kind is so large
                (twins if _are_twins(result, k, tried.effects[-1]) else rivals).append((tried, share))
        own = odds.odds + sum(share for _, share in twins)
        log_evidence: dict[Alternative, float] = {
            "nothing": without[k][0],
            "healthy": _log_ratio(odds.healthy_odds, own),
            "rival": _log_ratio(sum(share for _, share in rivals), own),
            "unknown": of_unknown[k],
            "several": of_several[k],
        }
        if only_commanded and effect.STAGE not in OUTSIDE_ARM:
            log_evidence["commanded"] = 0.0
        hypotheses.append(Hypotheses(log_evidence, rivals, [tried.effects[-1] for tried, _ in twins]))
    return hypotheses


def _are_twins(result: SearchResult, k: int, rival: Effect) -> bool:
    """Whether a rival of effect k, at its best size, changes the readings in the same way.

    The background shares a size that the readings hardly determine, so fits of two constants of parallel axes end at
    sizes that differ by much more than the noise.
    """
    linear, others = result.linear, [*result.effects[:k], *result.effects[k + 1 :]]
    change = linear.without_set_up(result.contributions[k])

    def of_rival(effect: Effect) -> Array:
        return linear.without_set_up(linear.residual(others) - linear.residual([*others, effect]))

    times = _times(change, of_rival(rival))
    if times <= 0.0:
        return False
    resized = of_rival(scaled(rival, times))
    return float(np.linalg.norm(change - _times(change, resized) * resized)) < _SAME_SIGMA


def _times(change: Array, unit: Array) -> float:
    """Multiple of a unit (N,) nearest to a change (N,)."""
    return float(change @ unit) / max(float(unit @ unit), _TINY)


@dataclass(frozen=True)
class _Comparison:
    """Evidence of the names of a search result against unknown causes."""

    result: SearchResult

    @cached_property
    def present(self) -> str | None:
        """The kind of unknown cause that the readings show in addition to all names, if any."""
        gains = self.result.selection.causes.gains(self.result.selection.posterior(_with_noise(self.result.state)[-1]))
        return likeliest_kind(gains) if total_gain(gains) > 0 else None

    @cached_property
    def of_name(self) -> float:
        """Log evidence of all names together, with or without an unknown cause in addition."""
        alone = [self.result.selection.evidence(each) for each in _with_noise(self.result.state)]
        return float(np.logaddexp.reduce([*alone, self.with_unknown(self.result.state)]))

    def with_unknown(self, state: SelectionState) -> float:
        """Log evidence of an unknown cause in addition to the names of a state, at the noise of the state or of the
        readings alone: what a name explained must not become noise.

        If the readings show an unknown cause anyway, another one may exist beside it.
        """
        selection, causes, each = self.result.selection, self.result.selection.causes, list[float]()
        for at_noise in _with_noise(state):
            gains = causes.gains(selection.posterior(at_noise))
            each.append(selection.evidence(at_noise) + total_gain(gains))
            if self.present:
                beside = _with_columns(at_noise, causes.likeliest_columns(self.present, gains[self.present]))
                evidence = selection.evidence(beside)
                each += [evidence, evidence + total_gain(causes.gains(selection.posterior(beside)))]
        return float(np.logaddexp.reduce(each))

    @cached_property
    def _left_out(self) -> list[list[LeaveOut]]:
        """The state at each noise, without and, if the readings show one, with an unknown cause."""
        causes = self.result.selection.causes
        left_out = []
        for at_noise in _with_noise(self.result.state):
            each = [at_noise]
            if self.present:
                gains = causes.gains(self.result.selection.posterior(at_noise))[self.present]
                each.append(_with_columns(at_noise, causes.likeliest_columns(self.present, gains)))
            left_out.append([LeaveOut(self.result.selection, state, causes) for state in each])
        return left_out

    def without(self, places: Sequence[int]) -> tuple[float, float]:
        """Log evidence of noise, and of noise or an unknown cause, in place of names, relative to all names.

        The names are removed in a linear model; a fit follows only if it might decide about a reported fault. Others
        are compared at the noise of the state alone.
        """
        if self._reported.isdisjoint(places):
            reduced = self._left_out[0][0].without(places)
            nothing = reduced.evidence - self._of_usual_name
            return nothing, nothing + total_gain(reduced.cause_gains)
        alone, with_unknown = list[float](), list[float]()
        for alternatives in self._left_out:
            for k, left_out in enumerate(alternatives):
                reduced = left_out.without(places)
                gain = total_gain(reduced.cause_gains)
                if k == 0:
                    alone.append(reduced.evidence)
                with_unknown.append(reduced.evidence + np.logaddexp(gain, 0.0 if k else -np.inf))
        nothing, unknown = max(alone) - self.of_name, float(np.logaddexp.reduce(with_unknown)) - self.of_name
        if unknown < -UNDECIDED and not self._left_out[0][0].is_close(places):
            return nothing, unknown
        selection, bare = self.result.selection, self.result.state
        for place in sorted(places, reverse=True):
            bare = selection.without(bare, place)
        louder = replace(bare, strength=selection.strength(bare, selection.posterior(bare)))
        nothing = max(selection.evidence(bare), selection.evidence(louder))
        return nothing - self.of_name, self.with_unknown(bare) - self.of_name

    @cached_property
    def _of_usual_name(self) -> float:
        """`of_name`, at the noise of the state alone."""
        whole = self._left_out[0][0].without([])
        return whole.evidence + float(np.logaddexp(total_gain(whole.cause_gains), 0.0))

    @cached_property
    def _reported(self) -> frozenset[int]:
        selection, state = self.result.selection, self.result.state
        return frozenset(k for k in range(len(state.effects)) if selection.is_reported(state, k))

    def of_several(self, of_unknown: Sequence[float]) -> list[float]:
        """Log evidence of an unknown cause behind each name and others: the least certain reported faults, all waves of
        joints, or all possible faults.
        """
        effects, reference = self.result.effects, self.result.reference
        best = [_NONE] * len(effects)
        least_certain = sorted(range(len(effects)), key=lambda k: -of_unknown[k])
        doubtful = [k for k in least_certain if k in self._reported]
        waves = [k for k in least_certain if is_of_curve(effects[k])]
        faults = [k for k in least_certain if abs(size_of(effects[k])) > least_fault(effects[k], reference)]
        compared = set[frozenset[int]]()
        for order in (order for order in (doubtful, waves, faults) if len(order) > 1):
            for count in range(2, len(order) + 1):
                removed = frozenset(order[:count])
                is_compared = count == len(order) or (order is doubtful and count <= _MOST)
                if is_compared and removed not in compared:
                    compared.add(removed)
                    _, together = self.without(order[:count])
                    best = [max(value, together) if k in removed else value for k, value in enumerate(best)]
        return best


def _log_ratio(share: float, own: float) -> float:
    return math.log(share / own) if share > 0 and own > 0 else _NONE


def _with_columns(state: SelectionState, columns: Array) -> SelectionState:
    """A state with an unknown cause in addition."""
    free = Response(np.concatenate([state.refined.free.columns, columns], axis=1))
    return replace(state, refined=replace(state.refined, free=free))


def _with_noise(state: SelectionState) -> list[SelectionState]:
    """A state and, if its residual counts as more than the noise, the state with only the noise."""
    is_louder = (state.strength > _LOUDER).any()
    return [state, *([replace(state, strength=np.minimum(state.strength, 1.0))] if is_louder else [])]

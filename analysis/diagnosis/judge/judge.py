"""Fourth stage of a diagnosis: named effects, condition of the arm, and error budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from analysis.diagnosis.evidence.gather import Evidence
from analysis.diagnosis.evidence.link_swing import find_vibration
from analysis.diagnosis.evidence.setups import with_effects
from analysis.diagnosis.fit.fit_evidence import Fit
from analysis.diagnosis.fit.responses import limits_um
from analysis.diagnosis.fit.search import early_readings
from analysis.diagnosis.judge.alternatives import hypotheses_of
from analysis.diagnosis.judge.budget import Budget, EffectChange, GapMeasure, effect_changes
from analysis.diagnosis.judge.doubts import doubts_of_limits
from analysis.diagnosis.judge.named_swing import doubts_of_phases, named_vibration
from analysis.diagnosis.judge.remains import Unexplained
from analysis.diagnosis.judge.residuals import bands_above_noise, curves_of, maps_of, places
from analysis.diagnosis.judge.result import (
    Accuracy,
    BudgetPart,
    Condition,
    Named,
    Remainder,
    Verdict,
    fault_rivals,
)
from analysis.diagnosis.judge.unexplained import (
    gauges_apart_um,
    unrepeated_um,
    unusual_visits_um,
    with_dependences,
)
from analysis.diagnosis.judge.validate import Validation
from analysis.diagnosis.judge.validation import held_out_gains, shows_noise
from analysis.diagnosis.judge.verdict import (
    accuracy_of,
    alone_out_of_range,
    ambiguous_names,
    as_scatter,
    condition_of,
    named_effects,
    needs_runs,
    remainder_of,
    runs_to_decide,
    standing_of,
    standing_within,
)
from rigs.schema.effect import is_vibration, name_of


@dataclass(frozen=True)
class Findings:
    """Messages for the doubts: poses read before the joints came to rest, and sizes at the limit of fits."""

    early: tuple[str, ...]
    at_limits: tuple[str, ...]


@dataclass(frozen=True)
class _Answer:
    """Preliminary verdict without figures. named: includes the effects of runs that cannot show effects."""

    condition: Condition
    accuracy: Accuracy
    named: Sequence[Named]
    budget: tuple[BudgetPart, ...]
    remainder: Remainder
    unexplained: Unexplained


def judge(evidence: Evidence, fit: Fit, validation: Validation) -> tuple[Verdict, Findings]:
    """Return the verdict on readings (m, k) mm, and the messages found on the way."""
    result, gaps = fit.result, validation.gaps
    changes = effect_changes(result)
    named, at_limits = _named_in(evidence, fit, validation, changes)
    if fit.out_of_range:
        named = alone_out_of_range(named, fit.out_of_range, validation.fitted)
    early = early_readings(result)
    standing = (
        standing_of(evidence.rig, evidence.uses.used)
        if evidence.tolerance_um is None
        else standing_within(evidence.tolerance_um, validation.fitted)
    )
    accuracy = accuracy_of(gaps, *standing)
    remainder = remainder_of(result, named, result.scatter_limits_um, gaps)
    unrepeated = None if early else unrepeated_um(result, evidence.rig.tests.touch)
    condition = condition_of(result, named, remainder, validation.whole, early=bool(early), unrepeated_um=unrepeated)
    budget: tuple[BudgetPart, ...] = ()
    if condition != "not_testable_here":
        budget = tuple(Budget(result, gaps.train).parts(named, changes))
        condition = "out_of_range" if fit.out_of_range else condition
    visits_um, gauges_um = unusual_visits_um(result), gauges_apart_um(result)
    unexplained = Unexplained(remainder.um, visits_um=visits_um, unrepeated_um=unrepeated, gauges_um=gauges_um)
    answer = _Answer(condition, accuracy, named, budget, remainder, unexplained)
    if condition == "outside_library":
        answer = _of_unknown_cause(answer, fit, validation)
    return _verdict(answer, evidence, fit, validation), Findings(early, at_limits)


def _named_in(
    evidence: Evidence, fit: Fit, validation: Validation, changes: Sequence[EffectChange]
) -> tuple[list[Named], tuple[str, ...]]:
    """Return the effects found by a search, confirmed ones first, and doubts about their sizes.

    Readings are (m, k) mm. Unless the effects were given by the user, a vibration of the link is included.
    """
    result, fitted, train, given = fit.result, validation.fitted, validation.gaps.train, fit.is_given
    only_commanded = any(run.has_only_commanded_angles for run in evidence.uses.used)
    hypotheses = hypotheses_of(result, only_commanded=only_commanded)
    named = named_effects(result, hypotheses, fitted, held_out_gains(result, validation.judges), changes)
    doubts = doubts_of_limits(named)
    vibrations = [name for name in named if given and is_vibration(name.effect)]
    swing = None
    if vibrations or not given:
        swing = find_vibration(with_effects(evidence.runs, result.effects), result.linear.setups)
    if swing is not None and given:
        doubts += doubts_of_phases(vibrations, swing)
    elif swing is not None:  # confirmed if its contribution exceeds the scatter of a circle without it
        circles = [block.sampling is not None for block in result.linear.blocks]
        limits = limits_um(result.linear, swing.scatter_um)
        named += named_vibration(swing, limits[circles], train.after_um)
    named = [replace(name, alone_um=fitted.residual_um([name.effect])) for name in named]
    return sorted(named, key=lambda name: (not name.is_confirmed, -name.contribution_um)), doubts


def _of_unknown_cause(answer: _Answer, fit: Fit, validation: Validation) -> _Answer:
    """Return the verdict with the quantities on which the unexplained part of the readings (N,) depends.

    If it depends on none and no target was visited twice, it is scatter.
    """
    unexplained = with_dependences(answer.unexplained, fit.result, validation.left_out)
    if not unexplained.scatter_um or any(name.is_confirmed for name in answer.named):
        return replace(answer, unexplained=unexplained)
    budget, remainder = as_scatter(answer.budget, answer.remainder)
    return replace(answer, condition="nothing_unusual", budget=budget, remainder=remainder, unexplained=unexplained)


def _verdict(answer: _Answer, evidence: Evidence, fit: Fit, validation: Validation) -> Verdict:
    """Return the complete verdict with the figures and plots of the residuals (m, k)."""
    result, gaps, named = fit.result, validation.gaps, answer.named
    linear, measure = result.linear, GapMeasure(result.linear)
    drawn = [linear.in_mm(measure.without_set_up(linear.residual(effects))) for effects in ((), result.effects)]
    return Verdict(
        condition=answer.condition,
        accuracy=answer.accuracy,
        budget=answer.budget,
        runs_to_decide=runs_to_decide(result, named) if answer.condition == "undecided" and needs_runs(named) else None,
        rig=evidence.rig,
        runs=gaps.train.runs,
        where=places(linear.blocks, drawn[0], measure.scatter_mm()),
        effects=tuple(named) if answer.condition != "not_testable_here" else (),
        remainder=answer.remainder,
        train=gaps.train,
        held_out=gaps.held_out,
        unseen=gaps.unseen,
        left=bands_above_noise(linear.blocks, result.posterior.residual),
        setups=linear.setups,
        groups=_groups(named) if answer.condition != "out_of_range" else (),
        not_testable=result.selection.not_testable(result.state, result.posterior),
        repeated=all(block.measured for block in linear.blocks),
        shows_noise=all(block.measured or shows_noise(block) for block in linear.blocks),
        levels=result.state.level.by_part(),
        curves=curves_of(linear.blocks, *drawn),
        maps=maps_of(linear.blocks, *drawn),
        given=fit.is_given,
        unexplained=answer.unexplained,
    )


def _groups(named: Sequence[Named]) -> tuple[tuple[str, ...], ...]:
    """Return the named effects that the runs cannot distinguish, each with its rivals."""
    return tuple(
        (name_of(name.effect), *(name_of(rival.effect) for rival in name.rivals))
        for name in named
        if name.rivals and (name in ambiguous_names(named) or fault_rivals(name))
    )

"""Fourth stage of a diagnosis: named effects, condition of the arm, error budget, calibrated model, and doubts."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.gather import Evidence
from analysis.diagnosis.evidence.link_swing import FoundVibration, find_vibration
from analysis.diagnosis.evidence.setups import with_effects
from analysis.diagnosis.evidence.significance import ODDS
from analysis.diagnosis.fit.fit_evidence import Fit
from analysis.diagnosis.fit.responses import LEAST_MATERIAL_UM
from analysis.diagnosis.fit.search import early_readings
from analysis.diagnosis.judge.alternatives import hypotheses_of
from analysis.diagnosis.judge.budget import Budget, EffectChange, GapMeasure, effect_changes
from analysis.diagnosis.judge.budget_part import BudgetPart
from analysis.diagnosis.judge.calibrated_model import calibrated_model
from analysis.diagnosis.judge.certainty import fault_rivals
from analysis.diagnosis.judge.dependence import (
    gauges_apart_um,
    held_out_residual,
    unrepeated_um,
    unusual_visits_um,
    with_dependences,
)
from analysis.diagnosis.judge.doubts import doubts_of_limits, doubts_of_rig, doubts_of_runs
from analysis.diagnosis.judge.named import Named
from analysis.diagnosis.judge.residuals import bands_above_noise, curves_of, maps_of, places
from analysis.diagnosis.judge.result import Diagnosis
from analysis.diagnosis.judge.staircase import staircase_of
from analysis.diagnosis.judge.validate import Validation, held_out_gains
from analysis.diagnosis.judge.verdict import (
    accuracy_of,
    alone_out_of_range,
    ambiguous_names,
    as_scatter,
    condition_of,
    doubt_of_size,
    judged_of,
    named_effects,
    needs_runs,
    runs_to_decide,
    standing_of,
    standing_within,
    unexplained_residual,
)
from analysis.robot.kinematics.arm import Array
from analysis.runs.loading import Measured
from rigs.load import contradictions
from rigs.schema.effect import is_vibration, name_of, size_field
from rigs.schema.reference import Reference


def judge(evidence: Evidence, fit: Fit, validation: Validation) -> tuple[Diagnosis, bool]:
    """Judge the fit: the diagnosis before its actions, and whether poses were read before the joints came to rest."""
    result, gaps = fit.result, validation.gaps
    changes = effect_changes(result)
    named, at_limits = _named_in(evidence, fit, validation, changes)
    if fit.out_of_range:
        named = alone_out_of_range(named, fit.out_of_range, validation.fitted)
    early = early_readings(result)
    standing = (
        standing_of(evidence.rig, evidence.used)
        if evidence.tolerance_um is None
        else standing_within(evidence.tolerance_um, validation.fitted)
    )
    accuracy = accuracy_of(gaps, *standing)
    residual = replace(
        unexplained_residual(result, named, result.scatter_limits_um, gaps),
        visits_um=unusual_visits_um(result),
        unrepeated_um=None if early else unrepeated_um(result, evidence.rig.tests.touch),
        gauges_um=gauges_apart_um(result),
        held_out=held_out_residual(result, validation.places, temperature_of(evidence.used)),
    )
    condition = condition_of(result, named, residual, validation.whole, early=bool(early))
    budget: tuple[BudgetPart, ...] = ()
    if condition != "not_testable_here":
        budget = tuple(Budget(result, gaps.train).parts(named, changes))
        condition = "out_of_range" if fit.out_of_range else condition
    if condition == "outside_library":
        residual = with_dependences(residual, result, validation.places)
        if residual.scatter_um and not any(name.is_confirmed for name in named):
            budget, residual = as_scatter(budget, residual)
            condition = "nothing_unusual"
    linear, measure = result.linear, GapMeasure(result.linear)
    before, after = measure.residual_mm(()), measure.residual_mm(result.effects)
    diagnosis = Diagnosis(
        condition=condition,
        accuracy=accuracy,
        budget=budget,
        runs_to_decide=runs_to_decide(result, named) if condition == "undecided" and needs_runs(named) else None,
        rig=evidence.rig,
        runs=gaps.train.runs,
        where=places(linear.blocks, before, measure.scatter_mm()),
        effects=tuple(named) if condition != "not_testable_here" else (),
        residual=residual,
        train=gaps.train,
        held_out=gaps.held_out,
        unseen=gaps.unseen,
        bands=bands_above_noise(linear.blocks, result.posterior.residual),
        setups=linear.setups,
        groups=_groups(named) if condition != "out_of_range" else (),
        not_testable=result.selection.not_testable(result.state, result.posterior),
        repeated=all(block.measured for block in linear.blocks),
        shows_noise=all(block.measured or block.shows_noise for block in linear.blocks),
        levels=result.state.level.by_part(),
        curves=curves_of(linear.blocks, before, after),
        maps=maps_of(linear.blocks, before, after),
        given=fit.is_given,
        doubts=(
            *evidence.doubts, *early, *validation.doubts, *at_limits, *doubts_of_runs(linear.blocks),
            *doubts_of_rig(evidence.rig, validation.fitted),
        ),
        only_commanded=any(run.has_only_commanded_angles for run in evidence.used),
        driven_corrected=all(run.run.manifest.corrected == "targets" for run in evidence.used),
    )  # fmt: skip
    return _with_model(diagnosis, evidence, fit, validation), bool(early)


def _with_model(diagnosis: Diagnosis, evidence: Evidence, fit: Fit, validation: Validation) -> Diagnosis:
    """Add the calibrated model, and the residual as its parts are added."""
    result, runs_at = fit.result, (validation.fitted.runs, validation.judges, validation.elsewhere)
    staircase = staircase_of(diagnosis, result, validation.calibrated, *runs_at)
    diagnosis = replace(diagnosis, staircase=staircase)
    if fit.out_of_range:
        return diagnosis
    judged = judged_of(diagnosis, validation.whole, validation.gaps, validation.widening)
    calibrated = calibrated_model(diagnosis, result, evidence.used, evidence.runs, validation, judged)
    if why := next(contradictions(calibrated, evidence.rig), ""):
        doubt = f"no calibrated model is written, because it {why}; measure again, with more postures"
        return replace(diagnosis, doubts=(*diagnosis.doubts, doubt))
    return replace(diagnosis, calibrated=calibrated)


def _named_in(
    evidence: Evidence, fit: Fit, validation: Validation, changes: Sequence[EffectChange]
) -> tuple[list[Named], tuple[str, ...]]:
    """The effects found by a search, confirmed ones first, and doubts about their sizes. Unless the effects were given
    by the user, a vibration of the link is included.
    """
    result, fitted, train, given = fit.result, validation.fitted, validation.gaps.train, fit.is_given
    only_commanded = any(run.has_only_commanded_angles for run in evidence.used)
    hypotheses = hypotheses_of(result, only_commanded=only_commanded)
    named = named_effects(
        result, hypotheses, fitted, held_out_gains(result, validation.calibrated, validation.judges), changes
    )
    doubts = doubts_of_limits(named)
    swing = None
    if not given:
        swing = find_vibration(with_effects(evidence.runs, result.effects), result.linear.setups)
    elif any(is_vibration(name.effect) for name in named):
        doubts += (_ONE_PHASE,)
    if swing is not None:
        named += named_vibration(swing, result.reference, train.after_um)
    named = [replace(name, alone_um=fitted.residual_um([name.effect])) for name in named]
    return sorted(named, key=lambda name: (not name.is_confirmed, -name.contribution_um)), doubts


def _groups(named: Sequence[Named]) -> tuple[tuple[str, ...], ...]:
    return tuple(
        (name_of(name.effect), *(name_of(rival.effect) for rival in name.rivals))
        for name in named
        if name.rivals and (name in ambiguous_names(named) or fault_rivals(name))
    )


_ONE_PHASE = (
    "the vibration was fitted with one phase and one frequency in all runs: its size is too small if every run begins "
    "with another phase, which rig diagnose finds"
)


def named_vibration(swing: FoundVibration, reference: Reference, gap_um: float) -> list[Named]:
    """A vibration of the link as a named effect, if it is material and its odds are at least 20 to 1. Its phase is new
    in each run; therefore no model removes it from the readings.
    """
    um = 1e3 * swing.amplitude_mm / math.sqrt(2)
    if swing.gain < math.log(ODDS) or um < LEAST_MATERIAL_UM:
        return []
    odds, u = 1 / (1 + math.exp(-swing.gain)), swing.sd[size_field(swing.effect)]
    doubt = doubt_of_size(swing.effect, u, reference)
    return [Named(swing.effect, swing.sd, odds, (), gap_um, swing.effect.remedy(), um, None, doubt)]


_TEMPERATURE = re.compile(r"(?<![a-z])temp(erature)?(?![a-z])")


def temperature_of(used: Sequence[Measured]) -> Array | None:
    """Temperature (n,) of each table row, from an extra column identified by its name; None for several runs or if
    unknown.
    """
    table = used[0].run.table if len(used) == 1 else None
    if table is None:
        return None
    for name in table.column_names:
        if _TEMPERATURE.search(name.casefold()):
            try:
                values = np.array([float(str(cell).replace(",", ".")) for cell in table[name].to_pylist()])
            except ValueError:
                continue
            return values if len(values) == len(used[0].table.q) and np.isfinite(values).all() else None
    return None

"""Third stage of a diagnosis: the gaps of the fitted model on the runs used, on others, and at an unseen place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.evidence.gather import Evidence, without_outliers
from analysis.diagnosis.evidence.observation import ObservedRun, rms, thinned
from analysis.diagnosis.evidence.setups import FittedRuns
from analysis.diagnosis.fit.fit_evidence import Fit
from analysis.diagnosis.fit.responses import LEAST_MATERIAL_UM, noise_um
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.fit.selection_state import background_effects
from analysis.diagnosis.judge.held_out import HeldOut, Widening, held_out_places, widening_of
from analysis.diagnosis.judge.result import Gap, TestGap
from analysis.diagnosis.judge.verdict import Gaps
from rigs.effects import Effect


@dataclass(frozen=True)
class Validation:
    """Residuals of the fitted model, without outliers."""

    fitted: FittedRuns
    judges: Sequence[ObservedRun]
    elsewhere: Sequence[ObservedRun]
    calibrated: tuple[Effect, ...]
    """Effects of the exported model: the named effects and, unless they do better alone, small errors of the arm."""
    places: HeldOut | None
    whole: Gaps
    """Residuals of the complete model, which decide the condition."""
    gaps: Gaps
    """Residuals of the exported model."""
    widening: Widening
    """Factor of the model's uncertainty, from prediction errors."""
    doubts: tuple[str, ...]
    """Doubts about the outliers."""


def validate(evidence: Evidence, fit: Fit, progress: Callable[[str], None]) -> Validation:
    """Compute the residuals of the fitted model for the runs used and for the others."""
    progress("validating on held-out runs")
    result = fit.result
    sound, wild = without_outliers(evidence.runs, result.effects, "the runs used")
    fitted = FittedRuns(sound)
    calibrated = (*result.effects, *background_effects(result.calibrated_posterior))
    if fitted.residual_um(calibrated) > fitted.residual_um(result.effects):
        calibrated = result.effects
    # Relative to the calibrated model: named effects alone leave residuals that hide outliers of 1 mm.
    judges, judges_with_outliers = without_outliers(evidence.judges, calibrated, "held-out runs")
    elsewhere, outliers_elsewhere = without_outliers(evidence.elsewhere, calibrated, "the unseen place")
    judged_runs = tuple(zip((sound, judges, elsewhere), evidence.names, strict=True))
    places = held_out_places(result)
    gaps = whole = _gaps(judged_runs, fitted, calibrated, result, places)
    if whole.names_do_better:
        calibrated = result.effects
        gaps = _gaps(judged_runs, fitted, calibrated, result, places)
    widening = widening_of(places, judges, elsewhere, fitted, calibrated, result)
    held_out = gaps.held_out and replace(gaps.held_out, rows=evidence.withheld)
    gaps = replace(gaps, unexplained_um=widening.unexplained_um, beyond_um=widening.beyond_um, held_out=held_out)
    doubts = (*wild, *judges_with_outliers, *outliers_elsewhere)
    return Validation(fitted, judges, elsewhere, calibrated, places, whole, gaps, widening, doubts)


def _gaps(
    judged: Sequence[tuple[Sequence[ObservedRun], Sequence[str]]],
    fitted: FittedRuns,
    calibrated: Sequence[Effect],
    result: SearchResult,
    places: HeldOut | None,
) -> Gaps:
    (sound, used), *others = judged
    held_out, unseen = (gap(runs, fitted, calibrated, result, names) if runs else None for runs, names in others)
    are_places = places is not None and len(places.rows) == len(result.linear.y)
    of_used = gap(sound, fitted, calibrated, result, used)
    if places is None or not are_places:
        return Gaps(of_used, held_out, unseen)
    return Gaps(of_used, held_out, unseen, places.rms_um, places.rms_u_um)


def gap(
    runs: Sequence[ObservedRun],
    fitted: FittedRuns,
    calibrated: Sequence[Effect],
    result: SearchResult,
    run_names: Sequence[str],
) -> Gap:
    """Gap of runs with the initial model, with the named effects, and calibrated.

    The noise and scatter of a run are estimated from repeats, or else assumed. For touches and many poses, the estimate
    is limited by the residuals. Runs of a different place use the noise of their test.
    """
    stages = [fitted.residuals_of(runs, effects) for effects in ((), result.effects, calibrated)]
    before_um, after_um, calibrated_um = (1e3 * rms(residuals) for residuals in stages)
    tests = []
    for test in dict.fromkeys(run.table.test for run in runs):
        um = []
        for residuals in stages[::2]:
            of_test = [mm for run, mm in zip(runs, residuals, strict=True) if run.table.test == test]
            sizes = [np.linalg.norm(mm, axis=1) if mm.shape[1] == 3 else np.abs(mm) for mm in of_test]
            um += [1e3 * rms(of_test), 1e3 * max(float(size.max()) for size in sizes)]
        tests.append(TestGap(test, *um))
    keeps = {run.setup for run in runs} <= {run.setup for run in fitted.runs}
    blocks, same_names = result.linear.blocks, {run.name for run in runs}
    alike = [block.name in same_names for block in blocks]
    if not any(alike):
        same_tests = {run.table.test for run in runs}
        alike = [block.table.test in same_tests for block in blocks]
    size = np.array([len(block.rows) * block.count for block in blocks]) * (alike if any(alike) else 1)
    floor_um = float(np.sqrt(size @ (result.noise_shown * noise_um(result.linear) ** 2) / size.sum()))
    return Gap(tuple(run_names), before_um, after_um, floor_um, calibrated_um, tuple(tests), keeps)


def held_out_gains(
    result: SearchResult, calibrated: Sequence[Effect], runs: Sequence[ObservedRun]
) -> list[float | None]:
    """Share of the squared residual on held-out runs that each named effect removes in addition to all others. None if
    no held-out run shows the effect beyond the scatter of a run.

    The set-ups are fitted to these runs, of which some hundred readings of a circle are simulated.
    """
    fitted, tests = FittedRuns(list(map(thinned, runs))), [block.table.test for block in result.linear.blocks]
    limits_um = dict(zip(tests, result.scatter_limits_um.tolist(), strict=True))
    gains = list[float | None]()
    for effect in result.effects:
        others = [other for other in calibrated if other != effect]
        (_, whole), (_, without), (_, bare) = map(fitted.fit_with_effects, (calibrated, others, ()))
        changes_um = [1e3 * rms([first - second]) for first, second in zip(whole, without, strict=True)]
        least_um = [limits_um.get(run.table.test, LEAST_MATERIAL_UM) for run in runs]
        is_shown = any(um > least for um, least in zip(changes_um, least_um, strict=True))
        gains.append((rms(without) ** 2 - rms(whole) ** 2) / rms(bare) ** 2 if is_shown else None)
    return gains

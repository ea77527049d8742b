"""Third stage of a diagnosis: the gaps of the fitted model on the runs used, on others, and at an unseen place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from analysis.diagnosis.evidence.gather import Evidence
from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.evidence.prepared_runs import without_outliers
from analysis.diagnosis.evidence.setups import FittedRuns
from analysis.diagnosis.fit.fit_evidence import Fit
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.judge.misses import LeftOut, Widening, places_left_out, widening_of
from analysis.diagnosis.judge.validation import Stages, gap, stages_of
from analysis.diagnosis.judge.verdict import Gaps


@dataclass(frozen=True)
class Validation:
    """Residuals of the fitted model, without outliers.

    sound, judges, elsewhere: runs (m, k) mm used in the fit, held out, and at an unseen place, without outliers.
    fitted: the sound runs with fitted set-ups.
    stages: stages of the exported model.
    whole, gaps: residuals of the complete model, which decide the condition, and of the exported model.
    widening: factor of the model's uncertainty, from prediction errors.
    doubts: doubts about the outliers.
    """

    sound: Sequence[ObservedRun]
    judges: Sequence[ObservedRun]
    elsewhere: Sequence[ObservedRun]
    fitted: FittedRuns
    stages: Stages
    left_out: LeftOut | None
    whole: Gaps
    gaps: Gaps
    widening: Widening
    doubts: tuple[str, ...]


def validate(evidence: Evidence, fit: Fit, progress: Callable[[str], None]) -> Validation:
    """Return the residuals of the fitted model for the runs used and for the others."""
    progress("validating on held-out runs")
    result = fit.result
    sound, wild = without_outliers(evidence.runs, result.effects, "the runs used")
    fitted = FittedRuns(sound)
    stages = stages_of(fitted, result)
    # Relative to the calibrated model: named effects alone leave residuals that hide outliers of 1 mm.
    judges, judges_with_outliers = without_outliers(evidence.judges, stages.calibrated.effects, "held-out runs")
    elsewhere, outliers_elsewhere = without_outliers(evidence.elsewhere, stages.calibrated.effects, "the unseen place")
    judged_runs = tuple(zip((sound, judges, elsewhere), evidence.uses.names, strict=True))
    left_out = places_left_out(result)
    whole = _gaps(judged_runs, stages, result, left_out)
    if whole.names_do_better:
        stages = stages.without_calibration()
    gaps = _gaps(judged_runs, stages, result, left_out) if whole.names_do_better else whole
    widening = widening_of(left_out, judges, elsewhere, stages, result)
    held_out = gaps.held_out and replace(gaps.held_out, rows=evidence.withheld)
    gaps = replace(gaps, unexplained_um=widening.unexplained_um, beyond_um=widening.beyond_um, held_out=held_out)
    doubts = (*wild, *judges_with_outliers, *outliers_elsewhere)
    return Validation(sound, judges, elsewhere, fitted, stages, left_out, whole, gaps, widening, doubts)


def _gaps(
    judged: Sequence[tuple[Sequence[ObservedRun], Sequence[str]]],
    stages: Stages,
    result: SearchResult,
    left_out: LeftOut | None,
) -> Gaps:
    """Return the gaps of the runs used, held out and elsewhere, each with their names; residuals are (m, k) mm."""
    (sound, used), *others = judged
    held_out, unseen = (gap(runs, stages, result, names) if runs else None for runs, names in others)
    are_places = left_out is not None and len(left_out.rows) == len(result.linear.y)
    return Gaps(
        gap(sound, stages, result, used), held_out, unseen, left_out.rms_um if left_out and are_places else None
    )

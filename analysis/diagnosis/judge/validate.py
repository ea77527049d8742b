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
from analysis.diagnosis.judge.held_out import HeldOut, Widening, held_out_places, widening_of
from analysis.diagnosis.judge.validation import Stages, gap, stages_of
from analysis.diagnosis.judge.verdict import Gaps


@dataclass(frozen=True)
class Validation:
    """Residuals of the fitted model, without outliers.

    fitted: runs (m, k) mm used in the fit, with fitted set-ups.
    judges, elsewhere: runs held out, and at an unseen place.
    stages: stages of the exported model.
    whole, gaps: residuals of the complete model, which decide the condition, and of the exported model.
    widening: factor of the model's uncertainty, from prediction errors.
    doubts: doubts about the outliers.
    """

    fitted: FittedRuns
    judges: Sequence[ObservedRun]
    elsewhere: Sequence[ObservedRun]
    stages: Stages
    places: HeldOut | None
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
    judges, judges_with_outliers = without_outliers(evidence.judges, stages.calibrated, "held-out runs")
    elsewhere, outliers_elsewhere = without_outliers(evidence.elsewhere, stages.calibrated, "the unseen place")
    judged_runs = tuple(zip((sound, judges, elsewhere), evidence.uses.names, strict=True))
    places = held_out_places(result)
    whole = _gaps(judged_runs, fitted, stages, result, places)
    if whole.names_do_better:
        stages = replace(stages, calibrated=stages.named)
    gaps = _gaps(judged_runs, fitted, stages, result, places) if whole.names_do_better else whole
    widening = widening_of(places, judges, elsewhere, fitted, stages.calibrated, result)
    held_out = gaps.held_out and replace(gaps.held_out, rows=evidence.withheld)
    gaps = replace(gaps, unexplained_um=widening.unexplained_um, beyond_um=widening.beyond_um, held_out=held_out)
    doubts = (*wild, *judges_with_outliers, *outliers_elsewhere)
    return Validation(fitted, judges, elsewhere, stages, places, whole, gaps, widening, doubts)


def _gaps(
    judged: Sequence[tuple[Sequence[ObservedRun], Sequence[str]]],
    fitted: FittedRuns,
    stages: Stages,
    result: SearchResult,
    places: HeldOut | None,
) -> Gaps:
    """Return the gaps of the runs used, held out and elsewhere, each with their names; residuals are (m, k) mm."""
    (sound, used), *others = judged
    held_out, unseen = (gap(runs, fitted, stages, result, names) if runs else None for runs, names in others)
    are_places = places is not None and len(places.rows) == len(result.linear.y)
    return Gaps(
        gap(sound, fitted, stages, result, used), held_out, unseen, places.rms_um if places and are_places else None
    )

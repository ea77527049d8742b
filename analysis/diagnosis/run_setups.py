"""Set-ups of observed runs, fitted with the model frozen, both before a diagnosis and wherever a model is judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from analysis.diagnosis.observed_run import ObservedRun
from analysis.fitting import setups as fitting
from analysis.fitting.observation import residuals_of
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.effects import Effect


def with_effects(runs: Sequence[ObservedRun], effects: Sequence[Effect]) -> list[ObservedRun]:
    """Return the runs with effects added to their models."""
    return [replace(run, model=replace(run.model, effects=(*run.model.effects, *effects))) for run in runs]


def fit_run_setups(
    runs: Sequence[ObservedRun], setups: Mapping[str, SetUp] | None = None
) -> tuple[dict[str, SetUp], list[Array]]:
    """Return the fitted set-ups of runs, starting from `setups` where given, and the residuals (m, k) mm of
    each run."""
    placed = fitting.fit_setups([(run.model, run.one) for run in runs], setups)
    return placed, [residuals_of(run.model, [run.one], placed)[0] for run in runs]

"""Set-ups fitted to runs, the model frozen: before anything is diagnosed, and wherever a model is judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from analysis.diagnosis.observed import Seen
from analysis.fitting import setups as fitting
from analysis.fitting.observation import residuals_of
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.effects import Effect


def grown(runs: Sequence[Seen], effects: Sequence[Effect]) -> list[Seen]:
    """Runs with effects in their models."""
    return [replace(run, model=replace(run.model, effects=(*run.model.effects, *effects))) for run in runs]


def settled(runs: Sequence[Seen], setups: Mapping[str, SetUp] | None = None) -> tuple[dict[str, SetUp], list[Array]]:
    """Set-ups of runs, and residuals (m, k) mm of each; `setups`: to begin at."""
    placed = fitting.settled([(run.model, run.one) for run in runs], setups)
    return placed, [residuals_of(run.model, [run.one], placed)[0] for run in runs]

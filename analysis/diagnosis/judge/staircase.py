"""Residual of a model at each step of a staircase, as parts of the error are added one after the other.

Each model is simulated with set-ups fitted to the runs used, as for the gap, which gives the first and last step.
Intermediate steps use some hundred readings of each circle.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.gather import prepare_runs
from analysis.diagnosis.evidence.observation import ObservedRun, thinned
from analysis.diagnosis.evidence.setups import FittedRuns, fit_run_setups
from analysis.diagnosis.fit.responses import Linearisation, linearise, noise_um
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.fit.selection_state import background_terms
from analysis.diagnosis.judge.budget import GapMeasure, group_of
from analysis.diagnosis.judge.budget_part import BudgetPart
from analysis.diagnosis.judge.comparison import Compared, LocatedResidual
from analysis.diagnosis.judge.residuals import ModelResidual, Staircase, StaircaseStep, curves_of, maps_of, places
from analysis.diagnosis.judge.result import Diagnosis
from analysis.runs.loading import Measured
from rigs.calibration import effects_of
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import label_of

_MOST_STEPS = 6
"""Number of parts with a separate step. Chosen: the budget lists all."""
_LEAST = 0.05
"""Minimum rms contribution of a part with a separate step, relative to the gap. Chosen: less is hardly visible."""
_Model = tuple[tuple[int, ...], tuple[Effect, ...]]
"""Indices of the parts that a model adds to the one before, and all its effects."""
_Row = Sequence[float | None]
"""Residuals of a model in µm, and their uncertainties, at each place; None for a place without runs."""


def staircase_of(
    diagnosis: Diagnosis, result: SearchResult, effects: tuple[Effect, ...], *runs_at: Sequence[ObservedRun]
) -> Staircase | None:
    """The staircase of a diagnosis with known budget and gaps; None if the model has no additions. `effects`: of the
    calibrated model. `runs_at`: runs used, held out, and at an unseen place.
    """
    models = list(_models_of(diagnosis, result, effects))
    if len(models) < 2:
        return None
    gaps = (diagnosis.train, diagnosis.held_out, diagnosis.unseen)
    thin = [list(map(thinned, runs)) for runs in runs_at]
    um: list[_Row] = [
        [gap.before_um if gap else None for gap in gaps],
        *_residuals_um([model for _, model in models[1:-1]], thin),
        [gap.calibrated_um if gap else None for gap in gaps],
    ]
    first = [gap.u_um if gap else None for gap in gaps]
    later = [gap.residual_u_um if gap else None for gap in gaps]
    return _staircase(result.linear, models, um, [first, *[later] * (len(models) - 1)])


def _models_of(diagnosis: Diagnosis, result: SearchResult, effects: tuple[Effect, ...]) -> Iterator[_Model]:
    """Yield the initial model, then models with each large part added in order of size, then the calibrated model.
    Scatter, which models cannot remove, has no step.
    """
    budget = diagnosis.budget
    # Addition of each part, by label: fitted effects, or multiples of effects with the same kind and joint in the
    # calibrated background.
    names = {label_of(effect): effect for effect in effects if effect in result.effects}
    terms: dict[str, list[tuple[Effect, float]]] = {}
    for term in background_terms(result.calibrated_posterior) if effects != result.effects else ():
        kind, axis = group_of(term.effect)
        terms.setdefault(BudgetPart(kind, 0.0, 0.0, 0.0, axis=axis).label, []).append((term.effect, term.times))
    added = [k for k, part in enumerate(budget) if part.label in names or part.label in terms]
    added.sort(key=lambda k: -budget[k].um)
    least_um = _LEAST * diagnosis.train.before_um
    large = [k for k in added if budget[k].um >= least_um][:_MOST_STEPS]
    yield (), ()
    fitted, shown = list[Effect](), list[tuple[Effect, float]]()
    for k in large:
        # Parts that cancel share a line of the budget and a step.
        for label in (budget[k].label, *budget[k].cancelled):
            if label in names:
                fitted.append(names[label])
            else:
                shown += terms.get(label, [])
        yield (k,), (*fitted, *effects_of(shown))
    small = tuple(k for k in added if k not in large)
    if small:
        yield small, effects


def located(compared: Compared, rig: Rig, used: Sequence[Measured], unseen: Sequence[Measured] = ()) -> Compared:
    """Add the residual of a rig's model by place, or the reason if it is unknown."""
    try:
        return replace(compared, disagreement=located_residual(rig, used, unseen))
    except FileError as error:
        message = f"where model and readings disagree is unknown: {error}"
        return replace(compared, doubts=(*compared.doubts, message))


def located_residual(rig: Rig, used: Sequence[Measured], unseen: Sequence[Measured] = ()) -> LocatedResidual:
    """Residual of the model of a rig by place; unseen places have separate set-ups. Raises FileError for incompatible
    runs.
    """
    parts, _ = prepare_runs(rig, used, unseen)
    runs, elsewhere = ([replace(run, model=replace(run.model, effects=())) for run in part] for part in parts)
    setups, _ = fit_run_setups(runs)
    linear = linearise(blocks_of(runs, setups), setups)
    # Effects of the rig file by their influence on the readings, then the rest of the calibration.
    measure = GapMeasure(linear)
    um = [measure.um(linear.columns([effect])[:, 0]) for effect in rig.effects]
    models: list[_Model] = [((), ())]
    for k in sorted(range(len(um)), key=lambda k: -um[k]):
        models.append(((k,), (*models[-1][1], rig.effects[k])))
    if rig.calibrated and rig.calibrated.effects:
        models.append(((len(um),), (*models[-1][1], *rig.calibrated.effects)))
    before, after = (measure.residual_mm(effects) for _, effects in (models[0], models[-1]))
    floor_um = float(np.sqrt(np.mean(noise_um(linear) ** 2)))
    staircase = None
    if len(models) > 1:
        rows = [[row[0], None, row[1]] for row in _residuals_um([effects for _, effects in models], (runs, elsewhere))]
        u_um = [floor_um / np.sqrt(max(len(runs_there), 1)) for runs_there in (runs, (), elsewhere)]
        staircase = _staircase(linear, models, rows, [u_um] * len(models))
    return LocatedResidual(
        rig,
        places(linear.blocks, after, measure.scatter_mm()),
        curves_of(linear.blocks, before, after),
        maps_of(linear.blocks, before, after),
        staircase,
        floor_um,
    )


def _staircase(linear: Linearisation, models: Sequence[_Model], um: Sequence[_Row], u_um: Sequence[_Row]) -> Staircase:
    steps, curves, maps, measure = [], [], [], GapMeasure(linear)
    for (parts, effects), um_at, u_at in zip(models, um, u_um, strict=True):
        used, held_out, unseen = (
            None if um_there is None or u is None else ModelResidual(um_there, float(u))
            for um_there, u in zip(um_at, u_at, strict=True)
        )
        assert used is not None  # noqa: S101 - there are always runs used
        steps.append(StaircaseStep(parts, used, held_out, unseen))
        residual = measure.residual_mm(effects)
        curves.append([curve.after_um for curve in curves_of(linear.blocks, residual, residual)])
        maps.append([place.after_um for place in maps_of(linear.blocks, residual, residual)])
    by_circle, by_table = (tuple(map(np.array, zip(*each, strict=True))) for each in (curves, maps))
    return Staircase(tuple(steps), by_circle, by_table)


def _residuals_um(
    models: Sequence[tuple[Effect, ...]], runs_at: Sequence[Sequence[ObservedRun]]
) -> Iterator[list[float | None]]:
    """Yield the residuals of models with these effects for the runs of each place, with set-ups fitted to those of the
    first.
    """
    fitted = FittedRuns(runs_at[0])
    for effects in models:
        yield [fitted.residual_um(effects, runs) if runs else None for runs in runs_at]

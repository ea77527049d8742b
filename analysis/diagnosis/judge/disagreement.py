"""Disagreement between model and readings, and the residual as parts of the error are added to the model step by step.

Each model is simulated with set-ups fitted to the runs used, as for the gap. The first and last step of a diagnosis are
therefore its initial and calibrated gap. Intermediate steps use some hundred readings of each circle, which takes a
thirtieth of the time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.observation import ObservedRun, rms, thinned
from analysis.diagnosis.evidence.prepared_runs import prepare_runs
from analysis.diagnosis.evidence.setups import fit_run_setups, with_effects
from analysis.diagnosis.fit.responses import Linearisation, linearise, noise_um
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.fit.selection_state import background_terms
from analysis.diagnosis.judge.budget import GapMeasure, group_of
from analysis.diagnosis.judge.comparison import Compared, Disagreement
from analysis.diagnosis.judge.residuals import curves_of, maps_of, places
from analysis.diagnosis.judge.result import BudgetPart, Verdict
from analysis.diagnosis.judge.staircase import ModelResidual, Staircase, StaircaseStep
from analysis.diagnosis.judge.validation import FrozenModel, Stages
from analysis.robot.kinematics.arm import Array
from analysis.runs.loading import Measured
from rigs.calibration import effects_of
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import label_of

_MOST_STEPS = 6
"""Number of parts with a separate step. Chosen: a readable number; the budget lists all."""
_LEAST = 0.05
"""Minimum rms contribution of a part with a separate step, relative to the gap. Chosen: less is hardly visible."""
_ROWS = 256
"""Number of readings of a circle used for intermediate steps. Chosen: they give the rms to some percent."""


def staircase_of(
    verdict: Verdict, result: SearchResult, stages: Stages, *runs_at: Sequence[ObservedRun]
) -> Staircase | None:
    """Return the staircase of a diagnosis with known budget and gaps; None if the model has no additions.

    `runs_at`: runs used, held out, and at an unseen place, of (m, k) mm.
    """
    rungs = list(_rungs(verdict, result, stages))
    if len(rungs) < 2:
        return None
    gaps = (verdict.train, verdict.held_out, verdict.unseen)
    residuals_um = [[gap.before_um if gap else None for gap in gaps]]
    thin = [[thinned(run.on_lap, _ROWS) if run.table.swept else run for run in runs] for runs in runs_at]
    residuals_um += _residuals_um_of([effects for _, effects in rungs[1:-1]], thin)
    residuals_um.append([gap.calibrated_um if gap else None for gap in gaps])
    steps = []
    for (parts, _), row in zip(rungs, residuals_um, strict=True):
        used, held_out, unseen = (
            ModelResidual(um, gap.left_u_um if parts else gap.u_um) if gap is not None and um is not None else None
            for gap, um in zip(gaps, row, strict=True)
        )
        assert used is not None  # noqa: S101 - a diagnosis has runs that it used
        steps.append(StaircaseStep(parts, used, held_out, unseen))
    return Staircase(tuple(steps), *_residuals_of_models(result.linear, [effects for _, effects in rungs]))


def _rungs(
    verdict: Verdict, result: SearchResult, stages: Stages
) -> Iterator[tuple[tuple[int, ...], tuple[Effect, ...]]]:
    """Yield the models, each with the budget indices of the additions and with all effects.

    The initial model comes first, then models with each large part added in order of size, then the calibrated model
    with all remaining parts. Scatter, which models cannot remove, has no step.
    """
    effects, budget = stages.calibrated.effects, verdict.budget
    # Addition of each part, by label: fitted effects, or multiples of effects with the same kind and joint in the
    # calibrated background.
    names = {label_of(effect): effect for effect in effects if effect in result.effects}
    terms: dict[str, list[tuple[Effect, float]]] = {}
    for term in background_terms(result.calibrated_posterior) if stages.has_background else ():
        kind, axis = group_of(term.effect)
        terms.setdefault(BudgetPart(kind, 0.0, 0.0, 0.0, axis=axis).label, []).append((term.effect, term.times))
    added = [k for k, part in enumerate(budget) if part.label in names or part.label in terms]
    added.sort(key=lambda k: -budget[k].um)
    least_um = _LEAST * verdict.train.before_um
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
    """Return a comparison with the disagreements between model and readings, of (m, k) mm, or the reason if unknown."""
    try:
        return replace(compared, disagreement=disagreement(rig, used, unseen))
    except FileError as error:
        message = f"where model and readings disagree is unknown: {error}"
        return replace(compared, doubts=(*compared.doubts, message))


def disagreement(rig: Rig, used: Sequence[Measured], unseen: Sequence[Measured] = ()) -> Disagreement:
    """Return the disagreements between the model of a rig and runs, of (m, k) mm; unseen places have separate set-ups.

    Raises FileError for incompatible runs.
    """
    parts, _ = prepare_runs(rig, used, unseen)
    runs, elsewhere = ([replace(run, model=replace(run.model, effects=())) for run in part] for part in parts)
    setups, _ = fit_run_setups(runs)
    linear = linearise(blocks_of(runs, setups), setups)
    # Effects of the rig file by their influence on the readings, then the remainder of the calibration, each with an
    # index.
    measure = GapMeasure(linear)
    um = [measure.um(linear.columns([effect])[:, 0]) for effect in rig.effects]
    groups: list[tuple[int, tuple[Effect, ...]]]
    groups = [(k, (rig.effects[k],)) for k in sorted(range(len(um)), key=lambda k: -um[k])]
    if rig.calibrated and rig.calibrated.effects:
        groups.append((len(um), tuple(rig.calibrated.effects)))
    models = [tuple(effect for _, group in groups[:k] for effect in group) for k in range(len(groups) + 1)]
    curves, maps = _residuals_of_models(linear, models)
    ends = [linear.residual(effects) for effects in (models[0], models[-1])]
    before, after = (linear.in_mm(measure.without_set_up(end)) for end in ends)
    floor_um = float(np.sqrt(np.mean(noise_um(linear) ** 2)))
    u_um = [floor_um / np.sqrt(max(len(runs_there), 1)) for runs_there in (runs, elsewhere)]
    steps = []
    for k, residuals_um in enumerate(_residuals_um_of(models, (runs, elsewhere)) if groups else ()):
        then, later = (
            ModelResidual(um, float(u)) if um is not None else None for um, u in zip(residuals_um, u_um, strict=True)
        )
        assert then is not None  # noqa: S101 - runs were prepared
        steps.append(StaircaseStep((groups[k - 1][0],) if k else (), then, unseen=later))
    staircase = Staircase(tuple(steps), curves, maps) if groups else None
    return Disagreement(
        rig,
        places(linear.blocks, after, measure.scatter_mm()),
        curves_of(linear.blocks, before, after),
        maps_of(linear.blocks, before, after),
        staircase,
        floor_um,
    )


def _residuals_um_of(
    models: Sequence[tuple[Effect, ...]], runs_at: Sequence[Sequence[ObservedRun]]
) -> Iterator[list[float | None]]:
    """Yield the residuals in µm of models with these effects for the runs of each place, of (m, k) mm.

    Set-ups are fitted to the runs of the first place. None for a place without runs.
    """
    setups = None
    for effects in models:
        setups, _ = fit_run_setups(with_effects(runs_at[0], effects), setups)
        model = FrozenModel(effects, setups)
        yield [1e3 * rms(model.residuals(runs)) if runs else None for runs in runs_at]


def _residuals_of_models(
    linear: Linearisation, models: Sequence[tuple[Effect, ...]]
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Return the residuals of models with these effects for circles (steps, n, 2) and targets (steps, n) in µm.

    The set-ups are fitted with the same freedom as for the gap.
    """
    measure, curves, maps = GapMeasure(linear), [], []
    for effects in models:
        residual = linear.in_mm(measure.without_set_up(linear.residual(effects)))
        curves.append([curve.after_um for curve in curves_of(linear.blocks, residual, residual)])
        maps.append([place.after_um for place in maps_of(linear.blocks, residual, residual)])
    return tuple(map(np.array, zip(*curves, strict=True))), tuple(map(np.array, zip(*maps, strict=True)))

"""The parts of the error added to the model one by one, the largest first: what each model leaves of the readings.

Each model is simulated, and its set-ups are fitted to the runs used as those of the gap are, so that the first and the
last step are the gap of the diagnosis before and calibrated. Those between are judged by some hundred readings of each
circle, which takes a thirtieth of the time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from analysis.inference.budget import Measure, group_of
from analysis.inference.observation import ObservedRun, rms, thinned
from analysis.inference.residuals import curves_of, maps_of
from analysis.inference.responses import Linearisation
from analysis.inference.result import BudgetPart, Diagnosis
from analysis.inference.search import SearchResult
from analysis.inference.setups import fit_run_setups, with_effects
from analysis.inference.staircase import Left, Staircase, Step
from analysis.inference.state import background_terms
from analysis.inference.validation import FrozenModel, Stages
from analysis.kinematics.arm import Array
from rigs.calibration import effects_of
from rigs.effects import Effect
from rigs.schema.effect import label_of

_MOST_STEPS = 6
"""Parts with a step of their own. Chosen: more than a person steps through; the budget lists all."""
_LEAST = 0.05
"""Share of the gap that a part makes by itself, root mean square, from which it has a step of its own. Chosen: less is
hardly seen on a chart."""
_ROWS = 256
"""Readings of a circle by which a step between the first and the last is judged. Chosen: they give its root mean square
to some percent."""


def staircase_of(
    diagnosis: Diagnosis, result: SearchResult, stages: Stages, *places: Sequence[ObservedRun]
) -> Staircase | None:
    """Return the staircase of a diagnosis whose budget and gaps are known; `places` are the runs used, the held-out
    runs and those at an unseen place, of (m, k) mm. None where nothing was added to the model."""
    rungs = list(_rungs(diagnosis, result, stages))
    if len(rungs) < 2:
        return None
    gaps = (diagnosis.train, diagnosis.held_out, diagnosis.unseen)
    residuals_um = [[gap.before_um if gap else None for gap in gaps]]
    thin = [[thinned(run.on_lap, _ROWS) if run.table.kind.swept else run for run in runs] for runs in places]
    residuals_um += residuals_um_of([effects for _, effects in rungs[1:-1]], thin)
    residuals_um.append([gap.calibrated_um if gap else None for gap in gaps])
    steps = []
    for (parts, _), row in zip(rungs, residuals_um, strict=True):
        # The uncertainty is that of the acts.
        used, held_out, unseen = (
            Left(um, gap.left_u_um) if gap is not None and um is not None else None
            for gap, um in zip(gaps, row, strict=True)
        )
        assert used is not None  # noqa: S101 - a diagnosis has runs that it used
        steps.append(Step(parts, used, held_out, unseen))
    return Staircase(tuple(steps), *drawn(result.linear, [effects for _, effects in rungs]))


def _rungs(
    diagnosis: Diagnosis, result: SearchResult, stages: Stages
) -> Iterator[tuple[tuple[int, ...], tuple[Effect, ...]]]:
    """Yield the models, each with the places in the budget of what it adds and with all of its effects: the one begun
    with, with each large part, the largest first, and the calibrated one, with all others. What no model removes, as
    scatter, has no step."""
    effects, budget = stages.calibrated.effects, diagnosis.budget
    # What each part adds, by its label: effects as they were fitted, or so many times of those that are of its kind and
    # joint in the calibrated background.
    names = {label_of(effect): effect for effect in effects if effect in result.effects}
    terms: dict[str, list[tuple[Effect, float]]] = {}
    for term in background_terms(result.calibrated_posterior) if stages.has_background else ():
        kind, axis = group_of(term.effect)
        terms.setdefault(BudgetPart(kind, 0.0, 0.0, 0.0, axis=axis).label, []).append((term.effect, term.times))
    added = [k for k, part in enumerate(budget) if part.label in names or part.label in terms]
    added.sort(key=lambda k: -budget[k].um)
    least_um = _LEAST * diagnosis.train.before_um
    large = [k for k in added if budget[k].um >= least_um][:_MOST_STEPS]
    yield (), ()
    fitted, shown = list[Effect](), list[tuple[Effect, float]]()
    for k in large:
        # What cancels a part is on its line of the budget, and comes with it.
        for label in (budget[k].label, *budget[k].cancelled):
            if label in names:
                fitted.append(names[label])
            else:
                shown += terms.get(label, [])
        yield (k,), (*fitted, *effects_of(shown))
    small = tuple(k for k in added if k not in large)
    if small:
        yield small, effects


def residuals_um_of(
    models: Sequence[tuple[Effect, ...]], places: Sequence[Sequence[ObservedRun]]
) -> Iterator[list[float | None]]:
    """Yield what models with these effects leave in µm of the runs of each place, of (m, k) mm, with the set-ups fitted
    to those of the first; None where a place has no runs."""
    setups = None
    for effects in models:
        setups, _ = fit_run_setups(with_effects(places[0], effects), setups)
        model = FrozenModel(effects, setups)
        yield [1e3 * rms(model.residuals(runs)) if runs else None for runs in places]


def drawn(linear: Linearisation, models: Sequence[tuple[Effect, ...]]) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Return what models with these effects leave of each circle (steps, n, 2) and at targets (steps, n) in µm, with
    the set-ups as free as in the gap."""
    measure, curves, maps = Measure(linear), [], []
    for effects in models:
        residual = linear.in_mm(measure.without_set_up(linear.residual(effects)))
        curves.append([curve.after_um for curve in curves_of(linear.blocks, residual, residual)])
        maps.append([place.after_um for place in maps_of(linear.blocks, residual, residual)])
    return tuple(map(np.array, zip(*curves, strict=True))), tuple(map(np.array, zip(*maps, strict=True)))

"""The calibrated model: the posterior of a diagnosis as terms with their mean and covariance.

The effects that were fitted come first, each as it was fitted. Every form of the background follows: its effect at the
size at which its column was computed, and how many times of it the readings show on average. Single forms are rarely
certain, and their sum is: it is what reaches a tenth of a millimetre where named effects reach half of one.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from importlib.metadata import version

import numpy as np

from analysis.diagnosis.background import Posterior
from analysis.diagnosis.background_effects import background_terms
from analysis.diagnosis.diagnosis import Gap
from analysis.diagnosis.observed_run import ObservedRun
from analysis.diagnosis.refine import Unknown
from analysis.diagnosis.search import SearchResult
from analysis.diagnosis.validation import Stages
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from analysis.traces.loading import Measured
from analysis.traces.tables import PoseTable
from rigs.calibration import (
    TIMES,
    CalibratedModel,
    CalibratedRun,
    Parameter,
    PlacedSetUp,
    Term,
    packed_factor,
)
from rigs.effects import Effect
from rigs.rig import Rig

_LEAST = 1e-9
"""Added to the correlation of each parameter with itself before its root is taken: twins are correlated by one within
rounding."""


def covariance_of(posterior: Posterior, unknowns: Sequence[Unknown]) -> Array:
    """Return the covariance (P, P) of the fitted unknowns, each in the unit of its name, and then of the numbers of
    times that forms show."""
    columns = posterior.background.columns
    forms, fitted = columns.set_ups.start, len(unknowns)
    sizes = np.repeat([form.size for form in columns.forms], [len(form.columns) for form in columns.forms])
    found = posterior.joint_covariance(forms, fitted)
    unit = np.concatenate([np.ones(fitted), 1 / sizes])
    return np.asarray(unit[:, None] * found * unit, dtype=float)


def calibrated_model(  # noqa: PLR0913, PLR0917 - it gathers what a diagnosis knows
    rig: Rig,
    result: SearchResult,
    standing: Sequence[Effect],
    used: Sequence[Measured],
    runs: Sequence[ObservedRun],
    stages: Stages,
    train: Gap,
    elsewhere: Gap | None,
    widened: float = 1.0,
) -> CalibratedModel:
    """Return the calibrated model of a search about a rig: its posterior, with the effects `standing` marked as those
    that the rig file names, the range of each joint in the `runs`, the set-ups of the last of the `stages`, what is
    left of them and `elsewhere`, and its uncertainty `widened` by a factor."""
    effects, unknowns = result.state.refined.effects, result.state.refined.unknowns
    terms = [Term.model_construct(effect=one, times=1.0, named=one in standing) for one in effects]
    more = background_terms(result.calibrated_posterior)
    if not stages.has_background:
        more = [term.model_copy(update={"times": 0.0}) for term in more]
    parameters = [Parameter.model_construct(term=one.effect, field=one.field) for one in unknowns]
    parameters += [Parameter.model_construct(term=len(terms) + k, field=TIMES) for k in range(len(more))]
    root = widened * _root(covariance_of(result.calibrated_posterior, unknowns))
    angles = np.degrees(np.concatenate([run.one.table.q[run.one.rows] for run in runs]))
    found = CalibratedModel.model_construct(
        format=1,
        rig=rig.name,
        date=dt.datetime.now(dt.UTC).date(),
        version=version("rig"),
        runs=tuple(CalibratedRun(name=one.run.manifest.name, sha256=one.run.readings_sha256) for one in used),
        joints_deg=tuple(zip(angles.min(axis=0).tolist(), angles.max(axis=0).tolist(), strict=True)),
        setups={name: _placed(setup, poses=_is_poses(name, runs)) for name, setup in stages.calibrated.items()},
        before_um=train.before_um,
        calibrated_um=train.calibrated_um,
        held_out_um=elsewhere.calibrated_um if elsewhere else None,
        widened=widened,
        terms=(*terms, *more),
        parameters=tuple(parameters),
        factor=packed_factor(root),
    )
    return found if rig.calibrated is None else _beside(rig.calibrated, found)


def _beside(before: CalibratedModel, found: CalibratedModel) -> CalibratedModel:
    """Return a calibration that was found beside another one, with the terms of both. How many times a term shows adds
    up, and so does its variance, as if both were independent."""
    terms, parameters = list(before.terms), list(before.parameters)
    known = {(terms[one.term].effect, one.field): k for k, one in enumerate(parameters) if one.field == TIMES}
    first, place = len(terms), []
    for one in found.parameters:
        term = found.terms[one.term]
        place.append(known.get((term.effect, one.field), len(parameters)))
        if place[-1] == len(parameters):
            parameters.append(one.model_copy(update={"term": first + one.term}))
    same = {found.parameters[j].term: parameters[k].term for j, k in enumerate(place) if k < len(before.parameters)}
    terms += [term.model_copy(update={"times": 0.0}) if k in same else term for k, term in enumerate(found.terms)]
    for k, old in same.items():
        terms[old] = terms[old].model_copy(update={"times": terms[old].times + found.terms[k].times})
    covariance = np.zeros((len(parameters), len(parameters)))
    count = len(before.parameters)
    covariance[:count, :count] = before.root @ before.root.T
    covariance[np.ix_(place, place)] += found.root @ found.root.T
    joints = [
        (min(one[0], other[0]), max(one[1], other[1]))
        for one, other in zip(before.joints_deg, found.joints_deg, strict=True)
    ]
    # A copy would keep the root and the effects that are known of the one found.
    fields = {name: getattr(found, name) for name in CalibratedModel.model_fields}
    fields |= {
        "runs": (*before.runs, *found.runs), "joints_deg": tuple(joints), "terms": tuple(terms),
        "parameters": tuple(parameters), "factor": packed_factor(_root(covariance)),
    }  # fmt: skip
    return CalibratedModel.model_construct(**fields)


def _root(covariance: Array) -> Array:
    """Return a lower triangular root (P, P) of a covariance."""
    sd = np.sqrt(np.diag(covariance))
    unit = np.where(sd > 0, sd, 1.0)
    correlation = covariance / unit[:, None] / unit
    correlation[np.diag_indices_from(correlation)] += _LEAST
    return np.asarray(unit[:, None] * np.linalg.cholesky(correlation), dtype=float)


def _is_poses(setup: str, runs: Sequence[ObservedRun]) -> bool:
    return any(run.one.setup == setup and isinstance(run.one.table, PoseTable) for run in runs)


def _placed(setup: SetUp, *, poses: bool) -> PlacedSetUp:
    if poses:
        both = (setup.T_instrument_world, setup.T_tool_target)
        placed = [tuple(tuple(row) for row in one.tolist()) for one in both]
        return PlacedSetUp(T_instrument_world=placed[0], T_tool_target=placed[1])
    x, y, z = setup.ball.tolist()
    return PlacedSetUp(ball_mm=(x, y, z), zeros_mm=tuple(setup.zeros_mm.tolist()))

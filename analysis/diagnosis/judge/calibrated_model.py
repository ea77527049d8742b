"""Calibrated model from a verdict: the posterior as terms with mean and covariance.

The fitted effects come first, then every form of the background with the mean multiple shown by the readings. Single
forms are rarely certain, but their sum is.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.fit.selection_state import background_terms
from analysis.diagnosis.judge.result import Diagnosis
from analysis.diagnosis.judge.validate import Validation
from analysis.robot.kinematics.arm import Array, rail_mm
from analysis.robot.predict import SetUp
from analysis.runs.loading import Measured
from analysis.runs.noise.readings import evenly
from rigs.calibration import (
    MOST_POSTURES,
    TIMES,
    CalibratedModel,
    CalibratedRun,
    CovarianceParameter,
    ModelAssessment,
    PlacedSetUp,
    Term,
    covariance_root,
    limited_root,
    packed_factor,
)
from rigs.distribution import version


def covariance_of(result: SearchResult) -> Array:
    """Covariance (P, P) of the fitted unknowns, in their units, followed by the multiples of the forms."""
    unit = np.concatenate([np.ones(len(result.fit.unknowns)), 1 / result.columns.sizes])
    without_set_ups = result.covariance[: len(unit), : len(unit)]
    return np.asarray(unit[:, None] * without_set_ups * unit, dtype=float)


def calibrated_model(
    diagnosis: Diagnosis,
    result: SearchResult,
    used: Sequence[Measured],
    runs: Sequence[ObservedRun],
    validation: Validation,
    judged: ModelAssessment | None = None,
) -> CalibratedModel:
    """The calibrated model of a search: posterior, ranges of the joints, set-ups, residuals, and widened
    uncertainty.
    """
    wider, setups = validation.widening, validation.fitted.fit_with_effects(validation.calibrated)[0]
    rig, train, elsewhere = diagnosis.rig, diagnosis.train, diagnosis.unseen or diagnosis.held_out
    named = [name.effect for name in diagnosis.written]
    effects, unknowns = result.effects, result.fit.unknowns
    terms = [Term.model_construct(effect=effect, times=1.0, named=effect in named) for effect in effects]
    background = background_terms(result.calibrated_posterior)
    if validation.calibrated == result.effects:
        background = [term.model_copy(update={"times": 0.0}) for term in background]
    parameters = [CovarianceParameter.model_construct(term=unknown.effect, field=unknown.field) for unknown in unknowns]
    parameters += [
        CovarianceParameter.model_construct(term=len(terms) + k, field=TIMES) for k in range(len(background))
    ]
    root = wider.factor * covariance_root(covariance_of(result))
    arm, q = runs[0].model.arm, np.concatenate([run.table.q[run.rows] for run in runs])
    angles, rail = np.degrees(q[:, : arm.axes]), rail_mm(arm, q)
    of_poses = {run.setup for run in runs if run.facts.of_places}
    calibrated = CalibratedModel.model_construct(
        format=1,
        rig=rig.name,
        date=dt.datetime.now(dt.UTC).date(),
        version=version(),
        runs=tuple(CalibratedRun(name=run.run.manifest.name, sha256=run.run.readings_sha256) for run in used),
        joints_deg=tuple(zip(angles.min(axis=0).tolist(), angles.max(axis=0).tolist(), strict=True)),
        postures_deg=_measured_postures(runs) if arm.rail is None else (),
        rail_mm=(float(rail.min()), float(rail.max())) if arm.rail is not None else None,
        setups={name: _placed(setup, poses=name in of_poses) for name, setup in setups.items()},
        before_um=train.before_um,
        calibrated_um=train.calibrated_um,
        held_out_um=elsewhere.calibrated_um if elsewhere else None,
        widened=wider.factor,
        reach_mm=wider.reach_mm,
        judged=judged,
        terms=(*terms, *background),
        parameters=tuple(parameters),
        factor=packed_factor(limited_root(root, (*terms, *background), parameters)),
    )
    return calibrated if rig.calibrated is None else _combine_calibrations(rig.calibrated, calibrated)


_POSTURE_DECIMALS = 2
"""Decimals of measured postures in degrees: 0.17 mm at 1 m, far below the size of a frame."""


def _measured_postures(runs: Sequence[ObservedRun]) -> tuple[tuple[float, ...], ...]:
    """Postures in degrees, evenly drawn from the readings of positions."""
    measured = [run.table.q[run.rows][:, : run.model.arm.axes] for run in runs if run.facts.of_places]
    if not measured:
        return ()
    q = np.degrees(np.concatenate(measured))
    rows = evenly(len(q), MOST_POSTURES)
    return tuple(tuple(row) for row in q[rows].round(_POSTURE_DECIMALS).tolist())


def _combine_calibrations(before: CalibratedModel, new: CalibratedModel) -> CalibratedModel:
    """Combine a calibration with an earlier one. Multiples of a term add up, and so do the variances, as if
    independent.
    """
    terms, parameters = list(before.terms), list(before.parameters)
    times_row = {
        terms[parameter.term].effect: row for row, parameter in enumerate(parameters) if parameter.field == TIMES
    }
    # The new terms follow the earlier terms, and so do their parameter rows. Only the multiple of an effect that exists
    # in both moves to the earlier row and term. Its new term stays with a multiple of zero, because other parameters
    # may belong to it.
    first_new, new_rows, same_term = len(terms), list[int](), dict[int, int]()
    for parameter in new.parameters:
        row = times_row.get(new.terms[parameter.term].effect) if parameter.field == TIMES else None
        if row is None:
            row = len(parameters)
            parameters.append(parameter.model_copy(update={"term": first_new + parameter.term}))
        else:
            same_term[parameter.term] = parameters[row].term
        new_rows.append(row)
    terms += [term.model_copy(update={"times": 0.0}) if k in same_term else term for k, term in enumerate(new.terms)]
    for of_new, of_before in same_term.items():
        times = terms[of_before].times + new.terms[of_new].times
        terms[of_before] = terms[of_before].model_copy(update={"times": times})
    covariance = np.zeros((len(parameters), len(parameters)))
    count = len(before.parameters)
    covariance[:count, :count] = before.root @ before.root.T
    covariance[np.ix_(new_rows, new_rows)] += new.root @ new.root.T
    ranges = zip(before.joints_deg, new.joints_deg, strict=True)
    joints = [(min(low, new_low), max(high, new_high)) for (low, high), (new_low, new_high) in ranges]
    root = limited_root(covariance_root(covariance), terms, parameters)
    rails = [model.rail_mm for model in (before, new) if model.rail_mm]
    return new.with_values(
        rail_mm=(min(low for low, _ in rails), max(high for _, high in rails)) if rails else None,
        runs=(*before.runs, *new.runs), joints_deg=tuple(joints),
        postures_deg=_half_of_each(before.postures_deg, new.postures_deg),
        terms=tuple(terms), parameters=tuple(parameters), factor=packed_factor(root),
    )  # fmt: skip


def _half_of_each(
    before: tuple[tuple[float, ...], ...], new: tuple[tuple[float, ...], ...]
) -> tuple[tuple[float, ...], ...]:
    """The postures of two calibrations, every second one if they are too many."""
    step = 2 if len(before) + len(new) > MOST_POSTURES else 1
    return (*before[::step], *new[::step])


def _placed(setup: SetUp, *, poses: bool) -> PlacedSetUp:
    if poses:
        both = (setup.T_instrument_world, setup.T_tool_target)
        placed = [tuple(tuple(row) for row in frame.tolist()) for frame in both]
        return PlacedSetUp(T_instrument_world=placed[0], T_tool_target=placed[1])
    x, y, z = setup.ball.tolist()
    return PlacedSetUp(ball_mm=(x, y, z), zeros_mm=tuple(setup.zeros_mm.tolist()))

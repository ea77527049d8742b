from functools import cache

import numpy as np
import pytest

from analysis import calibrate
from analysis.diagnosis.fit.search import SearchResult, search
from analysis.diagnosis.fit.selection_state import background_effects, background_terms
from analysis.diagnosis.judge.calibrated_model import (  # private: a diagnosis of a calibrated arm takes a minute
    _combine_calibrations,
    covariance_of,
)
from analysis.diagnosis.judge.held_out import factor_of_few_places
from rigs.calibration import TIMES, CalibratedModel, CovarianceParameter, Term, packed_factor
from rigs.effects import Backlash, Effect, GaugeScale, JointOffset, LinkGeometry, TransmissionError
from tests.support.diagnosis_cells import circles, demo, seen
from tests.support.handmade_calibration import calibrated_model
from tests.support.pose_runs import cell_with, pose_run

USUAL: tuple[Effect, ...] = (
    JointOffset(axis=2, offset_deg=0.012),
    JointOffset(axis=3, offset_deg=-0.016),
    TransmissionError(axis=2, order=2, amplitude_deg=0.004, phase_deg=80),
    TransmissionError(axis=5, order=3, amplitude_deg=0.004, phase_deg=200),
    LinkGeometry(axis=2, field="a", delta=0.15),
    Backlash(axis=4, width_deg=0.008, transit=0.3),
    GaugeScale(gauge="g1", relative=4e-4),
)


@cache
def _searched() -> SearchResult:
    return search(seen(circles(USUAL, seed=61, ways=("acw",))), lambda doing: None)


def test_effects_agree_with_their_columns():
    result = _searched()
    columns = result.posterior.background.columns
    said = columns.X[:, : columns.set_ups.start] @ result.posterior.mean[: columns.set_ups.start]
    names = result.effects
    both = (result.linear.residual(names), result.linear.residual((*names, *background_effects(result.posterior))))
    done = result.linear.without_set_up(both[0] - both[1])
    expected = result.linear.without_set_up(said)
    assert np.linalg.norm(expected) > 20  # there is something to do
    assert np.linalg.norm(done - expected) < 0.01 * np.linalg.norm(expected)
    assert len(background_terms(result.posterior)) == columns.set_ups.start


def test_the_covariance_is_one():
    result = _searched()
    covariance = covariance_of(result)
    sd = np.sqrt(np.diag(covariance))
    assert np.isfinite(covariance).all() and (sd >= 0).all()
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-9 * sd.max() ** 2)
    unit = np.where(sd > 0, sd, 1.0)
    assert np.linalg.eigvalsh(covariance / unit[:, None] / unit).min() > -1e-6
    columns = result.posterior.background.columns
    fitted = len(result.fit.unknowns)
    forms = result.covariance[fitted : len(covariance), fitted : len(covariance)]
    sizes = np.repeat([form.size for form in columns.forms], [len(form.columns) for form in columns.forms])
    np.testing.assert_allclose(covariance[fitted:, fitted:], forms / sizes[:, None] / sizes, rtol=1e-6, atol=1e-9)


def test_calibration_contains_the_results_of_a_diagnosis():
    found = demo()
    model = found.calibrated
    assert model and CalibratedModel.model_validate_json(model.model_dump_json()) == model
    assert [one.effect for one in model.terms if one.named] == [one.effect for one in found.standing]
    assert model.before_um == found.train.before_um and model.calibrated_um == found.train.calibrated_um
    judge = found.held_out or found.unseen
    assert judge and model.held_out_um == judge.calibrated_um
    assert {run.name for run in model.runs} == set(found.runs) and set(model.setups) == {"yaw"}
    assert all(low < high for low, high in model.joints_deg)
    fields = {(model.terms[one.term].effect.effect, one.field) for one in model.parameters}
    assert {("backlash", "width_deg"), ("joint_offset", TIMES)} <= fields


def test_two_calibrations_add_up_their_times_and_their_variances():
    same, other = JointOffset(axis=3, offset_deg=0.02), JointOffset(axis=4, offset_deg=0.02)
    new = LinkGeometry(axis=3, field="a", delta=0.2)
    first, second = _model([(same, 0.5), (other, -1.0)], 1), _model([(new, 2.0), (same, 0.25)], 2)
    both = _combine_calibrations(first, second)
    times: dict[Effect, float] = {}
    for term in both.terms:
        times[term.effect] = times.get(term.effect, 0.0) + term.times
    assert times == {same: 0.75, other: -1.0, new: 2.0}
    of = {both.terms[one.term].effect: k for k, one in enumerate(both.parameters)}
    covariance, one, two = (model.root @ model.root.T for model in (both, first, second))
    assert covariance[of[same], of[same]] == pytest.approx(one[0, 0] + two[1, 1], rel=1e-5)
    assert covariance[of[same], of[other]] == pytest.approx(one[0, 1], rel=1e-5)
    assert covariance[of[same], of[new]] == pytest.approx(two[0, 1], rel=1e-5)
    assert covariance[of[other], of[new]] == pytest.approx(0.0, abs=1e-6)
    assert both.runs == (*first.runs, *second.runs) and both.joints_deg[0] == (-40.0, 40.0)
    assert CalibratedModel.model_validate_json(both.model_dump_json()) == both


def _model(terms: list[tuple[Effect, float]], seed: int) -> CalibratedModel:
    root = np.tril(np.random.default_rng(seed).normal(size=(len(terms), len(terms))))
    return calibrated_model(
        terms=tuple(Term(effect=effect, times=times) for effect, times in terms),
        parameters=tuple(CovarianceParameter(term=k, field=TIMES) for k in range(len(terms))),
        factor=packed_factor(root),
        joints_deg=((-20.0 * seed, 20.0 * seed),) * 6,
    )


@pytest.mark.parametrize(
    ("neighbourhoods", "expected"),
    [(2, 1.654), (4, 1.654), (5, 1.435), (7, 1.259), (20, 1.0)],  # t of 3, 3, 4 and 6 degrees of freedom for 95.45 %
)
def test_factor_is_at_least_students_t_of_the_neighbourhoods(neighbourhoods, expected):
    assert factor_of_few_places(neighbourhoods) == pytest.approx(expected, abs=2e-3)


def test_a_calibration_by_few_poses_has_a_widened_u():
    run = cell_with("ur10e", [{}], np.random.default_rng(21)).runs[0]
    few = pose_run("ur10e", run.table.q[:22], run.table.xyz_mm[:22])
    calibrated = calibrate([few]).calibrated
    assert calibrated.widened > 1.13  # Student of eleven neighbourhoods

"""The calibrated model: effects do what the linear columns said, its covariance is one, two of them add up, and the
same runs with the file that was written show the figure that was stated."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.report.diagnosis_report import write_extended
from analysis.diagnosis.fit.search import SearchResult, search
from analysis.diagnosis.fit.selection_state import background_effects, background_terms
from analysis.diagnosis.judge.calibrated_model import (  # private: a diagnosis of a calibrated arm takes a minute
    _combine_calibrations,
    covariance_of,
)
from analysis.diagnosis.judge.result import Diagnosis
from rigs.calibration import TIMES, CalibratedModel, CovarianceParameter, Term, packed_factor
from rigs.effects import Backlash, Effect, GaugeScale, JointOffset, LinkGeometry, TransmissionError
from rigs.load import load
from tests.support.diagnosis_cells import RIG, TEXT, circles, demo, found_in, poses, seen
from tests.support.handmade_calibration import calibrated_model
from tests.support.made_once import made_once
from tests.support.nightly import cases

USUAL: tuple[Effect, ...] = (
    JointOffset(axis=2, offset_deg=0.012),
    JointOffset(axis=3, offset_deg=-0.016),
    TransmissionError(axis=2, order=2, amplitude_deg=0.004, phase_deg=80),
    TransmissionError(axis=5, order=3, amplitude_deg=0.004, phase_deg=200),
    LinkGeometry(axis=2, field="a", delta=0.15),
    Backlash(axis=4, width_deg=0.008, transit=0.3),
    GaugeScale(gauge="g1", relative=4e-4),
)
PLAY = Backlash(axis=1, width_deg=0.03, transit=0.2)


@cache
def _searched() -> SearchResult:
    return search(seen(circles(USUAL, seed=61, ways=("acw",))), lambda doing: None)


@made_once
def _found() -> Diagnosis:
    return found_in(circles((PLAY, *USUAL), seed=62), held_out=circles((PLAY, *USUAL), seed=63, count=1))


def test_the_effects_do_what_the_columns_say() -> None:
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


def test_the_covariance_is_one() -> None:
    result = _searched()
    covariance = covariance_of(result)
    sd = np.sqrt(np.diag(covariance))
    assert np.isfinite(covariance).all() and (sd >= 0).all()
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-9 * sd.max() ** 2)
    unit = np.where(sd > 0, sd, 1.0)
    assert np.linalg.eigvalsh(covariance / unit[:, None] / unit).min() > -1e-6
    columns = result.posterior.background.columns
    fitted = len(result.fit.unknowns)
    forms = result.covariance(columns.set_ups.start)[fitted:, fitted:]
    sizes = np.repeat([form.size for form in columns.forms], [len(form.columns) for form in columns.forms])
    np.testing.assert_allclose(covariance[fitted:, fitted:], forms / sizes[:, None] / sizes, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("make", cases((demo, _found), (demo,)))
def test_a_calibration_holds_what_a_diagnosis_knows(make: Callable[[], Diagnosis]) -> None:
    found = make()
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


def test_the_same_runs_with_the_rig_file_that_was_written_show_the_figure_that_was_stated(tmp_path: Path) -> None:
    found = _found()
    names = [one.effect for one in found.standing]
    *_, rig_file = write_extended(TEXT, names, tmp_path / "cell.yaml", found.calibrated)
    again = found_in(
        circles((PLAY, *USUAL), seed=62), RIG.modelled_as(load(rig_file)[0]), circles((PLAY, *USUAL), seed=63, count=1)
    )
    assert found.train.before_um > 10 * found.train.calibrated_um
    assert again.train.before_um == pytest.approx(found.train.calibrated_um, rel=0.05)
    assert found.held_out and again.held_out
    assert again.held_out.before_um == pytest.approx(found.held_out.calibrated_um, rel=0.05)
    assert again.condition == "nothing_unusual" and again.standing == ()
    assert again.calibrated and set(found.calibrated.runs) <= set(again.calibrated.runs)  # type: ignore[union-attr]


def test_poses_keep_their_figure_too(tmp_path: Path) -> None:
    runs = [poses(5, *(JointOffset(axis=axis, offset_deg=0.01 * (-1) ** axis) for axis in range(1, 6)))]
    found = found_in(runs)
    *_, rig_file = write_extended(TEXT, [one.effect for one in found.standing], tmp_path / "p.yaml", found.calibrated)
    again = found_in(runs, RIG.modelled_as(load(rig_file)[0]))
    assert found.train.before_um > 1.3 * found.train.calibrated_um
    assert again.train.before_um == pytest.approx(found.train.calibrated_um, rel=0.05)


def test_two_calibrations_add_up_their_times_and_their_variances() -> None:
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

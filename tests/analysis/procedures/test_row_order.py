from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.observation import in_content_order, observe
from analysis.procedures import pose, touch
from analysis.procedures.shared.test_kind import nominal_setup, path_of, predict
from analysis.robot.kinematics.arm import arm_of
from analysis.robot.model.predict import model_of
from analysis.runs.stands import rows_per_standstill
from analysis.runs.tables import PoseTable, TouchTable
from rigs.effects import Backlash, ThermalGrowth
from rigs.load import load

RIG = load("ur10e")[0].model_copy(update={"effects": ()})
RNG = np.random.default_rng(4)
Q = np.radians([0, -80, 100, -20, 80, 0]) + np.radians(RNG.uniform(-1, 1, (30, 6)) * [60, 25, 25, 60, 40, 80])
Q = np.repeat(Q, 2, axis=0)[RNG.permutation(60)]  # each posture is visited twice
MODEL, NOWHERE = model_of(RIG), PoseTable(Q, Q[:, :3], None)
EXACT = predict(MODEL, NOWHERE, path_of(MODEL, NOWHERE), nominal_setup(RIG, NOWHERE))[:, [3, 7, 11]]
XYZ = EXACT + RNG.normal(0, 0.1, (60, 3))
ORDER = RNG.permutation(60)


def tables() -> list[PoseTable | TouchTable]:
    return [PoseTable(Q, XYZ, None), TouchTable(np.array(["A", "B"])[np.arange(60) % 2], Q)]


def permuted(table: PoseTable | TouchTable) -> PoseTable | TouchTable:
    columns = {name: values[ORDER] for name, values in vars(table).items() if isinstance(values, np.ndarray)}
    return replace(table, **columns)


@pytest.mark.parametrize("table", tables(), ids=["poses", "touches"])
def test_figures_and_their_uncertainties_are_equal(table):
    def figures(one: PoseTable | TouchTable) -> dict[str, tuple[float, float]]:
        if isinstance(one, PoseTable):
            found = pose.evaluate(one, arm_of(RIG.robot), 0.02).figures
        else:
            found = touch.evaluate(one, model_of(RIG)).figures
        return {name: (figure.value, figure.u) for name, figure in found.items()}

    here, there = figures(table), figures(permuted(table))
    assert here.keys() == there.keys()
    for name, values in here.items():
        assert there[name] == pytest.approx(values, rel=1e-9), name


def test_errors_keep_the_order_of_the_table():
    one = PoseTable(Q, XYZ, None)
    here, there = (pose.evaluate(each, arm_of(RIG.robot), 0.02) for each in (one, permuted(one)))
    np.testing.assert_allclose(here.position_mm[ORDER], there.position_mm, atol=1e-9)


@pytest.mark.parametrize("came", [False, True])
def test_each_row_is_predicted_by_itself(came):
    effects = (Backlash(axis=2, width_deg=0.2), ThermalGrowth(ppm=100.0, time_constant_s=60.0))
    model = model_of(RIG, effects)
    one = PoseTable(Q, XYZ, None, came_from=Q - 0.1 if came else None)
    here, there = (
        predict(model, each, path_of(model, each), nominal_setup(RIG, each)) for each in (one, permuted(one))
    )
    np.testing.assert_allclose(here[ORDER], there, atol=1e-9)
    without = predict(model_of(RIG, effects[1:]), one, path_of(model, one), nominal_setup(RIG, one))
    assert bool(np.abs(here - without).max() > 0.1) == came  # a side comes from the columns that state it


def test_a_fit_sees_the_rows_in_one_order():
    model, one = model_of(RIG), PoseTable(Q, XYZ, None)
    here, there = (in_content_order(observe(model, each, "x")) for each in (one, permuted(one)))
    np.testing.assert_array_equal(here.values, there.values)


def test_chance_neighbours_are_no_stand():
    visits = PoseTable(Q, XYZ, None)
    assert rows_per_standstill(visits).tolist() == [1] * 60
    stands = replace(visits, q=np.repeat(Q[:20], 3, axis=0), xyz_mm=np.repeat(XYZ[:20], 3, axis=0))
    assert rows_per_standstill(stands).max() >= 3

import numpy as np
import pytest

from analysis.procedures.checks.check_runs import findings_of
from analysis.procedures.checks.units import unit_findings
from analysis.procedures.pose import groups
from analysis.robot.kinematics.joint_limits import impossible_rad, wrapped
from analysis.runs.joint_turns import beyond_limits, turns_further, without_whole_turns
from analysis.runs.tables import CircleTable, PoseTable
from rigs.load import load
from tests.support.conventions import cells, run_of


def test_inverted_gauges_are_detected_despite_a_winding_joint():
    runs = cells()["driven on 4"].runs
    for way in ("decisive", "correct"):
        sign = -1.0 if way == "decisive" else 1.0
        tables = [run.table for run in runs]
        turned = [
            run_of(CircleTable(t.test, t.direction, t.t_s, t.q, sign * t.g_mm), run.run.manifest.name, run.rig)
            for run, t in zip(runs, tables, strict=True)
            if isinstance(t, CircleTable)
        ]
        assert [one.strength for one in findings_of(turned)] == ["decisive"] * (sign < 0)


def test_a_wrist_that_winds_on_is_no_mistake_of_units():
    q = np.radians(np.random.default_rng(1).uniform(-120, 120, (40, 6)))
    q[:, 5] += np.linspace(0, 9 * 2 * np.pi, 40)
    assert impossible_rad(q) == 0.0
    assert not list(unit_findings(PoseTable(q, np.ones((40, 3)), None), load("ur10-cell")[0]))
    assert impossible_rad(np.degrees(q)) > 100


def test_visits_of_one_posture_are_one_group_modulo_a_turn():
    q = np.radians(
        [[10.0, -20, 30, 180.0, 40, -179.99], [10.0, -20, 30, -180.0, 40, 180.01], [10.0, -20, 30, 0, 40, 0]]
    )
    assert groups(q, np.radians(0.1)).tolist() == [0, 0, 1]
    assert np.abs(wrapped(np.array([np.pi, -np.pi, 3 * np.pi])) - np.pi).max() < 1e-12


@pytest.mark.parametrize("name", cells())
def test_sound_cell_passes_and_broken_convention_is_reported(name):
    cell = cells()[name]
    found = findings_of(cell.runs)
    assert any(map(cell.is_named, found)) if cell.convention else found == []


RIG = load("ur10e-cell")[0].model_copy(update={"effects": ()})
LIMITS = np.radians([-360.0, 360.0])
RNG = np.random.default_rng(8)


def table(counted: int) -> PoseTable:
    q = np.radians(RNG.uniform(-60, 60, (40, 6)))
    q[30:, 3] += counted * 2 * np.pi
    return PoseTable(q, RNG.normal(size=(40, 3)), None)


@pytest.mark.parametrize("counted", [-1, 1])
def test_rows_a_whole_turn_away_are_counted_back_and_named(counted):
    turned, doubts = without_whole_turns(table(counted), RIG)
    assert np.ptp(np.degrees(turned.q[:, 3])) < 120
    assert len(doubts) == 1 and "axis 4" in doubts[0] and "rows 31 to 40" in doubts[0]


def test_rows_one_turn_lower_are_corrected_together():
    """The angle of -354° is a turn too low, like those below -360°, but within the limits of 360°."""
    angle = np.concatenate([RNG.uniform(-170, 170, 40), [-466.8, -400.0, -380.0, -354.1]])
    assert turns_further(np.radians(angle), LIMITS).tolist() == [0] * 40 + [-1] * 4
    typo = np.radians(np.append(RNG.uniform(-350, 350, 60), 400.0))
    assert turns_further(typo, LIMITS).tolist() == [0] * 60 + [1]  # the joint really turns


def test_joint_outside_its_limits_is_named_with_rows_and_value():
    one = table(0)
    one.q[4, 1] = np.radians(400.0)
    (doubt,) = beyond_limits(one, RIG)
    assert "axis 2" in doubt and "400.0°" in doubt and "in row 5" in doubt
    assert beyond_limits(table(0), RIG) == ()

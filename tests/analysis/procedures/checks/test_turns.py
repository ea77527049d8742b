import numpy as np
import pytest

from analysis.procedures.checks.check_runs import findings_of
from analysis.procedures.checks.columns import unit_findings
from analysis.procedures.pose import groups
from analysis.robot.kinematics.joint_limits import impossible_rad, wrapped
from analysis.runs.tables import CircleTable, PoseTable
from rigs.load import load
from tests.support import driven_on
from tests.support.conventions import cells, run_of
from tests.support.driven_on import Drive, drive
from tests.worlds.arms.independent_arm import none


@pytest.mark.parametrize("name", driven_on.ROBOTS)
def test_the_robots_of_these_tests_wind_a_wrist(name):
    assert np.abs(driven_on.winds(name)).sum() == 1


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


def test_a_turn_added_to_a_joint_changes_nothing():
    """The same lap with joint 4 a turn on in the cw run alone, and a play of axis 1 that is to be seen."""
    rng, play = np.random.default_rng(5), np.radians([0.03, 0, 0, 0, 0, 0])
    rig = load("paper-fanuc")[0]
    for turns in ((0,) * 6, (0, 0, 0, 1, 0, 0), (0, 0, 0, -1, 0, 1)):
        runs = []
        for sense, way in ((1, "acw"), (-1, "cw")):
            one = Drive("yaw", sense, turns=turns if sense < 0 else (0,) * 6)
            got = drive("paper-fanuc", one, none(), rng, play_rad=play)
            runs.append(run_of(CircleTable("yaw", way, got.t_s, got.q, got.g_mm), way, rig))
        assert findings_of(runs) == []


def test_a_wrist_that_winds_on_is_no_mistake_of_units():
    q = np.radians(np.random.default_rng(1).uniform(-120, 120, (40, 6)))
    q[:, 5] += np.linspace(0, 9 * 2 * np.pi, 40)
    assert impossible_rad(q) == 0.0
    assert not list(unit_findings(PoseTable(q, np.ones((40, 3)), None), load("ur10")[0]))
    assert impossible_rad(np.degrees(q)) > 100


def test_visits_of_one_posture_are_one_group_modulo_a_turn():
    q = np.radians(
        [[10.0, -20, 30, 180.0, 40, -179.99], [10.0, -20, 30, -180.0, 40, 180.01], [10.0, -20, 30, 0, 40, 0]]
    )
    assert groups(q, np.radians(0.1)).tolist() == [0, 0, 1]
    assert np.abs(wrapped(np.array([np.pi, -np.pi, 3 * np.pi])) - np.pi).max() < 1e-12

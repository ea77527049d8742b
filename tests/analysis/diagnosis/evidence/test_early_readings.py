import re

import numpy as np
import pytest

from analysis.diagnosis.judge.result import Diagnosis
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.tables import PoseTable
from rigs.load import load
from tests.support.diagnosis_cells import Array, found_in, measured

RIG = load("ur10e-cell")[0].model_copy(update={"effects": ()})
RNG = np.random.default_rng(61)
Q = np.radians([0, -80, 100, -20, 80, 0]) + np.radians(RNG.uniform(-1, 1, (100, 6)) * [60, 25, 25, 60, 40, 80])
XYZ = forward(arm_of(RIG.robot), Q)[:, :3, 3] + [100.0, -40.0, 10.0] + RNG.normal(0.0, 0.03, (100, 3))
CAME = np.diff(Q, axis=0, prepend=Q[:1])


def _ahead(reported: Array) -> Diagnosis:
    table = PoseTable(reported, XYZ, None, came_from=reported - CAME)
    return found_in([measured(table, "pose", "pose", RIG)], RIG)


def _reported(found: Diagnosis) -> dict[int, float]:
    said = [doubt for doubt in found.doubts if "before the joints came to rest" in doubt]
    return {int(axis): float(size) for axis, size in re.findall(r"axis (\d) by ([\d.]+)", said[0])} if said else {}


def test_joints_that_went_on_after_they_were_read_are_reported():
    ahead = np.radians([0.0, 0.02, 0.0, 0.02, 0.0, 0.0])
    found = _ahead(Q - ahead * np.sign(CAME))
    reported = _reported(found)
    assert set(reported) == {2, 4} and reported[2] == pytest.approx(0.02, abs=0.003)
    act = found.next_act
    assert (act.kind, act.why) == ("wait", "early")

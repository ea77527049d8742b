import numpy as np

from analysis.procedures.checks.columns import unit_findings
from analysis.runs.tables import PoseTable
from rigs.load import load


def test_a_joint_that_turned_more_than_twice_is_in_other_units():
    rig, _ = load("ur10")
    q_deg = np.random.default_rng(1).uniform(-170, 170, (20, 6))
    (finding,) = unit_findings(PoseTable(q_deg, np.ones((20, 3)), None), rig)
    assert finding.strength == "impossible" and "as radians" in finding.what
    right = unit_findings(PoseTable(np.radians(q_deg), np.ones((20, 3)), None), rig)
    assert all("radians" not in one.what for one in right)

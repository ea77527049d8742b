"""Cells with known faults: reproducible, visible, and with the approach of each stop."""

from __future__ import annotations

import numpy as np

from tests.worlds.unknown.cells import runs
from tests.worlds.unknown.faults import draw_faulty


def test_faults_are_in_the_arm_and_reproducible() -> None:
    cell, names = draw_faulty(13)
    assert draw_faulty(13)[1] == names and len(names) == 3
    sizes = cell.known.names()
    assert 0.08 <= sizes["backlash 3"] <= 0.25 and 0.3 <= abs(sizes["joint_offset 5"]) <= 1.0


def test_poses_state_the_joints_before_the_last_move() -> None:
    columns = runs(draw_faulty(0)[0])[0].columns
    assert np.array_equal(columns["q2_from_deg"][1:], columns["q2_deg"][:-1])

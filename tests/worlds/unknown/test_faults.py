"""Cells with known faults: reproducible, visible, and with the approach of each stop."""

import numpy as np

from tests.worlds.unknown.cells import runs
from tests.worlds.unknown.faults import SIZES, draw_faulty


def test_faults_are_in_the_arm_and_reproducible():
    cell, names = draw_faulty(12)
    assert draw_faulty(12)[1] == names and len(names) == 3
    degrees = {name: cell.known.names()[name] for name in names}
    for name, size in degrees.items():
        low, high = SIZES[name.partition(" ")[0]]
        if not name.startswith("compliance"):
            assert low <= abs(size) <= high


def test_poses_state_the_joints_before_the_last_move():
    columns = runs(draw_faulty(0)[0])[0].columns
    assert np.array_equal(columns["q2_from_deg"][1:], columns["q2_deg"][:-1])

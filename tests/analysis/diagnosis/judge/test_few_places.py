"""Uncertainty of a calibration by few places."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import calibrate
from analysis.diagnosis.evidence.prepared_runs import prepare_runs
from analysis.diagnosis.fit.search import search
from analysis.diagnosis.judge.held_out import factor_of_few_places
from analysis.runs.tables import PoseTable
from tests.support.pose_runs import cell_with, pose_run


@pytest.mark.parametrize(
    ("neighbourhoods", "expected"),
    [(2, 1.654), (4, 1.654), (5, 1.435), (7, 1.259), (20, 1.0)],  # t of 3, 3, 4 and 6 degrees of freedom for 95.45 %
)
def test_factor_is_at_least_students_t_of_the_neighbourhoods(neighbourhoods: int, expected: float) -> None:
    assert factor_of_few_places(neighbourhoods) == pytest.approx(expected, abs=2e-3)


def test_a_calibration_by_few_poses_has_a_widened_u() -> None:
    run = cell_with("ur10e", [{}], np.random.default_rng(21)).runs[0]
    assert isinstance(run.table, PoseTable)
    few = pose_run("ur10e", run.table.q[:22], run.table.xyz_mm[:22])
    calibrated = calibrate([few]).calibrated
    assert calibrated is not None and calibrated.widened > 1.6


def test_few_poses_leave_the_widths_of_the_joint_curves_open() -> None:
    run = cell_with("ur10e", [{}], np.random.default_rng(21)).runs[0]
    assert isinstance(run.table, PoseTable)
    ratios = []
    for count in (12, 60):
        poses = pose_run("ur10e", run.table.q[:count], run.table.xyz_mm[:count])
        found = search(prepare_runs(poses.rig, [poses], [], [])[0][0], lambda _: None)
        columns = found.columns.set_ups.start
        likeliest = found.calibrated_posterior.joint_covariance(columns, len(found.fit.unknowns))
        ratios.append(np.trace(found.covariance(columns)) / np.trace(likeliest))
    few, many = ratios
    assert few > 1.2 * many >= 1.2

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.gather import prepare_runs
from analysis.procedures.checks.check_runs import findings_of
from analysis.procedures.checks.places import WILDNESS, far_poses
from analysis.procedures.results import result_of
from analysis.robot.geometry.pose_setup import fit_setup
from analysis.robot.kinematics.arm import arm_of, forward, without_setup
from analysis.runs.copies import USED, refuse_copied_rows
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable
from rigs.load import load
from tests.support.conventions import run_of
from tests.support.made_once import made_once
from tests.support.refusals import refused
from tests.worlds.arms.independent_arm import Seen, cell, healthy, postures

RIG = load("ur10e-cell")[0]


@made_once
def _seen(seed: int, count: int = 60) -> Seen:
    """An arm with zeros off by some hundredths of a degree and lengths by half a millimetre."""
    rng = np.random.default_rng(seed)
    wrong = healthy(rng)
    wrong.offset[1:4] = np.radians([0.05, -0.08, 0.03])
    wrong.a[2:4] = [0.8, -0.5]
    return cell("ur10e", wrong, rng).seen(postures("ur10e", count, rng, (120, 60, 60, 120, 80, 150)), rng)


def _run(seed: int, spoil: str, count: int = 60) -> tuple[Measured, list[int]]:
    """A run, and the rows that are no measurement."""
    seen = _seen(seed, count)
    xyz, rows = seen.xyz_mm.copy(), [21]
    if spoil.endswith("mm"):
        xyz[20] += np.array([float(spoil[:-3]), 0.0, 0.0])
    elif spoil == "none":
        rows = []
    else:
        slid = int(spoil)
        rows = list(range(count - slid + 1, count + 1))
        xyz[-slid:] = np.roll(xyz[-slid:], 1, axis=0)
    return run_of(PoseTable(seen.q, xyz, None), "poses", RIG), rows


SPOILT = ("2 mm", "1000 mm", "4")


@pytest.mark.parametrize("spoil", SPOILT)
def test_outliers_are_named_at_import_and_ignored_in_fits(spoil):
    run, rows = _run(0, spoil)
    found = far_poses(run.table, without_setup(arm_of(RIG.robot)))
    assert (np.flatnonzero(found.wild) + 1).tolist() == rows
    (line,) = [one.words for one in findings_of([run]) if one.convention == WILDNESS]
    assert all(str(row) in line for row in (rows[0], rows[-1])) and f"{len(rows)} of 60 poses ignored" in line
    (kept,), said = prepare_runs(RIG, [run])
    assert (np.setdiff1d(np.arange(60), kept[0].rows) + 1).tolist() == rows and line.split(";")[0] in said[0]
    clean, _ = _run(0, "none")
    spoilt_mm, clean_mm = (result_of(one).figures["rms_mm"].value for one in (run, clean))
    assert spoilt_mm == pytest.approx(clean_mm, rel=0.1)


def test_the_same_poses_in_another_order_are_no_repeats():
    run, _ = _run(0, "none")
    table, order = run.table, np.random.default_rng(1).permutation(60)
    shuffled = replace(table, q=table.q[order] + 2 * np.pi, xyz_mm=table.xyz_mm[order])
    with refused("run.copied", "is given twice"):
        refuse_copied_rows([(run, USED), (replace(run, table=shuffled), USED)])
    visited_again = replace(shuffled, xyz_mm=shuffled.xyz_mm + np.random.default_rng(2).normal(0, 0.01, (60, 3)))
    refuse_copied_rows([(run, USED), (replace(run, table=visited_again), USED)])


@pytest.mark.parametrize("which", ["from about 31", "every other row"])
def test_two_reflectors_in_one_run_are_detected(which):
    seen = _seen(0)
    later = np.arange(60) >= 30 if "from" in which else np.arange(60) % 2 == 1
    T = forward(without_setup(arm_of(RIG.robot)), seen.q)
    R = fit_setup(T, seen.xyz_mm).T_world_base[:3, :3] @ T[:, :3, :3]
    xyz = seen.xyz_mm + later[:, None] * (R @ np.array([3.0, -2.0, 1.0]))
    (line,) = [one.words for one in findings_of([run_of(PoseTable(seen.q, xyz, None), "poses", RIG)])]
    assert which in line

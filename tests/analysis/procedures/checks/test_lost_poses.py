from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.procedures import pose, repeatability
from analysis.robot.kinematics.arm import forward
from analysis.runs.tables import PoseTable, RepeatabilityTable
from tests.worlds.planted import closed_forms as planted

SPREAD_MM = 0.08


def table(count: int, seed: int = 1, turned: bool = False) -> PoseTable:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2, 2, (count, 6))
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = Rotation.from_rotvec([0.1, -2.0, 1.0]).as_matrix(), (1500.0, -900.0, 400.0)
    tool = np.eye(4)
    tool[:3, 3] = (10.0, -20.0, 130.0)
    T = base @ forward(planted.ur10(), q) @ tool
    rpy = Rotation.from_matrix(T[:, :3, :3]).as_euler("xyz") + rng.normal(0, 2e-4, (count, 3))
    return PoseTable(q, T[:, :3, 3] + rng.normal(0, SPREAD_MM, (count, 3)), rpy if turned else None)


def evaluated(one: PoseTable) -> pose.PoseResult:
    return pose.evaluate(one, planted.ur10(), 0.02, same_rad=1e-9)


def test_a_wild_turn_is_left_out_too():
    sound = table(60, turned=True)
    rpy = sound.rpy.copy()
    rpy[20] += (0.0, 0.0, 0.2)
    found, truth = evaluated(replace(sound, rpy=rpy)), evaluated(sound)
    assert "1 of 60 poses ignored: row 21" in found.notes[0]
    assert found.figures["rms_deg"].value == pytest.approx(truth.figures["rms_deg"].value, rel=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_of_sound_poses_none_is_left_out(seed):
    sound = table(40, seed, turned=True)
    q = sound.q + np.radians(0.1) * np.sin(3 * sound.q)
    assert not any("ignored" in note for one in (sound, replace(sound, q=q)) for note in evaluated(one).notes)


def test_outliers_in_one_joint_range_are_kept():
    sound = table(60)
    far = np.argsort(sound.q[:, 2])[-5:]
    xyz = sound.xyz_mm.copy()
    xyz[far] += (40.0, 0.0, 0.0)
    found = evaluated(replace(sound, xyz_mm=xyz))
    assert found.samples == 60 and found.notes[0].startswith("5 of 60 poses ")


def test_a_wild_visit_of_a_repeatability_test_is_named_and_stays():
    rng = np.random.default_rng(3)
    target, side, visit = (one.ravel() for one in np.meshgrid([1, 2, 3], ["out", "in"], np.arange(5), indexing="ij"))
    g_mm = rng.normal(0, 0.02, len(target))

    def notes() -> tuple[str, ...]:
        zero = np.zeros(len(target))
        table = RepeatabilityTable(target, side, visit + 1, zero, np.zeros((len(target), 6)), g_mm)
        return repeatability.evaluate(table, 0.001).notes

    assert not any("the others" in note for note in notes())
    g_mm[12] += 2.0
    (note,) = [note for note in notes() if "the others" in note]
    assert note.startswith("1 reading is ") and "(target 2, out)" in note

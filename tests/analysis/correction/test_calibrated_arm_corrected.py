"""From poses of an imperfect arm to corrected targets, checked with independent forward kinematics."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from analysis import calibrate, read_table
from analysis.apps.correct.correct_rig import correct_rig
from analysis.apps.report.diagnosis_report import write_model
from analysis.robot.model.predict import model_of
from rigs.load import load
from tests.worlds.arms.independent_arm import Array, Wrong, bad_zeros, cell, flange, postures

HEAD = ",".join(f"q{k}_deg" for k in range(1, 7))


def _apart_mm(places: Array, wanted: Array) -> Array:
    """Distances (n,) after the best rigid motion, because the position of the base of a real arm is unknown."""
    turn, _ = Rotation.align_vectors(wanted - wanted.mean(axis=0), places - places.mean(axis=0))
    moved = (places - places.mean(axis=0)) @ turn.as_matrix().T + wanted.mean(axis=0)
    distances: Array = np.linalg.norm(moved - wanted, axis=1)
    return distances


def test_corrected_angles_bring_a_bad_arm_to_the_nominal_place(tmp_path):
    rng = np.random.default_rng(5)
    arm = cell("ur10e", bad_zeros(rng), rng)
    poses = arm.seen(postures("ur10e", 40, rng), rng)
    table = np.column_stack([np.degrees(poses.q), poses.xyz_mm])
    np.savetxt(tmp_path / "poses.csv", table, "%.9f", ",", header=f"{HEAD},x_mm,y_mm,z_mm", comments="")
    rig, text = load("ur10e")
    found = calibrate([read_table(tmp_path / "poses.csv", "ur10e", "pose")])
    write_model(found, text, tmp_path / "cell.yaml")
    sent = postures("ur10e", 50, rng, (80, 30, 30, 80, 40, 100))
    np.savetxt(tmp_path / "path.csv", np.degrees(sent), "%.9f", ",", header=HEAD, comments="")
    corrections = correct_rig(load(str(tmp_path / "cell.yaml"))[0], tmp_path / "path.csv")
    assert corrections.path and not corrections.path[2].doubts
    targets = corrections.path[2]
    # What the poses cannot tell of axis 6 is in the tool that was fitted with them.
    assert found.calibrated
    (setup,) = found.calibrated.setups.values()
    tool = (model_of(rig).arm.T_flange_tool @ np.array(setup.T_tool_target))[:3, 3]
    right = Wrong(*(0.0 * getattr(arm.wrong, key) for key in arm.wrong.__dataclass_fields__))

    def stands(wrong: Wrong, q: Array, tool_mm: Array) -> Array:
        R, p = flange(arm.arm, wrong, q)
        return np.asarray(p + R @ tool_mm)

    wanted = stands(right, sent, tool)
    before = _apart_mm(stands(arm.wrong, sent, arm.tool_mm), wanted)
    after = _apart_mm(stands(arm.wrong, targets.q, arm.tool_mm), wanted)
    assert after.mean() < 0.1 * before.mean()
    # In the base's own frame u has the zero of axis 1 as well, of which no pose tells anything.
    assert np.mean(after < 2 * targets.u_frame_mm) > 0.9
    assert np.median(targets.u_frame_mm) < 0.1 < np.median(targets.u_mm)

from dataclasses import replace

import numpy as np

from analysis import diagnose
from analysis.diagnosis.evidence.observation import ObservedRun, observe
from analysis.diagnosis.evidence.placements import split_by_frame
from analysis.procedures.simulate import simulate
from analysis.robot.predict import model_of
from daq.store import load_manifest
from rigs.load import load
from rigs.schema.effect import name_of
from tests.support.command_line import ran
from tests.support.pose_runs import pose_run
from tests.support.table_cases import RIG_FILE, csv_text, plain
from tests.support.written_runs import import_table
from tests.worlds.arms.independent_arm import cell, healthy, postures


def _circles(rig_ball: tuple[float, float, float], seed: int) -> list[ObservedRun]:
    rig = load("paper-fanuc")[0].model_copy(update={"effects": ()})
    circle = rig.tests.circle.model_copy(update={"eccentricity_mm": rig_ball})
    moved = rig.model_copy(update={"tests": rig.tests.model_copy(update={"circle": circle})})
    model = model_of(rig)
    return [observe(model, simulate(moved, "yaw", way, seed + k), "yaw") for k, way in enumerate(("acw", "cw"))]


def test_a_ball_that_was_moved_is_another_set_up_and_its_scatter_is_not():
    same = [*_circles((0.3, 0.2, 0.0), 1), *_circles((0.3, 0.2, 0.0), 11)]
    assert split_by_frame(same, list("abcd")) == (same, [])
    found, told = split_by_frame([*same[:2], *_circles((1.3, -0.2, 0.0), 21)], list("abcd"))
    assert [one.setup for one in found] == ["yaw", "yaw", "yaw, frame 2", "yaw, frame 2"]
    assert "fitted as 2 placements (a, b; c, d)" in told[0]


def test_a_placement_can_be_named_afterwards(tmp_path):
    (tmp_path / "t.csv").write_text(csv_text(plain("pose")))
    import_table(tmp_path / "t.csv", tmp_path / "run", rig_file=RIG_FILE, test="pose")
    done = ran(f"relabel {tmp_path}/run --placement door")
    assert done.returncode == 0 and "pose at door" in done.stdout
    manifest = load_manifest(tmp_path / "run")
    assert manifest.placement == "door" and manifest.relabelled[-1].field == "placement"
    assert ran("relabel", tmp_path / "run", "--placement", "a door").returncode == 2


def test_three_placements_are_diagnosed_as_one_arm():
    rng = np.random.default_rng(5)
    wrong = healthy(rng)
    wrong.offset[2] = np.radians(0.4)
    arm, far_mm = cell("ur10e", wrong, rng), np.array([400.0, -2500.0, 30.0])
    runs = []
    for name, count, shift in (("door", 60, 0), ("wall", 60, 1), ("floor", 3, -1)):
        turn = arm.turn + abs(shift) * np.array([0.0, 0.1, 0.7])
        there = replace(arm, place_mm=arm.place_mm + shift * far_mm, turn=turn)
        seen = there.seen(postures("ur10e", count, rng), rng)
        runs.append(pose_run("ur10e", seen.q, seen.xyz_mm, name, name))
    found = diagnose(runs)
    (one,) = found.standing
    assert name_of(one.effect) == "joint_offset 3" and one.held_out_gain > 0.5
    assert abs(one.effect.offset_deg - np.degrees(wrong.offset[2])) < max(4 * one.sd["offset_deg"], 0.05)
    assert set(found.setups) == {"pose at door", "pose at wall", "pose at floor"}
    assert not any("share a frame" in doubt for doubt in found.doubts)

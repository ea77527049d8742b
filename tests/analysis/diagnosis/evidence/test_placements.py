from dataclasses import replace

import numpy as np
import pytest

from analysis import diagnose
from analysis.diagnosis.evidence.gather import prepare_runs
from analysis.diagnosis.evidence.observation import ObservedRun, observe, rms
from analysis.diagnosis.evidence.placements import split_by_frame
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.procedures.simulate import simulate
from analysis.robot.predict import model_of
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable
from daq.store import load_manifest
from rigs.load import load
from rigs.schema.effect import name_of
from tests.support.command_line import ran
from tests.support.conventions import run_of
from tests.support.pose_runs import pose_run
from tests.support.table_cases import RIG_FILE, csv_text, plain
from tests.support.written_runs import import_table
from tests.worlds.arms.independent_arm import Cell, Seen, bad_zeros, cell, healthy, postures


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


RIG = load("ur10e-cell")[0]
TARGETS = np.array([[40.0, 0.0, 120.0], [-40.0, 30.0, 120.0], [0.0, -50.0, 150.0]])


def _run(seen: Seen, name: str, placement: str = "") -> Measured:
    run = run_of(PoseTable(seen.q, seen.xyz_mm, None), name, RIG)
    return replace(run, run=replace(run.run, manifest=run.run.manifest.model_copy(update={"placement": placement})))


def _cell(seed: int) -> tuple[Cell, np.random.Generator]:
    rng = np.random.default_rng(seed)
    return cell("ur10e", bad_zeros(rng) if seed % 2 else healthy(rng), rng), rng


def test_each_reflector_has_a_place_of_its_own():
    there, rng = _cell(1)
    q = postures("ur10e", 50, rng)
    seen = [replace(there, tool_mm=place).seen(q, rng) for place in TARGETS]
    seen.append(replace(there, tool_mm=TARGETS[1], place_mm=there.place_mm + 500).seen(seen[0].q, rng))
    runs = [_run(one, f"t{k}", f"p{k}") for k, one in enumerate(seen)]
    (kept,), said = prepare_runs(RIG, runs)
    placed, left = fit_run_setups(kept)
    alone = [rms(fit_run_setups([run])[1]) for run in kept]
    assert all(rms([one]) < 1.1 * each for one, each in zip(left, alone, strict=True))
    targets = np.array([placed[run.setup].T_tool_target[:3, 3] for run in kept])
    apart = np.linalg.norm(targets - targets[0], axis=1)
    truth = np.linalg.norm(TARGETS[[0, 1, 2, 1]] - TARGETS[0], axis=1)
    assert apart == pytest.approx(truth, abs=3.0) and targets[1] == pytest.approx(targets[3])
    (line,) = said
    assert "(t0; t1, t3; t2)" in line
    assert "and 4 places" in line


def test_one_reflector_is_one_set_up():
    there, rng = _cell(1)
    parts = np.array_split(postures("ur10e", 120, rng), 3)
    runs = [_run(there.seen(part, rng), f"s{k}") for k, part in enumerate(parts)]
    (kept,), said = prepare_runs(RIG, runs)
    assert {run.setup for run in kept} == {"pose"} and not said

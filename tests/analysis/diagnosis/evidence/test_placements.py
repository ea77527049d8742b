"""Runs of several placements: named, or shown by what they cannot be together."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis import calibrate
from analysis.cli import app
from analysis.diagnosis.evidence.observation import ObservedRun, observe
from analysis.diagnosis.evidence.placements import split_by_frame
from analysis.procedures.simulate import simulate
from analysis.robot.model.predict import model_of
from analysis.runs.loading import load_measured
from daq.store import load_manifest
from rigs.errors import FileError
from rigs.load import load
from tests.support.nightly import cases
from tests.worlds.arms.independent_arm import Array, Cell, Seen, bad_zeros, cell, healthy, postures

RIG = load("ur10e")[0].model_copy(update={"effects": ()})


def _csv(path: Path, poses: Seen) -> Path:
    head = ",".join([*(f"q{k}_deg" for k in range(1, 7)), "x_mm", "y_mm", "z_mm"])
    np.savetxt(path, np.column_stack([np.degrees(poses.q), poses.xyz_mm]), "%.9f", ",", header=head, comments="")
    return path


def _run(tmp_path: Path, name: str, poses: Seen, *more: str, rig: str = "ur10e") -> Path:
    run = tmp_path / name
    table = _csv(tmp_path / f"{name}.csv", poses)
    done = CliRunner().invoke(
        app, ["import", str(table), "--rig", rig, "--test", "pose", "-o", str(run), "--operator", "anna", *more]
    )
    assert done.exit_code == 0, done.exception
    return run


@pytest.fixture
def arm() -> tuple[Cell, np.random.Generator]:
    rng = np.random.default_rng(3)
    return cell("ur10e", bad_zeros(rng), rng), rng


def _poses(arm: tuple[Cell, np.random.Generator], count: int, moved_mm: Array | None = None) -> Seen:
    there, rng = arm
    shift = np.zeros(3) if moved_mm is None else moved_mm
    turn = there.turn if moved_mm is None else there.turn + np.array([0.0, 0.1, 0.7])
    return replace(there, place_mm=there.place_mm + shift, turn=turn).seen(postures("ur10e", count, rng), rng)


FAR = np.array([400.0, -2500.0, 30.0])


@pytest.mark.parametrize("named", cases((True, False), (False,)))
def test_two_placements_calibrate_as_one_arm(
    tmp_path: Path, arm: tuple[Cell, np.random.Generator], named: bool
) -> None:
    places = [("--placement", name) if named else () for name in ("door", "wall", "crane")]
    first = _run(tmp_path, "first", _poses(arm, 30), *places[0])
    second = _run(tmp_path, "second", _poses(arm, 30, FAR), *places[1])
    judge = _run(tmp_path, "judge", _poses(arm, 40, 2 * FAR), *places[2])
    runs = [load_measured(path) for path in (first, second)]
    found = calibrate(runs, "joint_offset", rig=RIG, hold_out=[load_measured(judge)])
    assert found.train.calibrated_um < 500
    assert found.held_out and found.held_out.calibrated_um < 500 < found.held_out.before_um < 20_000
    setups = found.calibrated.setups
    assert len(setups) == 2
    tools = [setup.T_tool_target for setup in setups.values()]
    np.testing.assert_allclose(tools[0], tools[1], atol=1e-9)
    said = [doubt for doubt in found.doubts if "share a frame" in doubt]
    assert len(said) == (0 if named else 1)
    assert named or "fitted as 3 placements (first; second; judge)" in said[0]


def test_a_placement_of_three_poses_takes_the_tool_of_the_others(
    tmp_path: Path, arm: tuple[Cell, np.random.Generator]
) -> None:
    first = _run(tmp_path, "first", _poses(arm, 30), "--placement", "door")
    three = _run(tmp_path, "three", _poses(arm, 3, FAR), "--placement", "wall")
    two = _run(tmp_path, "two", _poses(arm, 2, -FAR), "--placement", "floor")
    runs = [load_measured(path) for path in (first, three, two)]
    found = calibrate(runs, "joint_offset", rig=RIG)
    assert found.train.calibrated_um < 500
    assert set(found.calibrated.setups) == {"pose at door", "pose at wall"}
    assert any(doubt.startswith("pose at floor ") and "6 readings" in doubt for doubt in found.doubts)
    with pytest.raises(FileError, match="6 readings"):
        calibrate(runs[2:], "joint_offset", rig=RIG)


def test_runs_of_two_robots_are_reported_in_one_line(tmp_path: Path, arm: tuple[Cell, np.random.Generator]) -> None:
    first = _run(tmp_path, "first", _poses(arm, 10))
    other = _run(tmp_path, "other", _poses(arm, 10), rig="paper-fanuc")
    with pytest.raises(FileError, match="different robot"):
        calibrate([load_measured(path) for path in (first, other)], "joint_offset", rig=RIG)


def _circles(rig_ball: tuple[float, float, float], seed: int) -> list[ObservedRun]:
    rig = load("paper-fanuc")[0].model_copy(update={"effects": ()})
    assert rig.tests.circle
    circle = rig.tests.circle.model_copy(update={"eccentricity_mm": rig_ball})
    moved = rig.model_copy(update={"tests": rig.tests.model_copy(update={"circle": circle})})
    model = model_of(rig)
    return [observe(model, simulate(moved, "yaw", way, seed + k), "yaw") for k, way in enumerate(("acw", "cw"))]


def test_a_ball_that_was_moved_is_another_set_up_and_its_scatter_is_not() -> None:
    same = [*_circles((0.3, 0.2, 0.0), 1), *_circles((0.3, 0.2, 0.0), 11)]
    assert split_by_frame(same, list("abcd")) == (same, [])
    found, told = split_by_frame([*same[:2], *_circles((1.3, -0.2, 0.0), 21)], list("abcd"))
    assert [one.setup for one in found] == ["yaw", "yaw", "yaw, frame 2", "yaw, frame 2"]
    assert "fitted as 2 placements (a, b; c, d)" in told[0]


def test_a_placement_can_be_named_afterwards(tmp_path: Path, arm: tuple[Cell, np.random.Generator]) -> None:
    run = _run(tmp_path, "first", _poses(arm, 10))
    assert '"placement"' not in (run / "manifest.json").read_text()
    done = CliRunner().invoke(app, ["relabel", str(run), "--placement", "door"])
    assert done.exit_code == 0 and "pose at door" in done.stdout
    manifest = load_manifest(run)
    assert manifest.placement == "door" and manifest.relabelled[-1].field == "placement"
    bad = CliRunner().invoke(app, ["relabel", str(run), "--placement", "a door"])
    assert bad.exit_code == 2 and "name a placement with" in bad.stderr


@pytest.mark.parametrize("named", cases((True, False), (True,)))
def test_two_placements_are_diagnosed_as_one_arm(tmp_path: Path, named: bool) -> None:
    rng = np.random.default_rng(5)
    wrong = healthy(rng)
    wrong.offset[2] = np.radians(0.4)
    arm = cell("ur10e", wrong, rng), rng
    places = [("--placement", name) if named else () for name in ("door", "wall", "floor")]
    runs = [
        _run(tmp_path, "first", _poses(arm, 60), *places[0]),
        _run(tmp_path, "second", _poses(arm, 60, FAR), *places[1]),
        _run(tmp_path, "three", _poses(arm, 3, -FAR), *places[2]),
    ]
    done = CliRunner().invoke(app, ["diagnose", *map(str, runs), "--json"])
    assert done.exit_code == 0, done.exception
    answer = json.loads(done.stdout)
    (one,) = [one for one in answer["effects"] if one["stands"]]
    assert one["name"] == "joint_offset 3" and one["held_out_gain"] > 0.5
    offset = one["parameters"]["offset_deg"]
    assert abs(offset["value"] - np.degrees(wrong.offset[2])) < max(4 * offset["sd"], 0.05)
    frames = set(answer["setup"])
    assert frames == (
        {"pose at door", "pose at wall", "pose at floor"} if named else {"pose", "pose, frame 2", "pose, frame 3"}
    )
    said = [doubt for doubt in answer["doubts"] if "share a frame" in doubt]
    assert len(said) == (0 if named else 1)

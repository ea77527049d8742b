"""`rig compare ARM ARM` as a person uses it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rigs.load import find
from tests.support.command_line import ran


def arm(directory: Path, name: str, effects: str = "", shipped: str = "ur10e") -> Path:
    file = directory / f"{name}.yaml"
    text = find(shipped).read_text(encoding="utf-8")
    text = "\n".join(f"name: {name}" if line.startswith("name:") else line for line in text.splitlines())
    file.write_text(text + effects, encoding="utf-8")
    return file


def test_a_turned_first_axis_is_a_rotation_that_teaching_takes_away(tmp_path: Path) -> None:
    one = arm(tmp_path, "old")
    other = arm(tmp_path, "new", "\neffects:\n  - {effect: joint_offset, axis: 1, offset_deg: 0.1}\n")
    done = ran("compare", one, other, "--json")
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert seen["constants"][0]["zero_deg"] == pytest.approx(0.1)
    radius = [np.hypot(*pose["apart_mm"][:2]) for pose in seen["poses"]]
    assert seen["rms_mm"] == pytest.approx(np.sqrt(np.mean(np.square(radius))))
    assert seen["turned_rms_deg"] == pytest.approx(0.1, rel=1e-6)
    assert seen["rms_mm"] > 0.5
    assert seen["taught_rms_mm"] < 0.01 * seen["rms_mm"]
    assert seen["u_rms_mm"] is None
    assert len(seen["poses"]) == 200
    said = " ".join(ran("compare", one, other).stdout.split())
    assert f"The tool of new is {seen['rms_mm']:.3f} mm rms from that of old" in said
    assert "+0.1000" in said


def test_an_arm_with_itself_is_nothing_apart_and_its_play_is_shown(tmp_path: Path) -> None:
    one = arm(tmp_path, "one", "\neffects:\n  - {effect: backlash, axis: 2, width_deg: 0.02}\n")
    seen = json.loads(ran("compare", one, one, "--json").stdout)
    assert seen["max_mm"] == 0
    assert seen["play_deg"] == [{"2": 0.02}, {"2": 0.02}]


def test_where_no_run_measured_both_there_is_no_u_and_the_reason_is_said(tmp_path: Path) -> None:
    known = "found: {date: 2026-11-20, runs: [a], sd: {offset_deg: 0.01}"
    for name, driven, doubts in (
        ("all", "[-360, 360]", []),
        ("part", "[0, 1]", ["no u: at 200 of 200 postures no run says how well both arms are known"]),
    ):
        joints = ", ".join([driven] * 6)
        effect = f"{{effect: joint_offset, axis: 2, offset_deg: 0.1, {known}, joints_deg: [{joints}]}}}}"
        one = arm(tmp_path, name, f"\neffects:\n  - {effect}\n")
        seen = json.loads(ran("compare", one, one, "--json").stdout)
        assert seen["doubts"] == doubts and (seen["u_rms_mm"] is None) == bool(doubts)


def test_arms_of_two_models_are_refused_in_a_line(tmp_path: Path) -> None:
    done = ran("compare", arm(tmp_path, "one"), arm(tmp_path, "other", shipped="paper-fanuc"))
    assert done.returncode == 3
    assert "compare arms of one model" in " ".join(done.stderr.split())

from dataclasses import replace

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from analysis.procedures.checks.places import source_findings
from analysis.robot.kinematics.arm import arm_of, forward, without_setup
from analysis.runs.tables import PoseTable
from rigs.load import load, parse
from tests.support.command_line import ran
from tests.worlds.arms.independent_arm import Cell, Wrong, constants_of, flange, healthy, none, postures

RIG = load("ur10e-cell")[0]
Array = NDArray[np.float64]


def _controller(rng: np.random.Generator, count: int) -> tuple[Array, Array, Array, Wrong]:
    own = none()
    own.offset[1:5] = np.radians(rng.uniform(-0.08, 0.08, 4))
    own.a[2:4], own.d[4:] = rng.uniform(-0.8, 0.8, 2), rng.uniform(-0.3, 0.3, 2)
    q = np.radians(np.round(np.degrees(postures("ur10e", count, rng)), 5))
    R, p = flange(constants_of("ur10e"), own, q)
    return q, np.round(p, 4), R, own


@pytest.mark.parametrize("digits", [6, 3, 2])
@pytest.mark.parametrize("ros", [False, True])
def test_places_of_the_controller_are_no_measurement(digits, ros):
    q, p, _, _ = _controller(np.random.default_rng(digits), 40)
    shown = np.radians(np.round(np.degrees(q), digits))
    (finding,) = source_findings(PoseTable(shown, p * [-1, -1, 1] if ros else p, None), RIG)
    assert finding.strength == "impossible" and "not measured" in finding.what
    assert "rig arms NAME --poses" in finding.remedy


@pytest.mark.parametrize("seed", range(4))
def test_a_tracker_is_an_instrument_in_any_frame(seed):
    """A quiet one too, whose frame a person has put into the arm's base."""
    rng = np.random.default_rng(seed)
    there = Cell(constants_of("ur10e"), healthy(rng), np.zeros(3), np.zeros(3), np.array([0, 0, 28.3]), 0.008)
    if seed % 2:
        there = replace(there, turn=rng.uniform(-1, 1, 3), place_mm=rng.uniform(-3000, 3000, 3))
    seen = there.seen(postures("ur10e", 60, rng), rng)
    assert not list(source_findings(PoseTable(seen.q, seen.xyz_mm, None), RIG))


def test_the_controllers_constants_come_out_of_thirty_poses(tmp_path):
    rng = np.random.default_rng(7)
    q, p, R, own = _controller(rng, 230)
    header = ",".join(
        [*(f"q{k}_deg" for k in range(1, 7)), "x_mm", "y_mm", "z_mm", *(f"r{i}{k}" for i in "123" for k in "123")]
    )
    rows = np.column_stack([np.degrees(q), p, R.reshape(-1, 9)])[:30]
    np.savetxt(tmp_path / "poses.csv", rows, "%.7f", ",", header=header, comments="")
    refused = ran(f"import {tmp_path}/poses.csv --rig ur10e-cell --test pose -o {tmp_path}/run")
    *_, line = refused.stderr.strip().splitlines()
    assert refused.returncode == 3 and line.startswith("error: ") and "not measured" in line
    done = ran(f"arms ur10e --poses {tmp_path}/poses.csv -o {tmp_path}/arm.yaml")
    assert done.returncode == 0 and done.stderr
    rig = parse("name: x\n" + (tmp_path / "arm.yaml").read_text(), "arm.yaml")
    T = forward(without_setup(arm_of(rig.robot)), q[30:])
    assert np.abs(T[:, :3, 3] - p[30:]).max() < 0.003
    assert np.abs(T[:, :3, :3] - R[30:]).max() < 1e-5
    arm = yaml.safe_load((tmp_path / "arm.yaml").read_text())["robot"]["axes"]
    assert arm[2]["a_mm"] == pytest.approx(-612.7 + own.a[2], abs=0.003)

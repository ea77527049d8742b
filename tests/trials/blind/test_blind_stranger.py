"""The generator: shares no code with the project, kinematics by closed forms."""

import ast
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from py_opw_kinematics import KinematicModel, Robot

from tests.worlds import stranger
from tests.worlds.stranger.cell import ROBOTS, read_cell
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.measure import measure
from tests.worlds.stranger.motion import circle_frames, lap, track_of
from tests.worlds.stranger.screws import Arm, arm_from, pose, torque_nm

HERE = Path(stranger.__file__).parent
AROUND = {"importlib", "runpy", "subprocess", "multiprocessing", "ctypes"}
ALLOWED = ({"numpy", "yaml"} | set(sys.stdlib_module_names)) - AROUND


def test_the_stranger_imports_nothing_of_the_project():
    files = sorted(HERE.rglob("*.py"))
    assert len(files) > 10
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            others = {name for name in names if not f"{name}.".startswith("tests.worlds.stranger.")}
            assert {name.split(".")[0] for name in others} <= ALLOWED, f"{file.name}: {names}"
            assert not (isinstance(node, ast.Name) and node.id in ("__import__", "exec", "eval")), file.name


def test_screws_agree_with_opw_kinematics():
    """An arm in the notation of Brandstötter, Angerer and Hofbaur (2014): flange frames by another's code."""
    a1, a2, b, c1, c2, c3, c4 = 254.5, -142.4, 12.0, 450.0, 695.0, 666.3, 95.0
    constants = replace(
        read_cell("paper-fanuc").constants,
        a=np.array([0, a1, c2, -a2, 0, 0]),
        alpha=np.radians([0.0, -90, 0, -90, -90, 90]),
        d=np.array([c1, b, 0, c3, 0, c4]),
        zero=np.radians([0.0, -90, -90, 180, 0, 0]),
        coupling=np.eye(6),
        tool=np.eye(4),
    )
    q = np.random.default_rng(1).uniform(-2, 2, (50, 6))
    peer = Robot(KinematicModel(a1, a2, b, c1, c2, c3, c4, (0.0,) * 6, (False,) * 6))
    theirs, mine = peer.batch_forward(np.degrees(q)).as_matrix(), pose(arm_from(constants), q)
    assert np.abs(theirs[:, :3, 3] - mine.p).max() < 1e-9
    assert np.abs(theirs[:, :3, :3] - mine.R).max() < 1e-12


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_tool_runs_on_the_circle(robot):
    cell = read_cell(robot)
    moving = lap(cell, track_of(cell, cell.circle), "yaw", -1, np.arange(0.0, 30.0, 0.05))
    at, place = pose(cell.arm, moving.q), cell.circle
    away = at.p - place.centre
    assert np.abs(np.linalg.norm(away, axis=1) - place.radius).max() < 1e-6
    assert np.abs(at.R[:, :, 2] + away / place.radius).max() < 1e-7
    phi = np.unwrap(np.arctan2(away @ place.v, away @ place.u))
    assert (np.diff(phi) < 1e-9).all()
    assert np.ptp(phi) == pytest.approx(2 * np.pi + 2 * place.lead)
    assert np.abs(circle_frames(place, phi)[0] - at.R).max() < 1e-7


@pytest.mark.parametrize("robot", ROBOTS)
def test_torque_equals_loss_of_potential_energy(robot):
    """Minus the derivative of the potential, by finite differences."""
    arm = read_cell(robot).arm
    q, step = np.radians([[10.0, 20.0, -15.0, 30.0, 40.0, 50.0]]), 1e-5

    def potential(angles: np.ndarray) -> float:
        at = pose(arm, angles)
        frames = [_hung(arm, angles, k) for k in range(6)]
        height = sum(m * z for m, z in zip(arm.mass, frames, strict=True)) + (arm.payload + 3.0) * at.end[0, 5, 2]
        return float(height * 9.80665 / 1000)

    slope = [(potential(q + step * e) - potential(q - step * e)) / (2 * step) for e in np.eye(6)]
    assert torque_nm(arm, q, 3.0)[0] == pytest.approx(-np.array(slope), abs=1e-5)


def _hung(arm: Arm, q: np.ndarray, k: int) -> float:
    """Height mm of link k's centre of mass, carried along as if it were the link's end."""
    end = arm.end.copy()
    end[k] = arm.hung[k]
    return float(pose(replace(arm, end=end), q).end[0, k, 2])


def test_the_papers_eccentricity():
    """measurement.md: e = 14.142 mm at R = 70 mm turns the disk by asin(e/R) = 11.65°."""
    cell = read_cell("paper-fanuc")
    moving = lap(cell, track_of(cell, cell.circle), "yaw", 1, np.arange(0.0, 30.0, 0.02))
    ball = cell.circle.centre + 10.0 * (cell.circle.u + cell.circle.v)
    g = measure(cell, moving, [], Link(ball, np.zeros(2), cell.gauge_at))
    assert np.degrees(np.arctan((g[:, 1] - g[:, 0]) / 50)).max() == pytest.approx(11.655, abs=0.01)

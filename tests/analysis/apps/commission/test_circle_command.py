import json
import re
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from analysis import save_run, simulate
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import arm_of
from analysis.robot.kinematics.follow import follow
from rigs.load import SHIPPED, load
from tests.support.bench import BIN, Bench, rig_text
from tests.support.command_line import ran
from tests.support.simulated_laps import lap_run

UR10E = (SHIPPED / "ur10e.yaml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return lap_run(tmp_path_factory.mktemp("lap"), seed=1)


@pytest.fixture
def cell(tmp_path):
    """A rig file whose circle is elsewhere than the robot drives."""
    path = tmp_path / "cell.yaml"
    path.write_text(UR10E.replace("centre_mm: [-650, -200, 250]", "centre_mm: [-600, -150, 200] # by ruler"))
    path.chmod(0o640)
    return path


def test_block_is_printed_with_uncertainties_and_nothing_is_written(run, cell):
    before = cell.read_text()
    done = ran("circle", "fit", run, "--rig", cell)
    assert done.returncode == 0, done.stderr
    block = yaml.safe_load(done.stdout)["tests"]["circle"]
    assert block["centre_mm"] == pytest.approx([-650, -200, 250], abs=0.05)
    assert all("# u " in line for line in done.stdout.splitlines()[2:] if "posture" not in line)
    assert re.search(r"centre_mm: .* # u .* mm$", done.stdout, re.M)
    assert re.search(r"normal: .* # u .*°$", done.stdout, re.M)
    assert "--write" in done.stderr and cell.read_text() == before
    assert list(cell.parent.iterdir()) == [cell]


def test_file_is_written_and_each_old_one_is_kept(run, cell):
    before = cell.read_text()
    done = ran("circle", "fit", run, "--rig", cell, "--write")
    assert done.returncode == 0 and "cell.yaml.1" in done.stderr, done.stderr
    assert (cell.parent / "cell.yaml.1").read_text() == before
    first = cell.read_text()
    assert yaml.safe_load(first)["tests"]["circle"]["centre_mm"] == pytest.approx([-650, -200, 250], abs=0.05)
    assert "# by ruler" in first and cell.stat().st_mode & 0o777 == 0o640
    again = ran("circle", "fit", run, "--rig", cell, "--write")
    assert again.returncode == 0 and cell.read_text() == first and len(list(cell.parent.iterdir())) == 2
    cell.write_text(first.replace("radius_mm: ", "radius_mm: 1", 1))
    assert ran("circle", "fit", run, "--rig", cell, "--write").returncode == 0
    assert len(list(cell.parent.iterdir())) == 3 and ran("check", cell).returncode == 0


def test_drivable_posture_is_proposed(tmp_path):
    """An arc with axis 6 turned back so far that a lap from there would leave its limits."""
    circle = circle_of(load("ur10e")[0])
    poses = frame_of(circle).poses(np.radians(np.linspace(0, 90, 300)))
    q = np.degrees(follow(arm_of(load("ur10e")[0].robot), poses, np.radians(circle.posture_deg), "test"))
    q[:, 5] -= 360
    rows = [f"{k / 50},acw,{','.join(map(str, one))},0,0" for k, one in enumerate(q)]
    heads = "t_s,direction,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,g1_mm,g2_mm"
    (tmp_path / "arc.csv").write_text("\n".join([heads, *rows]))
    imported = ran("import", tmp_path / "arc.csv", "--rig", "ur10e", "--test", "yaw", "-o", tmp_path / "arc")
    assert imported.returncode == 0, imported.stderr
    done = ran("circle", "fit", tmp_path / "arc")
    assert done.returncode == 0, done.stderr
    assert "posture_deg: [" in done.stderr


def test_json_contains_values_and_uncertainties(run):
    done = ran("circle", "fit", run, "--json")
    found = json.loads(done.stdout)
    assert found["test"] == "circle" and found["radius_mm"] == pytest.approx(70, abs=0.02)
    assert set(found["u"]) >= {"centre_mm", "normal_deg", "radius_mm"}
    assert len(found["u"]["centre_mm"]) == 3 and 0 < found["u"]["radius_mm"] < 0.02


def test_ball_is_fitted_to_a_circle_or_to_stops(run, cell, tmp_path):
    done = ran("ball", "fit", run, "--rig", cell, "--write")
    assert done.returncode == 0, done.stderr
    assert yaml.safe_load(cell.read_text())["tests"]["hemisphere"]["centre_mm"] == pytest.approx(
        [-650, -200, 250], abs=0.05
    )
    radial = simulate("ur10e", "radial", seed=1)
    done = ran("ball", "fit", save_run(radial, tmp_path / radial.path), "--rig", cell)
    assert yaml.safe_load(done.stdout)["tests"]["hemisphere"]["centre_mm"] == pytest.approx([-800, -200, 0], abs=0.05)
    assert code_of("ball", "fit", tmp_path / radial.path, run) == "ball.mixed_runs"


def code_of(*words: str | Path) -> str:
    """Code of the failure of a command with --json, which prints nothing else."""
    done = ran(*words, "--json")
    assert done.returncode and not done.stdout, done.stdout
    return str(json.loads(done.stderr)["error"]["code"])


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ((), "circle.no_runs"),
        (("RUN", "--live"), "circle.no_runs"),
        (("RUN", "--write"), "circle.no_rig_file"),
        (("RUN", "--rig", "ur10e", "--write"), "rig_file.shipped"),
        (("RUN", "--rig", "paper-fanuc"), "run.other_robot"),
    ],
)
def test_impossible_fit_is_refused(words, code, run):
    assert code_of("circle", "fit", *(run if word == "RUN" else word for word in words)) == code


def test_read_only_file_is_unchanged(run, cell):
    before = cell.read_text()
    cell.chmod(0o440)
    assert code_of("circle", "fit", run, "--rig", cell, "--write") == "file.read_only"
    assert cell.read_text() == before and list(cell.parent.iterdir()) == [cell]


def test_live_points_are_fitted_at_ctrl_c(tmp_path):
    data = yaml.safe_load(rig_text())
    data["feedback"]["rate_hz"] = 125  # a robot that is led by hand needs no more, and four programs look at it
    points = jogged_points()
    with Bench(tmp_path, yaml.safe_dump(data)) as bench:
        bench.motion.deg = points[0]
        bench.start()
        with subprocess.Popen(
            [BIN / "rig", "circle", "fit", "--live", "--rig", bench.rig, "--write"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=bench.env,
        ) as watch:
            assert watch.stderr is not None and "jog" in watch.stderr.readline()
            for number, point in enumerate(points, start=1):
                bench.motion.deg = point
                wanted = ("stood still", "stopped at 2 points", "3 stops", "4 stops")[number - 1]
                end_s = time.monotonic() + 60
                while wanted not in (line := watch.stderr.readline()):
                    assert time.monotonic() < end_s and line, number
            watch.send_signal(signal.SIGINT)
            out, err = watch.communicate(timeout=60)
        assert watch.returncode == 0, err
        circle = yaml.safe_load(out)["tests"]["circle"]
        assert circle["centre_mm"] == pytest.approx([-650, -200, 250], abs=0.1)
        assert yaml.safe_load(bench.rig.read_text())["tests"]["circle"]["radius_mm"] == pytest.approx(70, abs=0.1)


def jogged_points() -> list[list[float]]:
    """Joint angles in degrees at four points of the shipped circle."""
    circle = circle_of(load("ur10e")[0])
    poses = frame_of(circle).poses(np.radians([0.0, 90.0, 180.0, 270.0]))
    q = follow(arm_of(load("ur10e")[0].robot), poses, np.radians(circle.posture_deg), "test")
    return [row.tolist() for row in np.degrees(q)]

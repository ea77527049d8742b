import re
import signal
import subprocess
import time

import numpy as np
import pytest
import yaml

from analysis import save_run, simulate
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Array, arm_of
from analysis.robot.kinematics.follow import follow
from rigs.load import SHIPPED, load
from tests.support.bench import BIN, Bench, rig_text
from tests.support.command_line import failure_of, json_of, ran, succeeded
from tests.support.simulated_laps import lap_run
from tests.support.written_files import JOINTS, contents, write_columns

CENTRE = pytest.approx([-650, -200, 250], abs=0.05)
UR10E = (SHIPPED / "ur10e-cell.yaml").read_text()


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
    done = succeeded(f"circle fit {run} --rig {cell}")
    block = yaml.safe_load(done.stdout)["tests"]["circle"]
    assert block["centre_mm"] == CENTRE
    assert all("# u " in line for line in done.stdout.splitlines()[2:] if "posture" not in line)
    assert re.search(r"centre_mm: .* # u .* mm$", done.stdout, re.M)
    assert re.search(r"normal: .* # u .*°$", done.stdout, re.M)
    assert "--write" in done.stderr and cell.read_text() == before
    assert list(cell.parent.iterdir()) == [cell]


def test_file_is_written_and_each_old_one_is_kept(run, cell):
    before = cell.read_text()
    done = succeeded(f"circle fit {run} --rig {cell} --write")
    assert "cell.yaml.1" in done.stderr
    assert (cell.parent / "cell.yaml.1").read_text() == before
    first = cell.read_text()
    assert yaml.safe_load(first)["tests"]["circle"]["centre_mm"] == CENTRE
    assert "# by ruler" in first and cell.stat().st_mode & 0o777 == 0o640
    succeeded(f"circle fit {run} --rig {cell} --write")
    assert cell.read_text() == first and len(list(cell.parent.iterdir())) == 2
    cell.write_text(first.replace("radius_mm: ", "radius_mm: 1", 1))
    succeeded(f"circle fit {run} --rig {cell} --write")
    assert len(list(cell.parent.iterdir())) == 3 and ran(f"check {cell}").returncode == 0


def test_arc_a_turn_away_from_the_limits_is_drivable(tmp_path):
    """From the start of this arc axis 6 would leave its limits during a lap; a full turn away it does not."""
    q = around(np.linspace(0, 90, 300))
    q[:, 5] -= 360
    names = ["t_s", *JOINTS, "direction", "g1_mm", "g2_mm"]
    write_columns(tmp_path / "arc.csv", names, np.arange(300) / 50, q, np.full(300, "acw"), np.zeros((300, 2)))
    succeeded(f"import {tmp_path}/arc.csv --rig ur10e-cell --test yaw -o {tmp_path}/arc")
    done = succeeded(f"circle fit {tmp_path}/arc")
    assert "cannot drive" not in done.stderr


def test_json_contains_values_and_uncertainties(run):
    found = json_of(f"circle fit {run}")
    assert found["test"] == "circle" and found["radius_mm"] == pytest.approx(70, abs=0.02)
    assert set(found["u"]) >= {"centre_mm", "normal_deg", "radius_mm"}
    assert len(found["u"]["centre_mm"]) == 3 and 0 < found["u"]["radius_mm"] < 0.02


def test_ball_is_fitted_to_a_circle_or_to_stops(run, cell, tmp_path):
    done = succeeded(f"ball fit {run} --rig {cell} --write")
    assert contents(cell)["tests"]["hemisphere"]["centre_mm"] == CENTRE
    radial = simulate("ur10e-cell", "radial", seed=1)
    done = ran("ball", "fit", save_run(radial, tmp_path / radial.path), "--rig", cell)
    assert yaml.safe_load(done.stdout)["tests"]["hemisphere"]["centre_mm"] == pytest.approx([-800, -200, 0], abs=0.05)
    assert failure_of(f"ball fit {tmp_path}/{radial.path} {run}")[1] == "readings.unsuitable"


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ((), "usage"),
        (("RUN", "--live"), "usage"),
        (("RUN", "--write"), "usage"),
        (("RUN", "--rig", "ur10e-cell", "--write"), "output.not_writable"),
        (("RUN", "--rig", "paper-fanuc"), "robot.other"),
    ],
)
def test_impossible_fit_is_refused(words, code, run):
    assert failure_of("circle", "fit", *(run if word == "RUN" else word for word in words))[1] == code


def test_read_only_file_is_unchanged(run, cell):
    before = cell.read_text()
    cell.chmod(0o440)
    assert failure_of(f"circle fit {run} --rig {cell} --write")[1] == "output.not_writable"
    assert cell.read_text() == before and list(cell.parent.iterdir()) == [cell]


def test_live_points_are_fitted_at_ctrl_c(tmp_path):
    data = yaml.safe_load(rig_text())
    data["feedback"]["rate_hz"] = 125  # a robot that is led by hand needs no more, and four programs look at it
    points = around(np.array([0.0, 90.0, 180.0, 270.0])).tolist()
    with Bench(tmp_path, yaml.safe_dump(data)) as bench:
        bench.motion.deg = points[0]
        bench.start()
        with subprocess.Popen(
            [BIN / "rig", *f"circle fit --live --rig {bench.rig} --write".split()],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=bench.env,
        ) as watch:
            assert "jog" in watch.stderr.readline()
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
        assert contents(bench.rig)["tests"]["circle"]["radius_mm"] == pytest.approx(70, abs=0.1)


def around(degrees: Array) -> Array:
    """Joint angles (n, 6) in degrees at angles of the shipped circle."""
    rig = load("ur10e-cell")[0]
    circle = circle_of(rig)
    poses = frame_of(circle).poses(np.radians(degrees))
    return np.degrees(follow(arm_of(rig.robot), poses, np.radians(circle.posture_deg), "test"))

"""docs/circle-fit.md, done: an emulated robot drives, and its rig file then has the circle that it drove."""

import pytest
import yaml

from analysis.apps.emulate.robot import EmulatedRobot
from daq.emulators.instruments import emulated
from rigs.load import load, parse
from tests.support.bench import Bench, rig_text

DRIVEN = {"centre_mm": [-700, -180, 240], "normal": [0.1, 0.05, 1], "radius_mm": 75}


@pytest.mark.timeout(120)
def test_the_rig_file_learns_the_circle_that_the_robot_drives(tmp_path):
    known = yaml.safe_load(rig_text())
    driven = yaml.safe_load(rig_text())
    driven["tests"]["circle"] |= {**DRIVEN, "laps": 1, "speed_mm_s": 100}
    robot = EmulatedRobot.of_rig(parse(yaml.safe_dump(driven), "driven"), seed=3)
    text = yaml.safe_dump(known)
    with Bench(tmp_path, text, cell=emulated(parse(text, "known"), robot, names=tmp_path / "by-id")) as bench:
        bench.start().all_reading()
        run = bench.record("first-acw")
        robot.start("acw")
        assert robot.finished.wait(60)
        assert bench.run("rig", "record", "stop").returncode == 0
        written = bench.run("rig", "circle", "fit", run, "--rig", bench.rig, "--write")
        assert written.returncode == 0, written.stderr
        checked = bench.run("rig", "check", bench.rig)
        assert checked.returncode == 0 and "circle of 75" in checked.stdout, checked.stdout + checked.stderr
    circle = load(bench.rig)[0].tests.circle
    assert circle.centre_mm == pytest.approx(DRIVEN["centre_mm"], abs=0.05)
    assert circle.radius_mm == pytest.approx(DRIVEN["radius_mm"], abs=0.05)
    length = sum(part**2 for part in DRIVEN["normal"]) ** 0.5
    assert circle.normal == pytest.approx([part / length for part in DRIVEN["normal"]], abs=1e-3)

"""From the wire to the report: an emulated robot drives a quick lap, each kind of gauge reads it, and what
`rig analyse` finds agrees with the truth that the cell hides."""

import json

import pytest
import yaml

from analysis.apps.emulate.robot import EmulatedRobot, ideal_results
from rigs.load import load_hidden, parse
from tests.support.bench import rig_text
from tests.support.nightly import cases
from tests.support.simulated_bench import SimulatedBench


def _quick(gauges: str, laps: int) -> str:
    data = yaml.safe_load(rig_text(gauges, timeout_s=0.5))
    data["tests"]["circle"] |= {"speed_mm_s": 100, "laps": laps}
    return yaml.safe_dump(data)


@pytest.mark.parametrize(
    ("gauges", "direction", "laps"),
    cases([("keyence", "acw", 2), ("modbus", "cw", 1), ("polled", "acw", 2), ("tcp", "cw", 1)], [("modbus", "cw", 1)]),
)
def test_laps_are_recorded_analysed_and_agree_with_the_truth(tmp_path, gauges, direction, laps):
    text = _quick(gauges, laps)
    rig = load_hidden("ur10e-cell").apply_to(parse(text, "quick"))
    robot = EmulatedRobot.of_rig(rig, seed=7)
    (tmp_path / "truth.json").write_text(json.dumps(ideal_results(rig, robot.traces)))
    with SimulatedBench(tmp_path, text, robot) as bench:
        bench.start().all_reading()
        path = bench.record("lap", direction)
        bench.drive(robot, direction)
        bench.stop()
    done = bench.run("analyse", path, "--json", "--truth", "truth.json", "--plot", "pictures")
    assert done.returncode == 0, done.stderr
    (run,) = json.loads(done.stdout)["runs"]
    assert run["direction"] == direction and run["samples"] > 100
    for name, comparison in run["truth"].items():
        assert abs(comparison["deviation_u"]) < 4, (name, run["figures"][name], comparison)
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 2


@pytest.mark.parametrize("test", cases(["radial", "repeatability"], ["repeatability"]))
def test_a_program_that_stops_at_targets_becomes_its_table(tmp_path, test):
    data = yaml.safe_load(rig_text("keyence"))
    data["tests"]["hemisphere"] |= {"step_deg": 90, "orientations": 1, "visits": 1}
    data["tests"]["repeatability"] = {"targets": [1, 3], "rounds": 1}
    data["effects"] = [{"effect": "backlash", "axis": 1, "width_deg": 0.05}]
    text = yaml.safe_dump(data)
    robot = EmulatedRobot.of_rig(parse(text, "stops"), seed=8)
    if test == "radial":
        wanted = [["1"], ["2"], ["3"], ["4"], ["5"]]
    else:
        wanted = [[k, side, "1"] for k in ("1", "3") for side in ("none", "out", "in")]
    with SimulatedBench(tmp_path, text, robot) as bench:
        bench.start().all_reading()
        path = bench.record("stops", None, test)
        bench.drive(robot, test)
        bench.stop()
    done = bench.run("export", path, "--to", "csv", "-o", "table.csv")
    assert done.returncode == 0, done.stderr
    rows = (tmp_path / "table.csv").read_text().splitlines()
    assert [row.split(",")[: len(wanted[0])] for row in rows[1:]] == wanted

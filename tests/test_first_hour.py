"""docs/first-hour.md, done: from a cell of which nothing is written down to a report, in a terminal, keys counted."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from analysis.apps.emulate.robot import EmulatedRobot
from daq.acquisition.streams import ROBOT, streams_of
from daq.emulators.emulated_cell import EmulatedInstruments
from daq.emulators.instruments import emulated, instruments_of
from daq.protocol.conversation import Device
from rigs.load import load, parse
from rigs.rig import Rig
from rigs.schema.limits import Limit
from tests.support.bench import BIN
from tests.support.live_terminal import Terminal
from tests.support.nightly import cases
from tests.support.person import Person
from tests.support.simulated_bench import SimulatedBench
from tests.support.unknown_cells import Pushed, cell_text, make_it_stream, named_robot

PAGE = (Path(__file__).parents[1] / "docs" / "first-hour.md").read_text()
CELLS = {
    "Sylvac, FANUC line feed": ("sylvac", "fanuc"),
    "Keyence, UR": ("keyence", "ur"),
    "Modbus, KUKA RSI": ("modbus", "kuka"),
    "Micro-Epsilon, UR": ("micro_epsilon", "ur"),
}
ZEROS = ["--key", "g1.zero_mm=5", "--key", "g2.zero_mm=5"]


def counted() -> dict[str, int]:
    return {name: int(keys) for name, keys in re.findall(r"^\| ([^|]+?) \| (\d+) \| \d+ \| \d+ \|$", PAGE, re.M)}


def set_up(gauges: str, robot: str, cell: EmulatedInstruments, hand: Pushed, path: Path) -> int:
    """Run `rig init cell.yaml` as on the page, with options for facts that emulated ports cannot show; return the
    number of
    key presses.
    """
    ports = [port for place, port in cell.ports.items() if place != "feedback"]
    if gauges == "micro_epsilon":
        for port in ports:
            make_it_stream(port, b"OUTPUT RS422\n")
    options = [word for port in dict.fromkeys(ports) for word in ("--port", port)] + named_robot(robot)
    options += ZEROS if gauges == "micro_epsilon" else []
    with Terminal([BIN / "rig", "init", path, *options], 80, 60, {}) as terminal:
        person = Person(terminal)
        person.answers("Robot: its host name", cell.ports["feedback"])
        for number in (1, 2):
            person.asked(f"Push gauge {number}")
            hand.by_mm[f"g{number}"] = -1.0
            person.asked(f"g{number}: ")
            hand.by_mm.clear()
        if gauges == "micro_epsilon":
            person.answers("range_mm of g1", "10")
            person.answers("range_mm of g2", "10")
        person.answers("Distance between", "")
        person.answers("Arm: ", "ur10e")
        person.answers("Pose of the ball on the flange", "0,0,150,0,90,0")
        person.answers("Allowed error in mm", "")
        person.answers("Is the robot at the start", "y")
        assert terminal.ended() == 0, terminal.text()
    return person.keys


def at_ports(
    rig: Rig, cell: EmulatedInstruments, made: Mapping[str, Callable[[], Device]]
) -> dict[str, Callable[[], Device]]:
    true = {name: stream for stream in made for name in stream.split("_")} | {"feedback": ROBOT}
    by_port = {port: made[true[name]] for name, port in cell.ports.items()}
    return {stream.name: by_port[stream.port] for stream in streams_of(rig)}


def test_the_page_lists_these_cells():
    assert list(counted()) == list(CELLS)


@pytest.mark.parametrize("name", cases(CELLS, ("Keyence, UR", "Sylvac, FANUC line feed")))
def test_from_an_unknown_cell_to_a_report(name, tmp_path):
    """The lap is driven in simulated time: by the instruments of the cell, with the rig file that was written."""
    gauges, robot = CELLS[name]
    unknown = parse(cell_text(gauges, robot, speed_mm_s=50), "unknown")
    hand, path = Pushed(driven := EmulatedRobot.of_rig(unknown, seed=3)), tmp_path / "cell.yaml"
    cell = emulated(unknown, hand, names=tmp_path / "by-id")
    cell.start()
    try:
        assert set_up(gauges, robot, cell, hand, path) == counted()[name]
    finally:
        cell.stop()
    rig, text = load(path)
    assert rig.feedback.port == cell.ports["feedback"] and not rig.effects and "# " in text
    assert rig.limits.of("yaw", "circular_deviation_mm") == Limit(watch=0.125, fail=0.25)
    with SimulatedBench(tmp_path, text, devices=at_ports(rig, cell, instruments_of(unknown, hand))) as bench:
        bench.start().all_reading()
        run = bench.record("first-acw")
        bench.drive(driven, "acw")
        bench.stop()
    done = bench.run("report", run, "--no-diagnosis", "-o", "first.html")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "first.html").stat().st_size > 10_000
    figures = bench.run("analyse", run)
    assert figures.returncode == 0 and "yaw" in figures.stdout

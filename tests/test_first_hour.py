"""docs/first-hour.md, done: from a cell of which nothing is written down to a report, in a terminal, keys counted."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest

from analysis.simulation.emulated_robot import EmulatedRobot
from daq.emulators import emulated
from rigs.load import load, parse
from tests.support.bench import BIN, Bench
from tests.support.live_terminal import Terminal
from tests.support.person import Person
from tests.support.unknown_cells import Pushed, cell_text, make_it_stream, named_robot

PAGE = (Path(__file__).parents[1] / "docs" / "first-hour.md").read_text(encoding="utf-8")
CELLS = {
    "Sylvac, FANUC line feed": ("sylvac", "fanuc"),
    "Keyence, UR": ("keyence", "ur"),
    "Modbus, KUKA RSI": ("modbus", "kuka"),
    "Micro-Epsilon, UR": ("micro_epsilon", "ur"),
}
SPEEDS_MM_S = (25, 12, 6)
"""As fast as a new rig file says. Where a lap is refused for a gap, a person drives the next one slower: the holes of 5
degrees that the report takes are 0.25 s, 0.5 s and 1 s then."""
ZEROS = ["--key", "g1.zero_mm=5", "--key", "g2.zero_mm=5"]


def counted() -> dict[str, int]:
    """The keys that the page states, by cell."""
    return {name: int(keys) for name, keys in re.findall(r"^\| ([^|]+?) \| (\d+) \| \d+ \| \d+ \|$", PAGE, re.M)}


def measured(bench: Bench, driven: EmulatedRobot, name: str) -> Path | None:
    """Drive a lap and report it; None where the report refuses it for a gap, as a busy computer leaves."""
    run = bench.record(name)
    driven.start("acw")
    assert driven.finished.wait(120)
    assert bench.run("rig", "record", "stop").returncode == 0
    done = bench.run("rig", "report", run, "--no-diagnosis", "-o", "first.html")
    assert done.returncode == 0 or "the lap has no data from" in done.stderr, done.stderr
    return run if done.returncode == 0 else None


def test_the_page_lists_these_cells() -> None:
    assert list(counted()) == list(CELLS)


@pytest.mark.alone  # an instrument that is held up for a part of the lap has it refused
@pytest.mark.timeout(400)
@pytest.mark.parametrize("name", CELLS)
def test_from_an_unknown_cell_to_a_report(name: str, tmp_path: Path) -> None:
    gauges, robot = CELLS[name]
    text = cell_text(gauges, robot)
    rig = parse(text, "unknown")
    hand = Pushed(EmulatedRobot.of_rig(rig, seed=3))
    with Bench(tmp_path, text, cell=emulated(rig, hand, names=tmp_path / "by-id")) as bench:
        bench.rig = tmp_path / "cell.yaml"
        ports = [port for place, port in bench.cell.ports.items() if place != "feedback"]
        if gauges == "micro_epsilon":
            for port in ports:
                make_it_stream(port, b"OUTPUT RS422\n")
        # The page's own `rig init cell.yaml`, told what emulated ports do not show, and the sensors' zero.
        options = [word for port in dict.fromkeys(ports) for word in ("--port", port)] + named_robot(robot)
        options += ZEROS if gauges == "micro_epsilon" else []
        command: list[str | Path] = [BIN / "rig", "init", bench.rig, *options]
        began_s = time.monotonic()
        with Terminal(command, 80, 60, {}) as terminal:
            person = Person(terminal)
            person.answers("Robot: its host name", bench.cell.ports["feedback"])
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
            person.answers("The ball on the flange", "0,0,150,0,90,0")
            person.answers("Allowed error in mm", "")
            person.answers("Does the robot stand", "y")
            assert terminal.ended() == 0, terminal.text()
        took_s = time.monotonic() - began_s
        assert person.keys == counted()[name]
        bench.socket = tmp_path / "rigd" / "cell.sock"
        bench.start().all_reading()
        for speed_mm_s in SPEEDS_MM_S:
            hand.motion = driven = EmulatedRobot.of_rig(parse(cell_text(gauges, robot, speed_mm_s), "unknown"), seed=3)
            run = measured(bench, driven, f"first-acw-{speed_mm_s}")
            if run is not None:
                break
        assert run is not None, "no lap was taken"
        figures = bench.run("rig", "analyse", run)
    print(f"{name}: {person.keys} keys, {took_s:.0f} s, with the report {time.monotonic() - began_s:.0f} s")
    assert (tmp_path / "first.html").stat().st_size > 10_000
    assert figures.returncode == 0 and "yaw" in figures.stdout
    assert load(bench.rig)[0].tests.circle is not None

"""The daemon, its cell and its disk in simulated time: the same each time, whatever befalls them."""

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml

from daq import clock
from daq.emulators.simulated_cell import SimulatedCell
from daq.emulators.simulated_clock import Deadlock, SimulatedClock
from daq.protocol.conversation import FaultKind
from daq.store import read_run
from tests.support.bench import ByHand, rig_text

START = {"command": "record_start", "name": "lap", "test": "yaw", "direction": "acw"}


def slow_rig() -> str:
    """Gauges that are asked, which take less of this computer than those that stream."""
    return yaml.safe_dump(yaml.safe_load(rig_text("polled")))


def recorded(folder: Path, seed: int) -> tuple[dict[str, np.ndarray], Counter[str], dict[str, dict[str, int]]]:
    """A recording in which a cable was pulled: its stamps, its faults and what was counted."""
    folder.mkdir()
    hand = ByHand()
    with SimulatedClock(seed).running() as time:
        cell = SimulatedCell(time, folder, slow_rig(), hand, hand.signal)
        daemon = cell.daemon()
        clock.sleep(2)
        path = Path(daemon.answer(START)["run"])
        clock.sleep(1)
        cell.lines["g1"].unplug()
        clock.sleep(1)
        cell.lines["g1"].plugged = True
        clock.sleep(3)
        counted = daemon.answer({"command": "record_stop"})["counters"]
        daemon.close("complete", "the test is over")
        assert not time.errors
    run = read_run(path)
    stamps = {name: np.asarray(run.streams[name]["last_byte_ns"]) for name in counted}
    return stamps, Counter(fault["kind"] for fault in run.faults), counted


def test_seed_reproduces_a_recording_with_all_counted_samples(tmp_path):
    (stamps, faults, counted), (again, *_) = recorded(tmp_path / "a", 1), recorded(tmp_path / "b", 1)
    (others, *_) = recorded(tmp_path / "c", 2)
    assert all(np.array_equal(stamps[name], again[name]) for name in stamps)
    assert not all(np.array_equal(stamps[name], others[name]) for name in stamps)
    assert {name: len(found) for name, found in stamps.items()} == {
        name: counts["samples"] for name, counts in counted.items()
    }
    assert counted["g1"][FaultKind.DISCONNECTED] == 1 and faults[FaultKind.DISCONNECTED] >= 1
    assert faults[FaultKind.STALLED] == 0
    assert np.diff(stamps["g1"]).max() > 1e9 > np.diff(stamps["robot"]).max()


@pytest.mark.parametrize(("line", "keeps_up"), [("9600 8N1", False), ("115200 8N1", True)])
def test_serial_robot_is_read_at_the_pace_of_its_line(line, keeps_up, tmp_path):
    rig, hand = yaml.safe_load(slow_rig()), ByHand()
    rig["feedback"] = {"interface": "line_feed", "port": "/dev/ttyUSB9", "line": line}
    with SimulatedClock(1).running() as time:
        daemon = SimulatedCell(time, tmp_path, yaml.safe_dump(rig), hand, hand.signal).daemon()
        clock.sleep(3)
        samples = daemon.answer({"command": "status"})["streams"]["robot"]["counters"]["samples"]
        daemon.close("complete", "over")
    assert (samples > 270) is keeps_up  # 100 lines a second, of 59 characters


def test_synced_rows_of_a_killed_run_are_recovered(tmp_path):
    hand = ByHand()
    with SimulatedClock(3).running() as time:
        cell = SimulatedCell(time, tmp_path, slow_rig(), hand, hand.signal)
        daemon = cell.daemon()
        clock.sleep(2)
        path = Path(daemon.answer(START)["run"])
        clock.sleep(3.3)
        synced = daemon.answer({"command": "status"})["synced"]
        cell.kill(daemon)
        clock.sleep(1)
        second = cell.daemon()
        clock.sleep(2)
        assert second.answer({"command": "status"})["recording"] is None
        second.close("complete", "over")
        assert not time.errors
    run = read_run(path)
    assert run.manifest.exit_status == "recovered"
    assert all(0 < count <= len(run.streams[name]["last_byte_ns"]) for name, count in synced.items())


def test_deadlocked_threads_are_named_with_the_seed():
    with pytest.raises(Deadlock, match="one, other") as error, SimulatedClock(7).running():
        first, second = clock.Event(), clock.Event()
        clock.Thread(target=first.wait, name="one", daemon=True).start()
        clock.Thread(target=second.wait, name="other", daemon=True).start()
        clock.Event().wait()
    assert re.search("seed 7", error.value.__notes__[0])

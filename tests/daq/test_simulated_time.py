"""The daemon, its cell and its disk in simulated time: the same each time, whatever befalls them."""

import re

import pytest
import yaml

from daq import clock
from daq.emulators.simulated_cell import SimulatedCell
from daq.emulators.simulated_clock import Deadlock, SimulatedClock
from tests.support.bench import ByHand, rig_text


def slow_rig() -> str:
    """Gauges that are asked, which take less of this computer than those that stream."""
    return yaml.safe_dump(yaml.safe_load(rig_text("polled")))


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


def test_deadlocked_threads_are_named_with_the_seed():
    with pytest.raises(Deadlock, match="one, other") as error, SimulatedClock(7).running():
        first, second = clock.Event(), clock.Event()
        clock.Thread(target=first.wait, name="one", daemon=True).start()
        clock.Thread(target=second.wait, name="other", daemon=True).start()
        clock.Event().wait()
    assert re.search("seed 7", error.value.__notes__[0])

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from analysis.runs.batch import CompletedItem, FailedItem, each
from rigs.errors import FileError
from rigs.problems import Problem, RigFileError
from tests.support.child_processes import Deadly, die, is_gone, sign_in, signed_in, until

BAD, NAN, MISTAKEN = 3, 4, 5


def worked(item: int) -> int:
    """The square; some items are bad. The first take longest, so that several processes end out of order."""
    if item == BAD:
        raise FileError("item 3", "is bad", "give another")
    if item == NAN:
        return int(np.float64(0) / np.float64(0))
    if item == MISTAKEN:
        raise RigFileError("rig.yaml", [Problem(7, "gauges", "missing")])
    times = 20_000 * max(1, 9 - item)
    return sum(item**2 for _ in range(times)) // times


def seen(jobs: int) -> list[object]:
    found = each(worked, range(20), jobs=jobs)
    return [one.value if isinstance(one, CompletedItem) else (str(one.error), one.error.lines()) for one in found]


@pytest.mark.parametrize("jobs", [0, 2, 5])
def test_several_processes_give_the_results_of_one(jobs):
    one = seen(1)
    assert seen(jobs) == one
    assert one[2] == 4 and one[BAD] == ("item 3: is bad; give another", ["item 3: is bad; give another"])
    assert "computation failed" in str(one[NAN]) and one[MISTAKEN][1] == ["rig.yaml, line 7, gauges: missing"]


@pytest.mark.parametrize("times", [1, 2])
def test_a_process_that_is_killed_costs_its_own_item_at_most(times, tmp_path):
    items = [Deadly(tmp_path, number, times if number == 1 else 0) for number in range(6)]
    found = list(each(die, items, jobs=2))
    assert [one.deaths for one in found] == [0, times, 0, 0, 0, 0]
    assert [one.value for one in found if isinstance(one, CompletedItem)] == [
        0,
        *([1] if times == 1 else []),
        2,
        3,
        4,
        5,
    ]
    if times == 2:
        (failed,) = (one for one in found if isinstance(one, FailedItem))
        assert failed.item == items[1] and "signal 9" in failed.error.what


def wrong(item: int) -> int:
    return [item][item]


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_bug_is_raised(jobs):
    with pytest.raises(IndexError) as bug:
        list(each(wrong, range(4), jobs=jobs))
    assert jobs == 1 or "return [item][item]" in bug.value.__notes__[0]  # where it happened in the child


def signs_in_and_waits(item: Path) -> int:
    """The first process that signs in is done at once; the others wait until they are released."""
    sign_in(item)
    if len(signed_in(item)) > 1:
        until((item / "released").exists)
    return os.getpid()


def test_abandoned_iteration_leaves_no_process(tmp_path):
    outcomes = each(signs_in_and_waits, [tmp_path] * 4, jobs=2)
    next(outcomes)
    outcomes.close()
    assert signed_in(tmp_path) and all(map(is_gone, signed_in(tmp_path)))


def test_ctrl_c_just_before_a_wait_is_noticed(monkeypatch, tmp_path):
    """Python's own handler runs when a call returns: here the signal comes as it does between the two."""
    pressed = []

    def wait(lines: list[object], timeout: float | None = None) -> list[object]:
        if pressed:  # the handler runs, as the call before has returned
            raise KeyboardInterrupt
        assert timeout is not None  # waits for ever, and Ctrl-C with it
        pressed.append(True)
        return []

    monkeypatch.setattr("analysis.runs.batch.wait", wait)
    with pytest.raises(KeyboardInterrupt):
        list(each(waits, [tmp_path] * 4, jobs=2))


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_ended_program_leaves_no_process(end, tmp_path):
    program = f"""
import sys, pathlib, analysis.runs.batch as batch, {__name__} as here
list(batch.each(here.waits, [pathlib.Path(sys.argv[1])] * 4, jobs=2))
"""
    child = [sys.executable, "-c", program, str(tmp_path)]
    with subprocess.Popen(child, stderr=subprocess.PIPE, text=True, start_new_session=True) as parent:
        try:
            assert parent.stderr and until(lambda: len(signed_in(tmp_path)) == 2)
            if end == signal.SIGINT:
                os.killpg(parent.pid, end)  # as a terminal sends it, to the workers too
            else:
                parent.send_signal(end)
                (
                    tmp_path / "released"
                ).touch()  # nobody is left to end what is being worked on: the workers end after it
            said = parent.stderr.read().strip()
        finally:
            (tmp_path / "released").touch()  # a test that fails waits for nobody
    assert said.count("Traceback") == (end == signal.SIGINT)  # of the parent, and of no worker
    assert said.endswith("KeyboardInterrupt" if end == signal.SIGINT else "")
    assert until(lambda: all(map(is_gone, signed_in(tmp_path))))


def waits(item: Path) -> None:
    sign_in(item)
    until((item / "released").exists, 600)

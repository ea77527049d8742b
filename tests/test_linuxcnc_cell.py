"""docs/linuxcnc.md on the real controller: connect, read its arm, write a program, drive it and record every sample."""

import os
import pwd
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from tests.worlds.linuxcnc import machine
from tests.worlds.linuxcnc.arm import HOME_DEG, tool_at
from tests.worlds.linuxcnc.person import FAULTS, Person
from tests.worlds.linuxcnc.soak import counted, record, robot_columns

BIN = Path(sys.executable).parent
PAGE = (Path(__file__).parents[1] / "docs" / "linuxcnc.md").read_text()
USER = "rigcell"
"""User of the controller if the tests run as root, made by scripts/linuxcnc-cell."""


def missing() -> str:
    if shutil.which("linuxcnc") is None:
        return "LinuxCNC is not installed (package linuxcnc-uspace)"
    if os.geteuid() == 0 and USER not in [user.pw_name for user in pwd.getpwall()]:
        return f"LinuxCNC does not run as root, and there is no user {USER}: run scripts/linuxcnc-cell once"
    return ""


pytestmark = [pytest.mark.skipif(bool(missing()), reason=missing()), pytest.mark.real_time]


@pytest.fixture
def person():
    directory = Path(tempfile.mkdtemp(prefix="linuxcnc-"))
    directory.chmod(0o755)
    user = USER if os.geteuid() == 0 else pwd.getpwuid(os.geteuid()).pw_name
    person = Person(directory, user, FAULTS)
    arm = person.prepare()
    rigd = subprocess.Popen([BIN / "rigd", person.rig_file, "--runs", directory / "runs"], stderr=subprocess.DEVNULL)
    yield person
    for process in (rigd, arm):
        process.terminate()
        process.wait()
    person.controller.stop()
    shutil.rmtree(directory)


def page_command(word: str, directory: Path) -> list[str]:
    line = re.search(rf"^(rig {word} .*)$", PAGE, re.M)
    assert line
    return [str(BIN / "rig"), *shlex.split(line[1].replace("cell.yaml", str(directory / "cell.yaml")))[1:]]


def test_recipe_drives_the_circle_and_records_every_servo_period(person):
    directory = person.directory
    subprocess.run(page_command("program", directory), cwd=directory, check=True, capture_output=True)
    program = next((directory / "programs").glob("yaw_acw*.ngc"))
    shutil.copy(program, directory / "machine")
    machine.ask(f"run {directory / 'machine' / program.name}")
    until_s = time.monotonic() + 60
    while machine.ask("state")["state"] != "waits" and time.monotonic() < until_s:
        time.sleep(0.2)
    machine.ask("continue")
    run = record("circle", 16, directory / "runs")
    assert machine.ask("state") == {"program": str(directory / "machine" / program.name), "state": "idle", "errors": []}
    columns = robot_columns(run)
    found = counted(columns["device_time_s"])
    assert (found["lost"], found["invented"], found["restarts"]) == (0, 0, 0)
    joints = np.stack([columns[f"q{axis}_deg"] for axis in range(1, 7)], axis=1)
    away = tool_at(joints)[1] - [500, 150, 450]
    assert np.ptp(np.degrees(np.unwrap(np.arctan2(away[:, 1], away[:, 0])))) > 360
    assert np.abs(np.hypot(away[:, 0], away[:, 1]) - 70).max() < 2e-3 and np.abs(away[:, 2]).max() < 2e-3
    assert HOME_DEG.any()

"""The configuration of LinuxCNC for the arm, and the controller as a process of an ordinary user."""

from __future__ import annotations

import json
import os
import pwd
import shutil
import signal
import socket
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from tests.worlds.linuxcnc.arm import A_MM, ALPHA_DEG, D_MM, HOME_DEG, Array

_START_DEG = (2.0, 45.0, -3.0, 180.0, 42.1, 2.0)
"""Joint angles after homing."""
_INI = """\
[EMC]
VERSION = 1.1
MACHINE = cell
[KINS]
JOINTS = 6
KINEMATICS = genserkins
[HAL]
HALFILE = LIB:basic_sim.tcl -no_use_hal_manualtoolchange -no_sim_spindle
HALFILE = arm.hal
{files}
[RS274NGC]
PARAMETER_FILE = cell.var
[DISPLAY]
DISPLAY = {panel}
[EMCMOT]
EMCMOT = motmod
COMM_TIMEOUT = 1.0
SERVO_PERIOD = 1000000
[TASK]
TASK = milltask
CYCLE_TIME = 0.010
[TRAJ]
COORDINATES = X Y Z A B C
LINEAR_UNITS = {unit}
ANGULAR_UNITS = deg
MAX_LINEAR_VELOCITY = {fastest}
DEFAULT_LINEAR_VELOCITY = {usual}
MAX_LINEAR_ACCELERATION = {acceleration}
DEFAULT_LINEAR_ACCELERATION = {acceleration}
[EMCIO]
EMCIO = io
CYCLE_TIME = 0.1
TOOL_TABLE = cell.tbl
"""
_AXIS = "[AXIS_{0}]\nMAX_VELOCITY = {1}\nMAX_ACCELERATION = {2}\nMIN_LIMIT = -{3}\nMAX_LIMIT = {3}\n"
_JOINT = (
    "[JOINT_{0}]\nTYPE = ANGULAR\nMAX_VELOCITY = 120\nMAX_ACCELERATION = 1000\nMIN_LIMIT = {3}\nMAX_LIMIT = {4}\n"
    "HOME_OFFSET = {1:.6f}\nHOME = {2}\nHOME_SEQUENCE = 0\n"
)
_MM = {"mm": 1.0, "inch": 25.4}
PANEL_PORT = 5490


def write_configuration(
    directory: Path, home_deg: Array = HOME_DEG, extra: tuple[str, ...] = (), unit: str = "mm"
) -> Path:
    """Write the INI file, the HAL file with the nominal arm and the sampler of the motors. Return the INI file.

    extra: further HAL files, which are in the directory. unit: of all lengths of the machine, mm or inch.
    """
    mm = _MM[unit]
    panel = directory / "panel.py"
    shutil.copy(Path(__file__).with_name("panel.py"), panel)
    panel.chmod(0o755)
    files = "\n".join(f"HALFILE = {name}" for name in extra)
    lengths = {"fastest": 1000 / mm, "usual": 50 / mm, "acceleration": 2000 / mm}
    text = _INI.format(files=files, panel=panel, unit=unit, **lengths)
    text += "".join(_AXIS.format(letter, 1000 / mm, 2000 / mm, 3000 / mm) for letter in "XYZ")
    text += "".join(_AXIS.format(letter, 120, 2000, 3000) for letter in "ABC")
    for joint, (offset, start) in enumerate(zip(home_deg, _START_DEG, strict=True)):
        # Ends of queued moves are solved from the present posture, so the last joint needs a turn more.
        reach = 800 if joint == 5 else 300
        text += _JOINT.format(joint, offset, start, -reach, reach)
    pins = [f"setp genserkins.A-{k} {value!r}" for k, value in enumerate((A_MM / mm).tolist())]
    pins += [f"setp genserkins.ALPHA-{k} {value!r}" for k, value in enumerate(np.radians(ALPHA_DEG).tolist())]
    pins += [f"setp genserkins.D-{k} {value!r}" for k, value in enumerate((D_MM / mm).tolist())]
    pins.append("net kinematics motion.analog-out-03 => motion.switchkins-type")
    (directory / "arm.hal").write_text("\n".join([*pins, ""]))
    (directory / "cell.tbl").write_text("")
    ini = directory / "cell.ini"
    ini.write_text(text)
    return ini


def add_motors(rig_hal: str) -> str:
    """HAL file of rig with a second channel of the sampler for the motors, of which rig knows nothing."""
    both = rig_hal.replace("depth=8000 cfg=ffffffbfs", "depth=8000,8000 cfg=ffffffbfs,ffffffs")
    nets = [f"net J{k}:pos-fb => sampler.1.pin.{k}" for k in range(6)]
    nets.append("net motors-lost sampler.1.overruns => sampler.1.pin.6")
    return "\n".join([both, "addf sampler.1 servo-thread", *nets, ""])


class Controller:
    """LinuxCNC as a process group of an ordinary user."""

    def __init__(self, ini: Path, user: str) -> None:
        shutil.chown(ini.parent, user)
        for file in ini.parent.iterdir():
            shutil.chown(file, user)
        environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
        self._others = _threads()
        environment["HOME"] = pwd.getpwnam(user).pw_dir
        self._log = (ini.parent / "linuxcnc.log").open("ab")
        self._process = subprocess.Popen(
            [*as_user(user), "linuxcnc", "-r", str(ini)],
            stdin=subprocess.DEVNULL, stdout=self._log, stderr=subprocess.STDOUT, env=environment,
            start_new_session=True,
        )  # fmt: skip
        until_s = time.monotonic() + 60
        while True:
            with suppress(OSError):
                if ask("state")["state"] == "idle":
                    return
            if self._process.poll() is not None or time.monotonic() > until_s:
                raise RuntimeError(f"LinuxCNC did not start; see {ini.parent / 'linuxcnc.log'}")
            time.sleep(0.3)

    def stop(self) -> None:
        """End LinuxCNC as its operator does."""
        ask("quit")
        self._process.wait(60)
        self._log.close()

    def kill(self) -> None:
        """Kill all its processes at once, as a power cut does."""
        for pid in (_threads() - self._others) | _session(self._process.pid):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self._process.wait(10)
        self._log.close()


def _threads() -> set[int]:
    """Processes of the real-time threads, which leave the process group of their controller."""
    return {int(pid) for pid, name in _listed("pid,comm") if name.startswith("rtapi_app")}


def _session(pid: int) -> set[int]:
    return {int(one) for one, session in _listed("pid,sid") if int(session) == pid}


def _listed(columns: str) -> list[list[str]]:
    """Two columns of all processes."""
    listed = subprocess.run(["ps", "-eo", columns], capture_output=True, text=True, check=True).stdout
    return [line.split(None, 1) for line in listed.splitlines()[1:]]


def as_user(user: str) -> list[str]:
    """Words that start a command as an ordinary user."""
    return [] if os.geteuid() != 0 else ["runuser", "-u", user, "--"]


def ask(line: str) -> dict[str, object]:
    """Send a line to the panel and return its state."""
    with socket.create_connection(("127.0.0.1", PANEL_PORT), timeout=5) as panel:
        panel.sendall(f"{line}\n".encode())
        state: dict[str, object] = json.loads(panel.makefile().readline())
        return state

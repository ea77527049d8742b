"""The person at a cell on LinuxCNC: follows the requests of `rig session`, and enters the values of its correction.

    python -m tests.worlds.linuxcnc.person [--inch] DIRECTORY USER [FAULTS.yaml] [-- OPTIONS OF rig session]

rig is used as a person uses it: by its commands and its screen. The error of the arm before and after is that of the
cell (`cell.py`), which rig does not see.
"""

from __future__ import annotations

import json
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.worlds.linuxcnc import machine
from tests.worlds.linuxcnc.arm import HOME_DEG

FAULTS = Path(__file__).with_name("faults.yaml")
_ECCENTRICITY_MM = (0.6, -0.4, 0.1)
_CELL = """\
tests:
  circle: {centre_mm: [500, 150, 450], normal: [0, 0, 1], zero: [1, 0, 0], radius_mm: 70, speed_mm_s: 50, laps: 1,
           posture_deg: [2, 45, -3, 180, 42.1, 2]}
"""
_START = re.compile(r"start program (\S+)")
_RECORDED = re.compile(r"is being recorded: mount the link")


@dataclass
class Person:
    """The person, the controller, and what the cell measured. errors: one entry per driven program."""

    directory: Path
    user: str
    faults: Path
    unit: str = "mm"
    controller: machine.Controller | None = None
    home_deg: np.ndarray[Any, Any] = field(default_factory=HOME_DEG.copy)
    files: tuple[str, ...] = ("rig.hal",)
    stage: str = ""
    program: str = ""
    errors: list[dict[str, Any]] = field(default_factory=list)

    @property
    def rig_file(self) -> Path:
        return self.directory / "cell.yaml"

    @property
    def session(self) -> Path:
        return self.directory / "session"

    def prepare(self) -> subprocess.Popen[bytes]:
        """Write the HAL lines, start the controller and the arm, and write the rig file. Return the arm's process."""
        init = ["init", self.rig_file, "--robot", "linuxcnc://127.0.0.1"]
        _rig(*init, "--arm", "ur10e")  # no controller answers yet: it writes the HAL lines
        configuration = self.directory / "machine"
        configuration.mkdir(exist_ok=True)
        text = (self.directory / "linuxcnc" / "rig.hal").read_text()
        (configuration / "rig.hal").write_text(machine.add_motors(text))
        shutil.copy(self.directory / "linuxcnc" / "rigfeed.py", configuration)
        self.start_controller()
        arguments = [str(self.directory), self.user, str(self.faults)]
        arm = subprocess.Popen([sys.executable, "-m", "tests.worlds.linuxcnc.cell", *arguments])
        self._await_cell()
        self.mount("yaw", (500, 150, 450), 70)
        given = ["--g1", self.directory / "g1", "--g2", self.directory / "g2", "--baseline-mm", "50", "--circle-later"]
        given += ["--arm", configuration / "cell.ini", "--tool", "20,-10,150,0,90,0", "--tolerance-mm", "0.25"]
        for gauge in ("g1", "g2"):
            given += [f"--key={gauge}.interface=sylvac_opto_rs", f"--key={gauge}.mode=continuous"]
        if code := _rig(*init, *given):
            raise SystemExit(f"rig init ended with {code}")
        self.rig_file.write_text(self.rig_file.read_text() + _CELL)
        return arm

    def _await_cell(self) -> None:
        until_s = time.monotonic() + 30
        while time.monotonic() < until_s:
            try:
                if self.ask(do="state")["samples"] > 1000:
                    return
            except OSError:
                pass
            time.sleep(0.3)
        raise SystemExit("the arm receives no samples of the motors")

    def start_controller(self) -> None:
        """Write the configuration with the present values, and start LinuxCNC."""
        ini = machine.write_configuration(self.directory / "machine", self.home_deg, self.files, self.unit)
        self.controller = machine.Controller(ini, self.user)

    def ask(self, **request: Any) -> dict[str, Any]:
        with socket.socket(socket.AF_UNIX) as cell:
            cell.connect(str(self.directory / "cell.socket"))
            cell.sendall((json.dumps(request) + "\n").encode())
            answer: dict[str, Any] = json.loads(cell.makefile().readline())
            return answer

    def mount(self, test: str, centre_mm: Sequence[float], radius_mm: float) -> None:
        """Mount ball and gauges."""
        place = {"centre_mm": list(centre_mm), "radius_mm": radius_mm, "eccentricity_mm": _ECCENTRICITY_MM}
        self.ask(do="mount", test=test, **place)

    def follow(self, options: Sequence[str]) -> int:
        """Run the session, and do what it asks for. Return its exit code."""
        command = [*_RIG, "session", str(self.rig_file), "--for", "linuxcnc", "-o", str(self.session), *options]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                print(line, end="", flush=True)
                if started := _START.search(line):
                    self._start(started[1])
                elif _RECORDED.search(line):
                    self.ask(do="record")
                    machine.ask("continue")
                elif "usable" in line and self.program:
                    self._measure()
        return process.returncode

    def _start(self, program: str) -> None:
        file = next((self.session / "programs").glob(f"*/{program.replace('-', '_')}*.ngc"))
        stage, place = file.parent.name, self.directory / "machine" / file.name
        if stage != self.stage:
            cell = yaml.safe_load((self.session / "cells" / f"{stage}.yaml").read_text())
            circle = cell["tests"]["circle"]
            self.mount(program.split("-")[1], circle["centre_mm"], circle["radius_mm"])
            self.stage = stage
        shutil.copy(file, place)
        place.chmod(0o644)
        self.program = program
        machine.ask(f"run {place}")

    def _measure(self) -> None:
        error = self.ask(do="error")
        self.errors.append({"program": self.program, "stage": self.stage, "home": self.files[-1], **error})
        print(f"  [the cell: the real tool is {error['taught_um']:.1f} µm rms off the circle]", flush=True)
        self.program = ""

    def enter(self) -> None:
        """Enter the values of the correction: the pins by a HAL file, the zeros in the INI file; restart."""
        corrections = self.session / "corrections"
        shutil.copy(corrections / "rig-arm.hal", self.directory / "machine")
        joint = -1
        for line in (corrections / "home-offsets.ini").read_text().splitlines():
            if section := re.fullmatch(r"\[JOINT_(\d)\]", line):
                joint = int(section[1])
            elif change := re.match(r"# HOME_OFFSET = ([-+.\d]+) \+", line):
                self.home_deg[joint] += float(change[1])
        self.files = ("rig.hal", "rig-arm.hal")
        self.controller.stop()
        self.start_controller()


_RIG = [str(Path(sys.executable).with_name("rig"))]


def _rig(*arguments: object) -> int:
    return subprocess.run([*_RIG, *map(str, arguments)], stdin=subprocess.DEVNULL, check=False).returncode


def main(directory: Path, user: str, faults: Path = FAULTS, options: Sequence[str] = (), unit: str = "mm") -> int:
    """Run a session to the end and print the error before and after. Return 0 if it fell to a tenth."""
    directory.mkdir(parents=True, exist_ok=True)
    person = Person(directory.resolve(), user, faults.resolve(), unit)
    arm = person.prepare()
    try:
        code = person.follow(options)
        if code == 4 and "way: entries" in (person.session / "session.yaml").read_text():
            person.enter()
            code = person.follow([*options, "--entered"])
        return code or report(person.errors, directory / "errors.json")
    finally:
        arm.terminate()
        arm.wait()
        if person.controller is not None:
            person.controller.stop()


def report(errors: list[dict[str, Any]], file: Path) -> int:
    """Write the errors that the cell measured, and print those before and after. Return 0 if a tenth remains."""
    file.write_text(json.dumps(errors, indent=1))
    before = [error for error in errors if not error["program"].endswith("corrected") and error["home"] == "rig.hal"]
    after = [error for error in errors if error not in before]
    shares = {}
    for key in ("taught_um", "base_um"):
        was, now = (float(np.sqrt(np.mean([row[key] ** 2 for row in rows]))) for rows in (before, after))
        shares[key] = now / was
        print(f"{key}: {was:.1f} before, {now:.1f} after, {100 * shares[key]:.1f} %")
    print(f"samples of the motors lost: {errors[-1]['lost']}")
    return 0 if shares["taught_um"] <= 0.1 else 1


if __name__ == "__main__":
    words = sys.argv[1:]
    unit = "inch" if words[0] == "--inch" else "mm"
    words = words[unit == "inch" :]
    cut = words.index("--") if "--" in words else len(words)
    sys.exit(main(Path(words[0]), words[1], *map(Path, words[2:cut]), options=words[cut + 1 :], unit=unit))

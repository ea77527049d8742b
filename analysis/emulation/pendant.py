"""The pendant of an emulated controller: a person chooses a program there, and enters parameters.

The controller commands joint angles by its own model of the arm; the arm with its hidden effects goes where it really
goes, and the gauges read the true ball distance there.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.emulation.controller import Controller
from analysis.emulation.driving import Driven, drive
from analysis.emulation.machine import Machine, Pose, ProgramError
from analysis.emulation.program_files import ProgramFiles, find_program, interpret
from analysis.kinematics.arm import Array, arm_of
from analysis.simulation.emulated_robot import Trace, trace_along
from rigs.errors import FileError
from rigs.files import read_text
from rigs.rig import Rig
from rigs.schema.feedback import URRTDE
from rigs.schema.part import CIRCLES, MAKERS, DrivenTest, Maker, maker_of
from rigs.yaml_text import read_yaml

_MOST_BYTES = 10_000_000
"""Corrections of a path of a hundred thousand targets are below it."""
_TESTS: tuple[DrivenTest, ...] = get_args(DrivenTest)


class Pendant:
    """A controller that drives the programs of a directory with the arm of a rig, whose effects it does not know."""

    def __init__(self, rig: Rig, programs: Path, maker: Maker | None = None) -> None:
        self._rig, self._programs = rig, programs
        self._maker = maker or maker_of(rig.feedback.interface)
        self.controller: Controller | None = None
        """As a person has changed it; None where nothing was entered."""

    def trace(self, name: str) -> Trace:
        """Return what the robot does in a program, by the name of its file or of the program, and what its gauges read.
        Raises FileError for a program that is not there, cannot be read or cannot be driven."""
        files = find_program(self._programs, name)
        controller = self._of(files.maker, str(files.path))
        test = _test_of(files.path)
        try:
            driven = self._driven(files, controller, test)
        except ProgramError as error:
            raise FileError(str(files.path), f"the controller refuses it: {error}", "correct the program") from None
        g_mm, shown = trace_along(self._rig, test, driven.t_s, driven.q - controller.reads_more), self._signals(driven)
        return Trace(driven.t_s, np.empty(0), driven.q, g_mm, signals=shown, holds_s=driven.holds_s)

    def enter(self, path: Path) -> tuple[int, Array]:
        """Enter the parameters of a file of `rig correct`; return how many, and by how much each joint of the standing
        arm then reads more, (6,) rad. Raises FileError for a file that is none, or is for another controller; then
        nothing is entered."""
        try:
            _, corrections = read_yaml(read_text(path, _MOST_BYTES), str(path))
        except OSError as error:
            raise FileError(str(path), error.strerror or str(error), "check the path and its permissions") from None
        known = corrections.get("controller") if isinstance(corrections, dict) else None
        name = known.get("name") if isinstance(known, dict) else None
        before = self._of(next((one for one in MAKERS if one == name), None), str(path))
        self.controller = before.entered(corrections, str(path))
        return len(corrections["controller"]["entries"]), self.controller.reads_more - before.reads_more

    def _of(self, maker: Maker | None, where: str) -> Controller:
        """The controller; where nothing else says it, its maker is that of the first program or entries. Raises
        FileError for a program or entries of another."""
        self._maker = self._maker or maker
        if self._maker is None:
            raise FileError(where, "does not say for which controller it is", "give --for")
        if maker and maker != self._maker:
            what = f"is for a controller of {maker!r}, and this one is of {self._maker!r}"
            raise FileError(where, what, f"write it for {self._maker}, or start with --for {maker}")
        return self.controller or Controller.of_rig(self._rig, self._maker)

    def _driven(self, files: ProgramFiles, controller: Controller, test: DrivenTest) -> Driven:
        tool = _pose_of(self._rig) if files.maker == "yaskawa" else None  # a person enters it at the controller
        machine = Machine(controller.flange, tool)
        interpret(files.maker, files.texts, machine)
        place = self._rig.tests.circle if test in CIRCLES else self._rig.tests.hemisphere
        near = np.radians(place.posture_deg) if place else np.zeros(6)
        return drive(controller, machine.events, near, str(files.path))

    def _signals(self, driven: Driven) -> tuple[tuple[float, float], ...]:
        """From when on the robot shows which number: that of the outputs, the first that is switched the least, or as
        the rig file orders them; or that of the register which it names."""
        place = self._rig.feedback.signal if isinstance(self._rig.feedback, URRTDE) else None
        if place and place.int_register is not None:
            return tuple((t_s, float(value)) for t_s, at, value in driven.registers if at == place.int_register)
        order = list(place.outputs if place else dict.fromkeys(output for _, output, _ in driven.outputs))
        on, signals = dict[int | str, bool](), []
        for t_s, output, state in driven.outputs:
            on[output] = state
            signals.append((t_s, float(sum(on.get(one, False) << bit for bit, one in enumerate(order)))))
        return tuple(signals)


def _test_of(path: Path) -> DrivenTest:
    """The test for which a person has mounted the gauges, by the name of the program's file."""
    words = re.split(r"[^a-z]+", path.stem.lower())
    found = [test for test in _TESTS if test in words]
    if len(found) != 1:
        what = f"names {' and '.join(found) or 'none'} of the tests, so it is unknown how the gauges are mounted"
        raise FileError(str(path), what, f"put one of the words {', '.join(_TESTS)} into its name")
    return found[0]


def _pose_of(rig: Rig) -> Pose:
    """The tool of a rig."""
    T = arm_of(rig.robot).T_flange_tool
    return Pose(T[:3, 3], Rotation.from_matrix(T[:3, :3]))

"""Pendant of an emulated controller, which commands joint angles by its model of the arm; the arm with the hidden
effects moves to the true place."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import get_args

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.emulate.driving import ControllerState, DrivenMotion, drive
from analysis.apps.emulate.robot import Trace, trace_along
from analysis.apps.makers import maker_by, maker_of_file
from analysis.apps.makers.emulated import Machine, ProgramError, ToolPose
from analysis.apps.makers.reading import MOST_BYTES, program_texts
from analysis.robot.kinematics.arm import Array, arm_of
from rigs.errors import FileError
from rigs.files import read_text
from rigs.makers import MAKERS, maker_of
from rigs.rig import Rig
from rigs.schema.feedback import signal_of_outputs
from rigs.schema.vocabulary import CIRCLES, DrivenTest, MakerName
from rigs.yaml_text import read_yaml

_SHORTEST = 8
"""Minimum length of a name shortened to the limit of a controller: it contains test and direction."""


def interpret(name: MakerName, texts: Mapping[str, str], machine: Machine) -> None:
    maker = maker_by(name)
    text = next(text for file, text in texts.items() if Path(file).suffix.lower() in maker.files.suffixes)
    data = [text for file, text in texts.items() if Path(file).suffix.lower() == maker.files.data]
    try:
        maker.driver.run(text, data[0] if data else "", machine)
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        raise ProgramError(f"the program cannot be interpreted ({type(error).__name__}: {error})") from error


def _path_of(directory: Path, name: str) -> Path:
    """Find a program by a name as printed by `rig program`, which may be shortened in the file, or by a path."""
    named = Path(name)
    if named.parent != Path() and maker_of_file(named):
        return named
    try:
        files = sorted(path for path in directory.iterdir() if maker_of_file(path))
    except OSError as error:
        raise FileError.of_os(directory, error, "give a directory of programs", code="file.unreadable") from None
    full = _plain(named.stem if maker_of_file(named) else name)
    matching = [path for path in files if path.name == name] or [path for path in files if full in _names(path)]
    # The program name is shortened to the limit of a controller.
    matching = matching or [
        path for path in files if any(len(stem) >= _SHORTEST and full.startswith(stem) for stem in _names(path))
    ]
    if len(matching) == 1:
        return matching[0]
    if matching:
        problem = f"is ambiguous: {' and '.join(path.name for path in matching)}"
        raise FileError(repr(name), problem, "give the name of the file", code="program.unclear")
    programs = ", ".join(path.name for path in files[:8]) + (" …" if len(files) > 8 else "")
    problem = f"is not a program in {directory}"
    remedy = f"give one of {programs}" if files else "write programs there with rig program"
    raise FileError(repr(name), problem, remedy, code="maker.unknown")


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def _names(path: Path) -> tuple[str, ...]:
    name, maker = _plain(path.stem), maker_of_file(path)
    return (name, name.removesuffix(maker.files.ending)) if maker and maker.files.ending else (name,)


_TESTS: tuple[DrivenTest, ...] = get_args(DrivenTest)


class Pendant:
    def __init__(self, rig: Rig, programs: Path, maker: MakerName | None = None) -> None:
        self._rig, self._programs = rig, programs
        self._maker = maker or maker_of(rig.feedback.interface)
        self.controller: ControllerState | None = None

    def trace(self, name: str) -> Trace:
        path = _path_of(self._programs, name.strip())
        maker, texts = program_texts(path)
        controller = self._of(maker.name, str(path))
        # The file name indicates the test for which the gauges are mounted.
        words = re.split(r"[^a-z]+", path.stem.lower())
        tests = [candidate for candidate in _TESTS if candidate in words]
        if len(tests) != 1:
            problem = f"names {' and '.join(tests) or 'none'} of the tests, so the mounting of the gauges is unknown"
            remedy = f"include one of the words {', '.join(_TESTS)} in the file name"
            raise FileError(str(path), problem, remedy, code="usage")
        test = tests[0]
        try:
            T = arm_of(self._rig.robot).T_flange_tool
            entered = maker_by(controller.maker).driver.tool_entered
            machine = Machine(
                controller.flange, ToolPose(T[:3, 3], Rotation.from_matrix(T[:3, :3])) if entered else None
            )
            interpret(controller.maker, texts, machine)
            place = self._rig.tests.circle if test in CIRCLES else self._rig.tests.hemisphere
            near = np.radians(place.posture_deg) if place else np.zeros(6)
            driven = drive(controller, machine.events, near, str(path))
        except ProgramError as error:
            problem = f"the controller rejects the program: {error}"
            raise FileError(str(path), problem, "correct the program", code="robot.refused") from None
        g_mm = trace_along(self._rig, test, driven.t_s, driven.q - controller.reads_more)
        signals = self._signals(driven)
        return Trace(driven.t_s, np.empty(0), driven.q, g_mm, signals=signals, holds_s=driven.holds_s)

    def enter(self, path: Path) -> tuple[int, Array]:
        """Enter the parameters of a `rig correct` file: their number, and the change (6,) in rad of the joint readings.

        Nothing is entered if the file is invalid or for a different controller.
        """
        try:
            _, corrections = read_yaml(read_text(path, MOST_BYTES), str(path))
        except OSError as error:
            raise FileError.of_os(path, error, "check the path and the permissions", code="file.unreadable") from None
        section = corrections.get("controller") if isinstance(corrections, dict) else None
        name = section.get("name") if isinstance(section, dict) else None
        before = self._of(next((candidate for candidate in MAKERS if candidate == name), None), str(path))
        self.controller = before.entered(corrections, str(path))
        return len(corrections["controller"]["entries"]), self.controller.reads_more - before.reads_more

    def _of(self, maker: MakerName | None, where: str) -> ControllerState:
        """Controller of the maker of the first program or entry; another maker is refused."""
        self._maker = self._maker or maker
        if self._maker is None:
            problem = "does not name the maker of the controller"
            raise FileError(where, problem, "give --for", code="maker.unknown")
        if maker and maker != self._maker:
            problem = f"is for a controller of {maker!r}, but this controller is of {self._maker!r}"
            remedy = f"create the file for {self._maker}, or start with --for {maker}"
            raise FileError(where, problem, remedy, code="robot.other")
        return self.controller or ControllerState.of_rig(self._rig, self._maker)

    def _signals(self, driven: DrivenMotion) -> tuple[tuple[float, float], ...]:
        """Times and numbers of the register or of the outputs, whose bits are in the order of the rig file or of first
        switching."""
        place = signal_of_outputs(self._rig.feedback)
        if place and place.int_register is not None:
            return tuple((t_s, float(value)) for t_s, at, value in driven.registers if at == place.int_register)
        order = list(place.outputs if place else dict.fromkeys(output for _, output, _ in driven.outputs))
        on, signals = dict[int | str, bool](), []
        for t_s, output, state in driven.outputs:
            on[output] = state
            signals.append((t_s, float(sum(on.get(output, False) << bit for bit, output in enumerate(order)))))
        return tuple(signals)

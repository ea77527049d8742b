"""Whether a rig's robot can do the tests that its file names, in words."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.geometry.circle import reversals
from analysis.geometry.iso_cube import cube_of
from analysis.geometry.programs import circle_program, radial_program, repeatability_targets
from analysis.kinematics.arm import arm_of
from rigs.errors import FileError, RigPlace
from rigs.load import named_by
from rigs.rig import Rig


def feasible_tests(rig: Rig, file: str | Path) -> tuple[list[str], list[FileError]]:
    """A line for each test that the robot can drive, and for each that it cannot an error which names the file of the
    rig; a repeatability test needs targets that the hemisphere has."""
    lines, errors = [], []
    for test in (_circle, _hemisphere, _repeatability, _iso9283):
        try:
            with named_by(file, rig):
                lines += test(rig)
        except FileError as error:
            errors.append(error)
    return lines, errors


def _circle(rig: Rig) -> list[str]:
    circle = rig.tests.circle
    if circle is None:
        return ["no circle is declared"] if rig.gauges.recorded else []
    seconds = circle_program(rig, "acw").t_s[-1]
    laps = "1 lap" if circle.laps == 1 else f"{circle.laps} laps and the ways back"
    turns = reversals(circle, arm_of(rig.robot), RigPlace.of(rig.name, "tests.circle"))
    by_axis: dict[int, list[str]] = {}
    for turn in turns:
        by_axis.setdefault(turn.axis, []).append(f"{np.degrees(turn.phi):.0f}°")
    listed = "; ".join(f"{rig.robot.axis_words(axis)} {' '.join(marks)}" for axis, marks in by_axis.items())
    return [
        f"circle of {circle.radius_mm:g} mm: reachable, {seconds:.0f} s for {laps} in one direction",
        f"axes turn back: {listed}",
    ]


def _hemisphere(rig: Rig) -> list[str]:
    hemisphere = rig.tests.hemisphere
    if hemisphere is None:
        return []
    named, program = f"hemisphere of {hemisphere.radius_mm:g} mm", radial_program(rig)
    return [f"{named}: {program.target.max()} targets in {program.orientation.max()} orientations, all reachable"]


def _repeatability(rig: Rig) -> list[str]:
    if rig.tests.hemisphere is None:
        return ["repeatability: needs tests.hemisphere, which its targets are of"] if rig.tests.repeatability else []
    repeatability_targets(rig)
    return []


def _iso9283(rig: Rig) -> list[str]:
    if rig.tests.iso9283 is None:
        return []
    cube = cube_of(rig)
    where = ", ".join(f"{coordinate:.6g}" for coordinate in cube.centre_mm)
    origin = ", found where there is room" if cube.found else ""
    return [f"ISO 9283 cube of {cube.side_mm:g} mm about {where} mm: reachable on its whole plane{origin}"]

"""Arm of a LinuxCNC configuration: the pins of genserkins in its HAL files, and limits and units of the INI file.

Sources: LinuxCNC 2.9, INI configuration, HAL basics (setp), manual page kins(9). Values that the HAL files compute or
that a script sets are not known; `halcmd show pin genserkins` prints them, and its output is accepted as a HAL file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path

from rigs.errors import FileError
from rigs.files import read_text
from rigs.schema.probe import MM_PER_UNIT
from rigs.schema.robot import ConstantsSource, GenserkinsPins, JointAxis, LengthUnit, Robot, constants_hash
from rigs.schema.vocabulary import DRIVEN_AXES

_MAX_BYTES = 1_000_000
_SECTION = re.compile(r"\[(\w+)\]")
_PIN = re.compile(r"^(?:\s*setp\s+)genserkins\.(A|ALPHA|D)-(\d)\s+(\S+)", re.MULTILINE)
_UNROTATE = re.compile(r"^\s*setp\s+genserkins\.unrotate-\d\s+(?!0\b)", re.MULTILINE)
_UNITS: dict[str, LengthUnit] = {"mm": "mm", "metric": "mm", "in": "inch", "inch": "inch", "imperial": "inch"}
_DEGREES = ("deg", "degree", "degrees")
PINS = ("A", "ALPHA", "D")
WIDEST_TURN_DEG = 720.0
"""Range of A, B and C in the programs of rig: half a turn from the kinematics, and a circle with its lead-in."""
_LONGEST_NAME = 200


def configured_robot(path: Path) -> Robot:
    ini = _sections(read_text(path, _MAX_BYTES))
    kinematics = ini.get("KINS", {}).get("KINEMATICS", [""])[0]
    if kinematics.split(maxsplit=1)[:1] != ["genserkins"]:
        problem = f"has the kinematics {kinematics or 'of no name'}, of which rig cannot read the constants"
        raise FileError(
            str(path),
            problem,
            "give the constants in a file with a section robot (rig arms shows one)",
            code="controller.invalid",
        )
    trajectory = ini.get("TRAJ", {})
    if trajectory.get("ANGULAR_UNITS", ["deg"])[0].lower() not in _DEGREES:
        raise FileError(
            str(path),
            "ANGULAR_UNITS is not deg, but genserkins computes in degrees",
            "correct [TRAJ]",
            code="controller.invalid",
        )
    unit = _UNITS.get(trajectory.get("LINEAR_UNITS", [""])[0].lower())
    if unit is None:
        raise FileError(str(path), "LINEAR_UNITS of [TRAJ] is neither mm nor inch", "add it", code="controller.invalid")
    pins = _pins(path, ini.get("HAL", {}))
    axes = tuple(
        _axis(str(path), joint, ini.get(f"JOINT_{joint}", {}), link_of(pins, unit, joint))
        for joint in range(DRIVEN_AXES)
    )
    source = ConstantsSource(file=path.name[:_LONGEST_NAME], constants=constants_hash(axes), pins=pins)
    name = ini.get("EMC", {}).get("MACHINE", [path.stem])[0]
    return Robot(name=name, axes=axes, controller="constants", controller_source=source, linear_units=unit)


def narrow_limits(path: Path) -> list[str]:
    """Cartesian axes whose limits of LinuxCNC stop programs in the reach of the arm, as `[AXIS_C] ±360`."""
    text = read_text(path, _MAX_BYTES)
    ini, robot = _sections(text), configured_robot(path)
    assert robot.linear_units  # noqa: S101 - of a configuration
    reach = sum(abs(axis.a_mm) + abs(axis.d_mm) for axis in robot.axes) / MM_PER_UNIT[robot.linear_units]
    narrow = []
    for letter in "XYZABC":
        section, needed = ini.get(f"AXIS_{letter}", {}), reach if letter in "XYZ" else WIDEST_TURN_DEG
        low, high = (_number(section.get(key, ["0"])[0]) for key in ("MIN_LIMIT", "MAX_LIMIT"))
        if section and not (low <= -needed and high >= needed):
            narrow.append(f"[AXIS_{letter}] {low:g} to {high:g}, needed -{needed:.0f} to {needed:.0f}")
    return narrow


def _number(text: str) -> float:
    try:
        return float(text.split(maxsplit=1)[0])
    except (ValueError, IndexError):
        return math.nan


def _sections(text: str) -> dict[str, dict[str, list[str]]]:
    sections: dict[str, dict[str, list[str]]] = {}
    section: dict[str, list[str]] = {}
    for line in map(str.strip, text.splitlines()):
        if named := _SECTION.match(line):
            section = sections.setdefault(named[1], {})
        elif "=" in line and line[0] not in "#;":
            key, _, value = line.partition("=")
            section.setdefault(key.strip(), []).append(value.strip())
    return sections


def link_of(pins: GenserkinsPins, unit: LengthUnit, joint: int) -> dict[str, float]:
    """Constants of a link in mm and degrees from the pins of a machine."""
    mm = MM_PER_UNIT[unit]
    constants = {"a_mm": mm * pins.A[joint], "alpha_deg": math.degrees(pins.ALPHA[joint]), "d_mm": mm * pins.D[joint]}
    return {key: round(value, 7) for key, value in constants.items()}


def _pins(path: Path, hal: Mapping[str, list[str]]) -> GenserkinsPins:
    names = [value.split()[0] for value in hal.get("HALFILE", []) if not value.startswith("LIB:")]
    texts = [read_text(path.parent / name, _MAX_BYTES) for name in names if (path.parent / name).is_file()]
    text = "\n".join([*texts, *hal.get("HALCMD", [])])
    if _UNROTATE.search(text):
        problem = "the HAL files set genserkins.unrotate, a coupling that rig does not read"
        raise FileError(str(path), problem, "write the coupling into the rig file by hand", code="controller.invalid")
    read: dict[tuple[str, int], float] = {}
    for pin, joint, value in _PIN.findall(text):
        try:
            read[pin, int(joint)] = float(value)
        except ValueError:
            raise FileError(
                str(path), f"genserkins.{pin}-{joint} is {value}", "write it as a number", code="controller.invalid"
            ) from None
    missing = [f"{pin}-{joint}" for joint in range(DRIVEN_AXES) for pin in PINS if (pin, joint) not in read]
    if missing:
        problem = f"no HAL file sets genserkins.{missing[0]}, and {len(missing) - 1} other pins" if missing[1:] else ""
        problem = problem or f"no HAL file sets genserkins.{missing[0]}"
        raise FileError(
            str(path), problem, "set every pin: the defaults are those of a Puma", code="controller.invalid"
        )
    return GenserkinsPins.model_validate({pin: [read[pin, joint] for joint in range(DRIVEN_AXES)] for pin in PINS})


def _axis(where: str, joint: int, section: Mapping[str, list[str]], constants: Mapping[str, float]) -> JointAxis:
    try:
        low, high, speed = (float(section[key][0].split()[0]) for key in ("MIN_LIMIT", "MAX_LIMIT", "MAX_VELOCITY"))
    except (KeyError, ValueError):
        problem = f"[JOINT_{joint}] lacks MIN_LIMIT, MAX_LIMIT or MAX_VELOCITY as a number"
        raise FileError(where, problem, "add it", code="controller.invalid") from None
    return JointAxis(name=f"J{joint}", limits_deg=(low, high), speed_deg_s=speed, **constants)

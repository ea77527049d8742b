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
from rigs.schema.robot import JointAxis, Robot
from rigs.schema.vocabulary import DRIVEN_AXES

_MAX_BYTES = 1_000_000
_SECTION = re.compile(r"\[(\w+)\]")
_PIN = re.compile(r"^(?:\s*setp\s+)genserkins\.(A|ALPHA|D)-(\d)\s+(\S+)", re.MULTILINE)
_UNROTATE = re.compile(r"^\s*setp\s+genserkins\.unrotate-\d\s+(?!0\b)", re.MULTILINE)
_UNITS = {"mm": "mm", "metric": "mm", "in": "inch", "inch": "inch", "imperial": "inch"}
_DEGREES = ("deg", "degree", "degrees")
_PINS = {"A": "a_mm", "ALPHA": "alpha_deg", "D": "d_mm"}


def configured_robot(path: Path) -> Robot:
    ini = _sections(read_text(path, _MAX_BYTES))
    kinematics = ini.get("KINS", {}).get("KINEMATICS", [""])[0]
    if kinematics.split(maxsplit=1)[:1] != ["genserkins"]:
        problem = f"has the kinematics {kinematics or 'of no name'}, of which rig cannot read the constants"
        raise FileError(
            str(path),
            problem,
            "give the constants in a file with a section robot (rig arms shows one)",
            code="linuxcnc.kinematics",
        )
    trajectory = ini.get("TRAJ", {})
    if trajectory.get("ANGULAR_UNITS", ["deg"])[0].lower() not in _DEGREES:
        raise FileError(
            str(path),
            "ANGULAR_UNITS is not deg, but genserkins computes in degrees",
            "correct [TRAJ]",
            code="linuxcnc.unit",
        )
    unit = _UNITS.get(trajectory.get("LINEAR_UNITS", [""])[0].lower())
    if unit is None:
        raise FileError(str(path), "LINEAR_UNITS of [TRAJ] is neither mm nor inch", "add it", code="linuxcnc.unit")
    pins = _pins(path, ini.get("HAL", {}), MM_PER_UNIT["inch" if unit == "inch" else "mm"])
    axes = [_axis(str(path), joint, ini.get(f"JOINT_{joint}", {}), pins[joint]) for joint in range(DRIVEN_AXES)]
    return Robot(name=ini.get("EMC", {}).get("MACHINE", [path.stem])[0], axes=tuple(axes), controller="constants")


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


def _pins(path: Path, hal: Mapping[str, list[str]], mm: float) -> list[dict[str, float]]:
    names = [value.split()[0] for value in hal.get("HALFILE", []) if not value.startswith("LIB:")]
    texts = [read_text(path.parent / name, _MAX_BYTES) for name in names if (path.parent / name).is_file()]
    text = "\n".join([*texts, *hal.get("HALCMD", [])])
    if _UNROTATE.search(text):
        problem = "the HAL files set genserkins.unrotate, a coupling that rig does not read"
        raise FileError(str(path), problem, "write the coupling into the rig file by hand", code="linuxcnc.coupling")
    read: dict[tuple[str, int], float] = {}
    for pin, joint, value in _PIN.findall(text):
        try:
            read[pin, int(joint)] = float(value)
        except ValueError:
            raise FileError(
                str(path), f"genserkins.{pin}-{joint} is {value}", "write it as a number", code="linuxcnc.pin"
            ) from None
    missing = [f"{pin}-{joint}" for joint in range(DRIVEN_AXES) for pin in _PINS if (pin, joint) not in read]
    if missing:
        problem = f"no HAL file sets genserkins.{missing[0]}, and {len(missing) - 1} other pins" if missing[1:] else ""
        problem = problem or f"no HAL file sets genserkins.{missing[0]}"
        raise FileError(str(path), problem, "set every pin: the defaults are those of a Puma", code="linuxcnc.pin")
    factors = {"A": mm, "ALPHA": math.degrees(1), "D": mm}
    return [
        {key: round(read[pin, joint] * factors[pin], 7) for pin, key in _PINS.items()} for joint in range(DRIVEN_AXES)
    ]


def _axis(where: str, joint: int, section: Mapping[str, list[str]], constants: Mapping[str, float]) -> JointAxis:
    try:
        low, high, speed = (float(section[key][0].split()[0]) for key in ("MIN_LIMIT", "MAX_LIMIT", "MAX_VELOCITY"))
    except (KeyError, ValueError):
        problem = f"[JOINT_{joint}] lacks MIN_LIMIT, MAX_LIMIT or MAX_VELOCITY as a number"
        raise FileError(where, problem, "add it", code="linuxcnc.key") from None
    return JointAxis(name=f"J{joint}", limits_deg=(low, high), speed_deg_s=speed, **constants)

"""Values that were entered at a controller since points were taught, from the files that rig writes for controllers.

These are corrections.yaml, dh.csv, rig-arm.hal and home-offsets.ini, and the JSON of `rig moved`, which states the zero
of an axis that moved without an entry.
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis.apps.makers import Controller, maker_by
from analysis.correction.point_origins import ReadingChange
from analysis.robot.kinematics.arm import arm_of, controller_robot, reported_angles
from rigs.effects import Effect, changed, turned
from rigs.errors import FileError, RigError
from rigs.files import read_bytes
from rigs.rig import Rig
from rigs.schema.probe import MM_PER_UNIT
from rigs.schema.vocabulary import DRIVEN_AXES
from rigs.yaml_text import read_yaml

MOST_BYTES = 10_000_000
_PIN = re.compile(r"^\s*setp\s+genserkins\.(A|ALPHA|D)-(\d)\s+([-+.\deE]+)", re.MULTILINE)
_PINS = {"A": "a_mm", "ALPHA": "alpha_deg", "D": "d_mm"}
_SECTION = re.compile(r"\[JOINT_(\d)\][^\[]*?HOME_OFFSET\s*=\s*([-+.\deE]+)\s*\+ the present value")
_CONSTANTS = ("a_mm", "alpha_deg", "beta_deg", "d_mm")
_ZERO = "add_deg"
_LEAST = 1e-9
"""Smallest change in mm or degrees: the tables have nine decimals."""
_FORMS = (
    "corrections.yaml, dh.csv, rig-arm.hal or home-offsets.ini of rig correct, the JSON of rig moved, or a rig file"
)


def values_in(rig: Rig, path: Path) -> ReadingChange:
    """Read the values of a file, which were or will be entered at the controller of a rig.

    Raises FileError for other contents, and for a file without values or of another rig.
    """
    try:
        text = read_bytes(path, MOST_BYTES).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        problem = getattr(error, "strerror", None) or "is not UTF-8 text"
        raise FileError(str(path), problem, f"give {_FORMS}", code="file.unreadable") from None
    suffix = path.suffix.lower()
    if suffix == ".csv":
        change = _of_constants(rig, path.name, _table(path, text))
    elif suffix in (".hal", ".ini"):
        change = _of_linuxcnc(rig, path, text)
    else:
        change = _of_data(rig, path, text)
    if not any(change.readings_deg) and not change.constants:
        problem, remedy = "contains no value for a controller", f"give {_FORMS}"
        raise FileError(str(path), problem, remedy, code="controller.invalid")
    return change


def _of_data(rig: Rig, path: Path, text: str) -> ReadingChange:
    try:
        data = json.loads(text) if path.suffix.lower() == ".json" else read_yaml(text, str(path))[1]
        if isinstance(data, Mapping) and "causes" in data:
            return _of_movement(rig, path, data)
        if not isinstance(data, Mapping) or not data.keys() & {"controller", "joint_zeros", "link_constants"}:
            raise ValueError("has no values of a controller")
        if (of_rig := data.get("rig")) not in (None, rig.name):
            problem = f"is of the rig {of_rig}, and the program is to be converted for {rig.name}"
            raise FileError(str(path), problem, "give the values of this robot", code="controller.invalid")
        controller = data.get("controller")
        return _of_entries(rig, path.name, controller) if controller else _of_corrections(rig, path.name, data)
    except RigError:
        raise
    except (ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        problem = str(error) if isinstance(error, ValueError) else f"has unexpected contents ({error!r})"
        raise FileError(str(path), problem, f"give {_FORMS}", code="controller.invalid") from None


def _of_entries(rig: Rig, source: str, data: Mapping[str, Any]) -> ReadingChange:
    """Change by the entries of a controller in corrections.yaml."""
    controller, effects, lines = maker_by(data["name"]).controller, list[Effect](), []
    for entry in data["entries"]:
        if effect := _effect(rig, controller, entry):
            effects.append(effect)
        lines.append(f"{entry['parameter']} {entry['add']:+g} {entry['unit']}")
    readings = tuple(map(float, data["readings_deg"])) if data["entries"] else (0.0,) * DRIVEN_AXES
    return _change(source, readings, effects, lines)


def _effect(rig: Rig, controller: Controller, entry: Mapping[str, Any]) -> Effect | None:
    """Change of the constants by an entry; None for a zero that changes the reading instead."""
    axis, add = int(entry["axis"]), float(entry["add"])
    for parameter in controller.constants:
        if axis in parameter.axes and parameter.of(axis) == entry["parameter"]:
            nominal = float(getattr(controller_robot(rig.robot).axes[axis - 1], parameter.key))
            sign = math.copysign(1.0, nominal) if parameter.by_size else 1.0
            return changed(axis, parameter.key, add / (sign * parameter.per_unit))
    if controller.changes_reading:
        return None
    if entry["parameter"] != controller.zero_of(axis):
        raise ValueError(f"has the unknown parameter {entry['parameter']}")
    return turned(axis, add / controller.per_deg)


def _of_corrections(rig: Rig, source: str, data: Mapping[str, Any]) -> ReadingChange:
    """Change by mastering and constants, without the notation of a controller."""
    zeros = {int(zero["axis"]): float(zero[_ZERO]) for zero in data.get("joint_zeros") or ()}
    effects, lines = list[Effect](), [f"axis {axis} mastered by {deg:+g}°" for axis, deg in zeros.items()]
    for constant in data.get("link_constants") or ():
        delta = float(constant["corrected"]) - float(constant["nominal"])
        effects.append(changed(int(constant["axis"]), str(constant["key"]), delta))
        lines.append(f"{constant['key']} of axis {constant['axis']} {delta:+g}")
    return _change(source, _readings(rig, zeros), effects, lines)


def _readings(rig: Rig, zeros_deg: Mapping[int, float]) -> tuple[float, ...]:
    """Changes (6,) of the readings by zeros of the drives, which coupled axes share."""
    drives = np.zeros(DRIVEN_AXES)
    for axis, deg in zeros_deg.items():
        if not 1 <= axis <= DRIVEN_AXES:
            raise ValueError(f"names axis {axis} of an arm with {DRIVEN_AXES} axes")
        drives[axis - 1] += deg
    return tuple(reported_angles(arm_of(rig.robot), drives).tolist())


def _table(path: Path, text: str) -> dict[tuple[int, str], float]:
    try:
        rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
        return {(int(row["axis"]), key): float(row[key]) for row in rows for key in (*_CONSTANTS, "offset_deg")}
    except (KeyError, ValueError, TypeError):
        problem = "is not a table of constants with axis, a_mm, alpha_deg, beta_deg, d_mm and offset_deg"
        raise FileError(str(path), problem, f"give {_FORMS}", code="controller.invalid") from None


def _of_constants(rig: Rig, source: str, new: Mapping[tuple[int, str], float]) -> ReadingChange:
    """Change from the present constants of the controller to new ones."""
    effects, lines = list[Effect](), []
    for (axis, key), value in new.items():
        if not 1 <= axis <= len(rig.robot.axes):
            continue
        delta = value - float(getattr(controller_robot(rig.robot).axes[axis - 1], key))
        if abs(delta) < _LEAST:
            continue
        if key == "offset_deg":
            problem = f"changes the offset of axis {axis}, which is a joint zero"
            raise FileError(source, problem, "state it as joint_zeros in a corrections.yaml", code="controller.invalid")
        effects.append(changed(axis, key, delta))
        lines.append(f"{key} of axis {axis} {delta:+g}")
    return _change(source, (0.0,) * DRIVEN_AXES, effects, lines)


def _of_linuxcnc(rig: Rig, path: Path, text: str) -> ReadingChange:
    """Pins of genserkins and home offsets, as rig writes them: both files belong together."""
    beside = {".hal": "home-offsets.ini", ".ini": "rig-arm.hal"}[path.suffix.lower()]
    if (other := path.with_name(beside)).is_file():
        text += "\n" + other.read_text(encoding="utf-8")
    if (unit := rig.length_unit) is None:
        remedy = "add linear_units: mm or inch to robot, as LINEAR_UNITS of [TRAJ] says"
        raise FileError(
            str(path), "has lengths in a unit that the rig file does not state", remedy, code="rig_file.invalid"
        )
    pins: dict[tuple[int, str], float] = {}
    for name, number, value in _PIN.findall(text):
        factor = math.degrees(1) if name == "ALPHA" else MM_PER_UNIT[unit]
        pins[int(number) + 1, _PINS[name]] = float(value) * factor
    constants = _of_constants(rig, path.name, pins)
    zeros = {int(joint) + 1: float(deg) for joint, deg in _SECTION.findall(text)}
    lines = [*constants.lines, *(f"HOME_OFFSET of joint {axis - 1} {deg:+g}°" for axis, deg in zeros.items())]
    return _change(path.name, _readings(rig, zeros), constants.constants, lines)


def _of_movement(rig: Rig, path: Path, data: Mapping[str, Any]) -> ReadingChange:
    """Change by zeros that moved: the arm turned under an unchanged reading, so the old posture has another reading."""
    named = data.get("named")
    members = (named.get("together") or [named]) if named else []
    others = [member["what"] for member in members if member["what"] != "zero"]
    if not members or others:
        what = "names no cause" if not members else f"names {' and '.join(others)} as moved"
        remedy = "touch up the frame or the tool instead; only a moved zero changes the numbers of points"
        raise FileError(str(path), what, remedy, code="controller.invalid")
    u = [0.0] * DRIVEN_AXES
    for member in members:
        u[member["axis"] - 1] = float(member["u"])
    zeros = {member["axis"]: -float(member["size_deg"]) for member in members}
    lines = [f"zero of axis {axis} moved by {-deg:+g}°" for axis, deg in zeros.items()]
    return _change(path.name, _readings(rig, zeros), (), lines, tuple(u))


def _change(
    source: str,
    readings_deg: tuple[float, ...],
    constants: Sequence[Effect],
    lines: Sequence[str],
    u_deg: tuple[float, ...] = (0.0,) * DRIVEN_AXES,
) -> ReadingChange:
    if len(readings_deg) != DRIVEN_AXES or not np.isfinite([*readings_deg, *u_deg]).all():
        raise ValueError(f"does not have {DRIVEN_AXES} finite changes of readings")
    return ReadingChange(source, readings_deg, tuple(constants), u_deg, tuple(lines))

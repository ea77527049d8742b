"""Files with the values of a correction: a HAL file that sets the pins of genserkins, and HOME_OFFSET for the INI file.

A pin is set to the controller's constant in the rig file plus the change, so the rig file has to contain the present
pins, and no constant that genserkins lacks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from rigs.errors import FileError, RigPlace
from rigs.schema.probe import MM_PER_UNIT
from rigs.schema.robot import identity
from rigs.schema.vocabulary import DRIVEN_AXES

if TYPE_CHECKING:
    from rigs.rig import Rig

_PINS = {"a_mm": "A", "alpha_deg": "ALPHA", "d_mm": "D"}


def value_files(rig: Rig, added: Mapping[tuple[int, str], float]) -> dict[str, str]:
    """Files rig-arm.hal and home-offsets.ini, or a text with the reason why genserkins cannot describe the arm."""
    if reason := next(_beyond_genserkins(rig), ""):
        remedy = "describe the arm by its pins (rig init --arm FILE.ini), or correct programs with --program"
        return {"no-rig-arm.txt": f"There is no rig-arm.hal: {reason}; {remedy}.\n"}
    unit = rig.length_unit
    if unit is None:
        remedy = "add linear_units: mm or inch to robot, as LINEAR_UNITS of [TRAJ] says, or give --calibration FILE.ini"
        problem = "does not state the unit of the machine's lengths, so rig-arm.hal could be 25.4 times too large"
        raise FileError(RigPlace.of(rig.name, "robot"), problem, remedy, code="controller.invalid")
    pins = [f"# genserkins of {rig.robot.name}, changed by rig correct. Lengths in {unit} (LINEAR_UNITS of [TRAJ])."]
    for key, pin in _PINS.items():
        factor = math.radians(1) if key == "alpha_deg" else 1.0
        per_pin = 1.0 if key == "alpha_deg" else 1 / MM_PER_UNIT[unit]
        for number, axis in enumerate(rig.robot.controller_axes or rig.robot.axes, start=1):
            present, change = getattr(axis, key) * factor, added.get((number, key), 0.0)
            _check_near(rig, pin, number - 1, (present + change) * per_pin, change * per_pin)
            before = f"  # before: {present * per_pin:.12g}" if change else ""
            pins.append(f"setp genserkins.{pin}-{number - 1} {(present + change) * per_pin:.12g}{before}")
    offsets = ["# Add these degrees to HOME_OFFSET of each section."]
    for number in range(1, DRIVEN_AXES + 1):
        if change := added.get((number, "q_deg"), 0.0):
            offsets += [f"[JOINT_{number - 1}]", f"# HOME_OFFSET = {change:+z.6f} + the present value"]
    return {"rig-arm.hal": "\n".join([*pins, ""]), "home-offsets.ini": "\n".join([*offsets, ""])}


def _check_near(rig: Rig, pin: str, joint: int, value: float, change: float) -> None:
    """Refuse a value that differs from the pin that was read by more than the change. Raises FileError."""
    source = rig.robot.controller_source
    if source is None or source.pins is None:
        return
    was = getattr(source.pins, pin)[joint]
    if not math.isclose(value - change, was, rel_tol=1e-6, abs_tol=1e-6):
        problem = f"gives {value:.6g} for genserkins.{pin}-{joint}, in {source.file} {was:.6g}: unit or arm differ"
        remedy = f"read the present pins with --calibration {source.file}, or correct linear_units"
        raise FileError(RigPlace.of(rig.name, "robot"), problem, remedy, code="controller.invalid")


def _beyond_genserkins(rig: Rig) -> Iterator[str]:
    """Properties of an arm that the pins cannot express."""
    for number, axis in enumerate(rig.robot.axes, start=1):
        for key in ("offset_deg", "beta_deg"):
            if value := getattr(axis, key):
                yield f"axis {number} has {key} {value:g}, for which genserkins has no pin"
    if rig.robot.coupling != identity(DRIVEN_AXES):
        yield "the rig file has reversed or coupled axes, which these pins cannot express"

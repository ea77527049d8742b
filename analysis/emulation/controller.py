"""The emulated controller of one maker: its model of the arm, and the parameters that a person can enter.

A controller reads each joint by a zero of its own, and computes poses by constants of its own. Both begin as the rig
file has them; entered corrections change them, so that the same program leads elsewhere. Names and units are those of
the makers, and each maker's driver says how a reading follows from them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.kinematics.arm import Arm, Array, arm_of, forward
from analysis.makers import maker_by
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import MakerName

_SAME_SIZE = 1e-3
"""A length that stands at the controller is the one that is meant within so many mm: it is written with six digits."""


@dataclass(frozen=True)
class Controller:
    """A controller as it stands: arm, as it computes poses; reads_more (6,) rad: by how much each joint reads more than
    the joint of the arm that left the factory did at the same place."""

    maker: MakerName
    arm: Arm
    reads_more: Array

    @classmethod
    def of_rig(cls, rig: Rig, maker: MakerName) -> Controller:
        """Return the controller of a rig's arm with nothing entered: it knows none of the effects."""
        return cls(maker, arm_of(rig.robot), np.zeros(6))

    def flange(self, q: Array) -> tuple[Array, Array]:
        """Return rotation (3, 3) and place (3,) mm of the flange in the robot's base, at joint angles q (6,) rad."""
        T = forward(self.with_tool(np.eye(4)), q[None])[0]
        return T[:3, :3], T[:3, 3]

    def with_tool(self, T_flange_tool: Array) -> Arm:
        """Return the arm as the controller computes it, in its own base, with a tool's frame (4, 4) in mm."""
        return replace(self.arm, T_world_base=np.eye(4), T_flange_tool=T_flange_tool)

    def entered(self, corrections: Any, where: str) -> Controller:
        """Return the controller after a person has entered the parameters of `rig correct`'s corrections.yaml or JSON,
        as read from there. Raises FileError for what is none, is for another maker, or names what is not here."""
        section = corrections.get("controller") if isinstance(corrections, Mapping) else None
        entries = section.get("entries") if isinstance(section, Mapping) else None
        if not isinstance(section, Mapping) or not isinstance(entries, Sequence) or isinstance(entries, str):
            problem = "has no entries for a controller"
            raise FileError(where, problem, f"write it with rig correct --for {self.maker}")
        if section.get("name") != self.maker:
            problem = f"is for a controller of {section.get('name')!r}, and this one is of {self.maker!r}"
            raise FileError(where, problem, f"write it with rig correct --for {self.maker}")
        changed = self
        for number, entry in enumerate(entries, start=1):
            changed = changed._with(entry, self, f"{where}, entry {number}")
        return changed

    def _with(self, entry: Any, before: Controller, where: str) -> Controller:
        name, add, unit, now = (entry.get(key) if isinstance(entry, Mapping) else None for key in _KEYS)
        candidates = [
            (candidate, axis)
            for candidate in maker_by(self.maker).driver.parameters
            if (axis := candidate.axis_of(str(name)))
        ]
        if not candidates or candidates[0][1] > 6:
            problem = f"{str(name)!r} is no parameter of a controller of {self.maker!r}"
            raise FileError(where, problem, "give the file as rig correct wrote it")
        parameter, axis = candidates[0]
        number = isinstance(add, int | float) and not isinstance(add, bool) and math.isfinite(add)
        if unit != parameter.unit or not number:
            problem = f"{name} is changed by a number in {parameter.unit}, and not by {add!r} {unit!r}"
            raise FileError(where, problem, "give the file as rig correct wrote it")
        change = parameter.factor * float(add or 0.0)
        if parameter.grows:
            stands = float(getattr(before.arm, parameter.field)[axis - 1])
            if isinstance(now, int | float) and abs(abs(stands) - now) > _SAME_SIZE * max(1.0, abs(now) * _SAME_SIZE):
                problem = f"{name} is {abs(stands):g} mm at this controller, and the file takes it for {now:g} mm"
                raise FileError(
                    where, problem, "leave out what was entered before, or correct again from the nominal arm"
                )
            change *= np.sign(stands)
        changes = np.zeros(6)
        changes[axis - 1] = change
        if parameter.field == "offset":  # of the angle that is read, which some arms count against the frame's
            changes = self.arm.coupling @ changes
        if parameter.field == "reading":
            return replace(self, reads_more=self.reads_more + changes)
        arm = replace(self.arm, **{parameter.field: getattr(self.arm, parameter.field) + changes})
        return replace(self, arm=arm)


_KEYS = ("parameter", "add", "unit", "now")

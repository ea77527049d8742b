"""Arm description in a rig file: modified Denavit–Hartenberg parameters after Craig, in mm and degrees."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from rigs.schema.part import MM_PER_M, Angle, Length, Part, Vector
from rigs.schema.unit_checks import place_not_in_metres, refuse_angles_in_radians, refuse_limits_in_radians
from rigs.schema.vocabulary import DRIVEN_AXES, FEWEST_AXES, MOST_AXES, Build


class Pose(Part):
    """Frame: position, then fixed-axis roll-pitch-yaw (rotations about x, y, z of the parent)."""

    xyz_mm: Vector = (0.0, 0.0, 0.0)
    rpy_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)


class JointAxis(Part):
    """Joint: `T(i-1,i) = RotX(alpha) TransX(a) RotY(beta) RotZ(theta) TransZ(d)`.

    alpha, a and beta belong to the link before the joint (alpha[i-1] and a[i-1] in the notation of Craig). beta is the
    angle of Hayati, for a joint parallel to the previous joint.
    """

    name: str
    a_mm: Length = 0.0
    alpha_deg: Angle = 0.0
    beta_deg: Angle = 0.0
    d_mm: Length = 0.0
    offset_deg: Angle = 0.0
    limits_deg: tuple[Angle, Angle]
    speed_deg_s: float = Field(gt=0, le=1e4)
    mass_kg: float = Field(default=0.0, ge=0, le=1e4)
    """Mass of the link moved by this joint, for gravity effects."""
    centre_mm: Vector = (0.0, 0.0, 0.0)
    """Centre of mass in the frame of the link."""

    @model_validator(mode="after")
    def _ordered(self) -> JointAxis:
        if not self.limits_deg[0] < self.limits_deg[1]:
            raise ValueError(f"limits_deg {list(self.limits_deg)} must be [lower, upper]; swap them")
        return self


class LinkConstants(Part):
    """Constants of one axis in the controller, with the meaning they have in `axes`."""

    a_mm: Length = 0.0
    alpha_deg: Angle = 0.0
    beta_deg: Angle = 0.0
    d_mm: Length = 0.0
    offset_deg: Angle = 0.0


ControllerArm = Literal["data_sheet", "constants", "unknown"]
LengthUnit = Literal["mm", "inch"]
SixNumbers = tuple[float, float, float, float, float, float]


class GenserkinsPins(Part):
    """Pins of genserkins as a configuration of LinuxCNC sets them: lengths in its unit, angles in rad."""

    A: SixNumbers
    ALPHA: SixNumbers
    D: SixNumbers


class ConstantsSource(Part):
    """Origin of the constants of a controller."""

    file: Annotated[str, Field(max_length=200)]
    """Name of the file that held them."""
    serial: Annotated[str, Field(max_length=200)] = ""
    """Serial number or checksum of the robot in that file, if it has one."""
    constants: Annotated[str, Field(pattern=r"[0-9a-f]{16}")]
    """Hash of the constants, which tells whether another file holds those of the same robot."""
    pins: GenserkinsPins | None = None
    """Pins of LinuxCNC as they were read. Values to enter must stay near them."""


class Rail(Part):
    """Rail of the arm. At position e1_mm, the base is displaced from `base` by this distance along the rail."""

    direction: Vector = (1.0, 0.0, 0.0)
    """Direction of motion in the base frame. The length of the vector is ignored."""
    limits_mm: tuple[Length, Length]

    @model_validator(mode="after")
    def _leads_somewhere(self) -> Rail:
        if math.hypot(*self.direction) < 1e-9:
            raise ValueError("direction needs a length above zero")
        if not self.limits_mm[0] < self.limits_mm[1]:
            raise ValueError(f"limits_mm {list(self.limits_mm)} must be [lower, upper]; swap them")
        return self


Share = Annotated[float, Field(ge=-1e3, le=1e3)]
Row = tuple[Share, ...]
Posture = tuple[Angle, Angle, Angle, Angle, Angle, Angle]


def identity(count: int) -> tuple[Row, ...]:
    return tuple(tuple(float(row == column) for column in range(count)) for row in range(count))


def constants_hash(axes: Iterable[LinkConstants | JointAxis]) -> str:
    """Hash of the constants of a controller, rounded to a nanometre."""
    rows = [[round(getattr(axis, key), 6) + 0.0 for key in LinkConstants.model_fields] for axis in axes]
    return hashlib.sha256(json.dumps(rows).encode()).hexdigest()[:16]


_NUMBERED = re.compile(r"(a|j|axis|joint)?[ _.-]?a?\d")
"""Names that contain only a number: `J4`, `joint_4`, `joint_a4`, `4`."""


_SHORTEST_MM = 20.0
"""Minimum sum of the lengths of an arm.

Hobby arms have some 300 mm. The longest industrial arms have 6 m, which is 6 if written in metres.
"""


class Robot(Part):
    """Arm with four to seven revolute axes.

    `theta = coupling @ q + offset`, with q reported by the controller. The drives turn the axes mechanically:
    `theta = drives @ m + offset`, with the angle m of each drive at the output of its gear.
    """

    name: str
    serial: Annotated[str, Field(max_length=200)] = ""
    """Serial number on the name plate, shown at the top of reports."""
    axes: Annotated[tuple[JointAxis, ...], Field(min_length=FEWEST_AXES, max_length=MOST_AXES)]
    coupling: Annotated[tuple[Row, ...], Field(min_length=FEWEST_AXES, max_length=MOST_AXES)] = identity(DRIVEN_AXES)
    arm: Annotated[str, Field(max_length=100)] = Field(default="", exclude_if=lambda value: not value)
    """Name of the arm in the library (`rig arms`), for a comparison with its data sheet."""
    controller: ControllerArm | None = Field(default=None, exclude_if=lambda value: value is None)
    """Arm with which the controller computes poses: of the data sheet, with `constants` of this robot, or unknown.

    With `constants`, `axes` holds them, unless `controller_axes` does. Omitted: as the maker usually does, which is
    unknown if the maker measures each robot or offers it.
    """
    controller_axes: tuple[LinkConstants, ...] = Field(default=(), exclude_if=lambda value: not value)
    """Constants of the controller, if the effects of this file were determined relative to the other ones in `axes`."""
    controller_source: ConstantsSource | None = Field(default=None, exclude_if=lambda value: value is None)
    """File from which rig read the constants of the controller."""
    linear_units: LengthUnit | None = Field(default=None, exclude_if=lambda value: value is None)
    """Unit of the lengths in the controller: LINEAR_UNITS in the section TRAJ of the INI file of LinuxCNC.

    The lengths of this file are in mm. Required for values to enter at LinuxCNC.
    """
    drives: Annotated[tuple[Row, ...], Field(min_length=FEWEST_AXES, max_length=MOST_AXES)] | None = Field(
        default=None, exclude_if=lambda value: value is None
    )
    """Mechanics of the arm, required for a linkage: the axes that each drive turns.

    By default each drive turns only the axis of its number, and a coupling of several axes exists only in the numbers
    of the controller.
    """
    base: Pose = Pose()
    rail: Rail | None = None
    tool: Pose = Pose()
    payload_kg: float = Field(default=0.0, ge=0, le=1e4)
    """Tool and ball link, at the flange."""
    posture_deg: tuple[Angle, ...] | None = Field(default=None, exclude_if=lambda value: value is None)
    """Joint angles at one of the user's targets. Poses in tables are reached in this configuration: the same sides of
    shoulder, elbow and wrist. By default the posture of a pose is unknown.
    """
    build: Build | None = Field(default=None, exclude_if=lambda value: value is None)
    """Design of the arm.

    By default an arm of seven axes has torque sensors, and an arm of four or five axes is light.
    """

    @field_validator("tool")
    @classmethod
    def _tool_in_mm(cls, tool: Pose) -> Pose:
        place_not_in_metres(tool.xyz_mm)
        return tool

    @field_validator("tool", "base")
    @classmethod
    def _turned_in_degrees(cls, pose: Pose) -> Pose:
        refuse_angles_in_radians("rpy_deg", pose.rpy_deg)
        return pose

    @model_validator(mode="after")
    def _has_controller_constants(self) -> Robot:
        if self.controller_axes and self.controller != "constants":
            raise ValueError("controller_axes requires `controller: constants`; correct controller, or remove the rows")
        if self.controller_axes and len(self.controller_axes) != len(self.axes):
            raise ValueError(f"controller_axes must have {len(self.axes)} rows, one for each axis; correct the rows")
        return self

    @model_validator(mode="after")
    def _has_posture(self) -> Robot:
        if self.posture_deg is not None and len(self.posture_deg) != len(self.axes):
            raise ValueError(f"posture_deg must have {len(self.axes)} angles, one for each axis; correct the angles")
        return self

    @model_validator(mode="after")
    def _in_mm(self) -> Robot:
        if 0 < self.reach_mm < _SHORTEST_MM:
            raise ValueError(
                f"the sum of a_mm and d_mm over all axes is {self.reach_mm:.4g} mm, which is too small for an "
                f"arm; if the values are in metres, multiply them by {MM_PER_M}"
            )
        return self

    @model_validator(mode="after")
    def _in_degrees(self) -> Robot:
        for key in ("alpha_deg", "offset_deg"):
            refuse_angles_in_radians(key, [getattr(axis, key) for axis in self.axes])
        refuse_limits_in_radians([axis.limits_deg for axis in self.axes])
        return self

    @property
    def reach_mm(self) -> float:
        """Upper bound of the reach: the sum of all lengths."""
        return sum(abs(axis.a_mm) + abs(axis.d_mm) for axis in self.axes)

    @property
    def read_as_classic(self) -> Robot:
        """This arm if its constants were classic ones of Denavit and Hartenberg, without the link after the last axis.

        Classic constants a and alpha follow their joint; those of Craig precede it.
        """
        before = [(0.0, 0.0), *((axis.a_mm, axis.alpha_deg) for axis in self.axes[:-1])]
        rows = zip(self.axes, before, strict=True)
        axes = tuple(axis.model_copy(update={"a_mm": a, "alpha_deg": alpha}) for axis, (a, alpha) in rows)
        return self.model_copy(update={"axes": axes})

    def short_lengths(self) -> Iterator[tuple[int, str, float]]:
        """Yield axis, key and value of each length that would be plausible in metres but is below 1 mm."""
        for number, axis in enumerate(self.axes, 1):
            for key, value in (("a_mm", axis.a_mm), ("d_mm", axis.d_mm)):
                if _SHORTEST_MM < MM_PER_M * abs(value) < MM_PER_M:
                    yield number, key, value

    @property
    def design(self) -> Build:
        more = len(self.axes) - DRIVEN_AXES
        return self.build or ("torque_sensing" if more > 0 else "light" if more < 0 else "industrial")

    def axis_words(self, axis: int) -> str:
        """Displayed name of an axis, counted from 1: `axis 4 (gamma)`, or `axis 4` for a mere number."""
        name = self.own_name(axis)
        return f"axis {axis} ({name})" if name else f"axis {axis}"

    def own_name(self, axis: int) -> str:
        """Name of an axis, counted from 1; empty if it only repeats the number."""
        name = self.axes[axis - 1].name
        return "" if _NUMBERED.fullmatch(name.lower()) else name

    @property
    def drive_ratios(self) -> tuple[Row, ...]:
        """Mechanics of the arm, as stated in `drives` or by default.

        The default of a coupling without diagonal, which exchanges axes, is the coupling itself.
        """
        if self.drives or not all(row[axis] for axis, row in enumerate(self.coupling)):
            return self.drives or self.coupling
        own = enumerate(self.coupling)
        return tuple(tuple(row[axis] * (axis == k) for k in range(len(row))) for axis, row in own)

    @model_validator(mode="before")
    @classmethod
    def _coupled(cls, written: Any) -> Any:
        if isinstance(written, Mapping) and "coupling" not in written:
            axes = written.get("axes")
            if isinstance(axes, list | tuple) and FEWEST_AXES <= len(axes) <= MOST_AXES:
                return {**written, "coupling": identity(len(axes))}
        return written

    @field_validator("coupling", "drives")
    @classmethod
    def _solvable(cls, rows: tuple[Row, ...] | None, info: ValidationInfo) -> tuple[Row, ...] | None:
        if rows is None:
            return None
        count = len(info.data.get("axes", rows))
        if {len(rows), *map(len, rows)} != {count}:
            key, size = info.field_name, len(rows)
            if {*map(len, rows)} == {size}:
                missing = "axis to axes" if count < size else f"rows to {key}"
                raise ValueError(
                    f"axes lists {count} axes, but {key} has {size} rows of {size} numbers; add the missing {missing}, "
                    "or remove the row and the column that do not belong to the arm"
                )
            raise ValueError(f"{key} must have {count} rows of {count} numbers, one for each axis; correct the rows")
        remaining = [list(row) for row in rows]
        for column in range(count):  # elimination with the largest pivot first
            remaining[column:] = sorted(remaining[column:], key=lambda row: -abs(row[column]))
            pivot, *below = remaining[column:]
            if abs(pivot[column]) < 1e-6:
                raise ValueError(f"{info.field_name} is singular: some motion moves no axis; correct the rows")
            remaining[column + 1 :] = [
                [x - row[column] / pivot[column] * y for x, y in zip(row, pivot, strict=True)] for row in below
            ]
        return rows

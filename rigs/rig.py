"""The rig: complete description of a cell, including automatic actions of the daemon.

The object represents a YAML file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated

from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from rigs.calibration import CalibratedModel, CalibrationFile
from rigs.effects import AnyEffect
from rigs.errors import FileError
from rigs.families import link_sizes
from rigs.makers import MAKERS, maker_named, maker_of
from rigs.schema.controllers import practice_of
from rigs.schema.declared_tests import Automatic, KnownSocketDistance, Retention, Tests
from rigs.schema.effect import name_of
from rigs.schema.feedback import Feedback, LinuxCNC, NoFeedback, carries_signal
from rigs.schema.gauges import NO_GAUGES, Gauges
from rigs.schema.limits import Limits
from rigs.schema.part import Part
from rigs.schema.probe import Ball, BallLink, Temperature
from rigs.schema.reference import Reference
from rigs.schema.robot import ControllerArm, LengthUnit, Pose, Robot
from rigs.schema.unit_checks import refuse_centre_in_metres
from rigs.schema.vocabulary import DRIVEN_AXES, MOST_AXES, MakerName

_LINK_OFF_MM = 10.0
"""Largest difference between link and circle radius.

A link is adjusted within the range of a gauge; a larger difference means a different link.
"""


class Rig(Part):
    """Description of a cell before any measurement."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,62}$")]
    """Name of the rig: lower case, digits, - and _; used for the socket, the service and the runs."""
    description: str = ""
    robot: Robot
    gauges: Gauges = Field(default_factory=lambda: NO_GAUGES)
    """Gauges of rigd and the link tests; not needed in cells with only a tracker."""
    feedback: Feedback = Field(default_factory=NoFeedback)  # type: ignore[assignment]
    """Source of the joint angles: with gauges, on its own for touches, or none."""
    ball: Ball | None = None
    link: BallLink | None = None
    temperature: Temperature | None = None
    tests: Tests = Tests()
    effects: tuple[AnyEffect, ...] = ()
    calibration: CalibrationFile | None = None
    """Calibrated model in addition to the effects, in a file next to the rig file."""
    limits: Limits = Limits()
    automatic: Automatic | None = None
    retention: Retention | None = None
    emulated: bool = False
    """Set by `rig emulate`: runs of this cell involve no real robot. Every page and screen states this."""
    replay: str = ""
    """File of timing deviations written by `rig replay`, for a replayed cell."""

    _calibrated: CalibratedModel | None = PrivateAttr(None)

    @property
    def calibrated(self) -> CalibratedModel | None:
        if self.calibration and self._calibrated is None:
            raise FileError(
                self.name,
                f"names the calibration {self.calibration.file}, which is missing in the directory of this rig file",
                "put rig file and calibration into the same directory, and give the rig file with --rig",
                code="calibration.missing",
            )
        return self._calibrated

    @property
    def maker(self) -> MakerName | None:
        """Maker of the controller according to the feedback; for general interfaces according to the name of the robot.

        None if unknown.
        """
        return maker_of(self.feedback.interface) or maker_named(self.robot.name)

    @property
    def makers(self) -> tuple[MakerName, ...]:
        """Possible makers of the controller: a single one if known, otherwise all."""
        return (self.maker,) if self.maker else MAKERS

    @property
    def controller(self) -> ControllerArm:
        stated = self.robot.controller
        return stated or ("unknown" if practice_of(self.maker or self.robot.name) else "data_sheet")

    @property
    def controller_doubt(self) -> str:
        """Doubt about a stated data sheet of a controller whose maker measures each robot; empty without one."""
        practice = practice_of(self.maker or self.robot.name)
        if self.robot.controller != "data_sheet" or practice is None or practice.own_constants != "always":
            return ""
        if practice.are_entered:
            return ""
        return f"robot.controller is data_sheet, but the maker measures each robot: give {practice.get} (--calibration)"

    @property
    def length_unit(self) -> LengthUnit | None:
        """Unit of the lengths in the controller; None if the rig file does not state it."""
        return self.robot.linear_units or _stated_unit(self.feedback)

    @property
    def is_calibrated(self) -> bool:
        """True if this file holds an earlier calibration of the links of this robot."""
        return self.calibration is not None or any(not effect.WEARS for effect in self.effects)

    @property
    def has_controller_constants(self) -> bool:
        """True if `axes` are the constants of this robot's controller, without an earlier calibration."""
        return self.controller == "constants" and not self.robot.controller_axes and not self.is_calibrated

    @property
    def reference(self) -> Reference:
        """Arms with which this arm is compared: of its family, unless constants of this robot itself are known."""
        of_data_sheet = not (self.is_calibrated or self.has_controller_constants)
        maker = self.maker if of_data_sheet else None
        return Reference(self.robot.design, link_sizes(self.robot.design, maker), of_data_sheet)

    @property
    def takes_programs(self) -> bool:
        return self.robot.rail is None and len(self.robot.axes) == DRIVEN_AXES

    def with_calibration(self, file: CalibrationFile | None, content: CalibratedModel | None) -> Rig:
        rig = self.model_copy(update={"calibration": file})
        rig._calibrated = content
        return rig

    @property
    def nominal(self) -> Rig:
        """The rig without effects and calibration."""
        return self.model_copy(update={"effects": ()}).with_calibration(None, None)

    def calibrated_as(self, rig: Rig) -> Rig:
        """Rig with its calibration content, if another rig has loaded the same calibration."""
        return self.with_calibration(rig.calibration, rig._calibrated) if self.calibration == rig.calibration else self

    @property
    def companion_files(self) -> dict[str, bytes]:
        return {self.calibration.file: self._calibrated.content} if self.calibration and self._calibrated else {}

    def modelled_as(self, rig: Rig) -> Rig:
        return self.model_copy(update={"effects": rig.effects}).with_calibration(rig.calibration, rig._calibrated)

    def with_distances(self, distances: Iterable[KnownSocketDistance]) -> Rig:
        return self.model_copy(update={"tests": self.tests.with_distances(distances)})

    @field_validator("tests")
    @classmethod
    def _of_one_length(cls, tests: Tests, info: ValidationInfo) -> Tests:
        link = info.data.get("link")
        if link and tests.hemisphere and abs(link.length_mm - tests.hemisphere.radius_mm) > _LINK_OFF_MM:
            lengths = (
                f"the link is {link.length_mm:g} mm long and the hemisphere's radius_mm {tests.hemisphere.radius_mm:g}"
            )
            raise ValueError(f"{lengths}; the difference exceeds {_LINK_OFF_MM:g} mm; correct one of them")
        return tests

    @field_validator("tests")
    @classmethod
    def _in_mm(cls, tests: Tests, info: ValidationInfo) -> Tests:
        robot = info.data.get("robot")
        if robot and robot.base == Pose():  # a world with its origin at the ball has small coordinates
            for key in ("circle", "hemisphere"):
                if path := getattr(tests, key):
                    refuse_centre_in_metres(f"{key}.centre_mm", path.centre_mm, robot.reach_mm)
        return tests

    @field_validator("effects")
    @classmethod
    def _of_its_axes(cls, effects: tuple[AnyEffect, ...], info: ValidationInfo) -> tuple[AnyEffect, ...]:
        axes = len(info.data["robot"].axes) if "robot" in info.data else MOST_AXES
        if problem := next(misplaced(effects, axes), None):
            raise ValueError(f"{problem}; correct the axis")
        return effects

    @model_validator(mode="after")
    def _is_driven(self) -> Rig:
        axes = len(self.robot.axes)
        driven = self.tests.circle or self.tests.hemisphere or not isinstance(self.feedback, NoFeedback)
        if axes != DRIVEN_AXES and driven:
            problem = f"an arm of {axes} axes can be measured only with imported poses and touches"
            raise ValueError(f"{problem}: circle, hemisphere, gauges and feedback need six axes; remove them")
        if self.robot.rail and (driven or self.tests.iso9283):
            problem = "an arm on a rail can be measured only with imported poses and touches"
            stands = "circle, hemisphere, iso9283, gauges and feedback need a fixed arm"
            raise ValueError(f"{problem}: {stands}; remove them, or remove the rail if it does not move")
        return self

    @model_validator(mode="after")
    def _of_one_unit(self) -> Rig:
        unit, stated = self.robot.linear_units, _stated_unit(self.feedback)
        if unit and stated and stated != unit:
            problem = f"linear_units is {unit} in robot and {stated} in feedback"
            raise ValueError(f"{problem}; keep that of [TRAJ] in the INI file")
        return self

    @model_validator(mode="after")
    def _read_together(self) -> Rig:
        if dict(self.gauges) and isinstance(self.feedback, NoFeedback):
            problem = "gauges require feedback: rigd always records both"
            raise ValueError(f"{problem}; add feedback, or remove the gauges if only a tracker is used")
        return self

    @field_validator("automatic")
    @classmethod
    def _possible(cls, automatic: Automatic | None, info: ValidationInfo) -> Automatic | None:
        if automatic is None or not {"feedback", "gauges"} <= info.data.keys():  # these contain mistakes themselves
            return automatic
        gauges = len(list(info.data["gauges"]))
        if not gauges or isinstance(info.data["feedback"], NoFeedback):
            raise ValueError("requires gauges and feedback; add both, or remove the key")
        if lacking := automatic.lacking(signal=carries_signal(info.data["feedback"]), gauges=gauges):
            raise ValueError("; ".join(lacking))
        return automatic


def misplaced(effects: Iterable[AnyEffect], axes: int) -> Iterator[str]:
    """Yield a problem for each effect of an axis that the arm does not have."""
    for effect in effects:
        seat = max(getattr(effect, key, 0) for key in ("axis", "from_axis", "to_axis"))
        if seat > axes:
            yield f"{name_of(effect)} refers to axis {seat}, but the robot has {axes}"


def _stated_unit(feedback: Feedback) -> LengthUnit | None:
    """LINEAR_UNITS, if the feedback states it: the default is not a statement."""
    if isinstance(feedback, LinuxCNC) and "linear_units" in feedback.model_fields_set:
        return feedback.linear_units
    return None

"""A rig: all that is known of a cell, and what its daemon does by itself. One YAML file, one object."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from rigs.calibration import CalibratedModel, CalibrationFile
from rigs.effects import AnyEffect
from rigs.errors import FileError
from rigs.schema.declared_tests import Automatic, Retention, Tests
from rigs.schema.effect import name_of
from rigs.schema.feedback import Feedback, NoFeedback, carries_signal
from rigs.schema.gauges import NO_GAUGES, Gauges
from rigs.schema.limits import Limits
from rigs.schema.part import Part
from rigs.schema.probe import Ball, Link, Temperature
from rigs.schema.robot import Robot
from rigs.schema.vocabulary import DRIVEN_AXES, MOST_AXES, MakerName, maker_named, maker_of, makers

_LINK_OFF_MM = 10.0
"""A link is set to the radius within a gauge's range; what is further off is another link."""


class Rig(Part):
    """Everything that is known of a cell before it is measured."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,62}$")]
    """Lower case, digits, - and _: it names the socket, the service and the runs."""
    description: str = ""
    robot: Robot
    gauges: Gauges = Field(default_factory=lambda: NO_GAUGES)
    """What rigd reads and the link's tests measure with; a cell that only a tracker measures needs none."""
    feedback: Feedback = Field(default_factory=NoFeedback)  # type: ignore[assignment]
    """How rigd reads the joints: there with the gauges, or alone for touches, or not at all."""
    ball: Ball | None = None
    link: Link | None = None
    temperature: Temperature | None = None
    tests: Tests = Tests()
    effects: tuple[AnyEffect, ...] = ()
    calibration: CalibrationFile | None = None
    """The calibrated model beside the effects, a file that lies beside the rig file."""
    limits: Limits = Limits()
    automatic: Automatic | None = None
    retention: Retention | None = None
    emulated: bool = False
    """Written by `rig emulate`: runs of this cell measure no robot, and every page and screen says so."""
    replay: str = ""
    """The file in which `rig replay` records what is out of step, for a cell that it serves."""

    _calibrated: CalibratedModel | None = PrivateAttr(None)

    @property
    def calibrated(self) -> CalibratedModel | None:
        """The calibration, None for a rig without one. Raises FileError where its file was not read with the rig's."""
        if self.calibration and self._calibrated is None:
            raise FileError(
                self.name,
                f"names the calibration {self.calibration.file}, which is not beside this rig file",
                "give the rig file beside its calibration with --rig",
            )
        return self._calibrated

    @property
    def maker(self) -> MakerName | None:
        """The maker of the controller as its feedback says, or the robot's name where any maker may speak that; None
        where neither does."""
        return maker_of(self.feedback.interface) or maker_named(self.robot.name)

    @property
    def makers(self) -> tuple[MakerName, ...]:
        """The makers whose controllers it may have, the likeliest first: one where that is known, else all."""
        return (self.maker,) if self.maker else makers()

    @property
    def takes_programs(self) -> bool:
        """Whether programs and values for its controller are known: of six axes, and of no rail."""
        return self.robot.rail is None and len(self.robot.axes) == DRIVEN_AXES

    def with_calibration(self, file: CalibrationFile | None, content: CalibratedModel | None) -> Rig:
        """Return the rig with the calibration of a file, or with none."""
        rig = self.model_copy(update={"calibration": file})
        rig._calibrated = content
        return rig

    def calibrated_as(self, rig: Rig) -> Rig:
        """Return the rig with the content of the calibration that it names, if another rig names the same and has
        it."""
        return self.with_calibration(rig.calibration, rig._calibrated) if self.calibration == rig.calibration else self

    @property
    def beside(self) -> dict[str, bytes]:
        """The files beyond its own that the rig consists of, by name: its calibration, if that was read."""
        return {self.calibration.file: self._calibrated.content} if self.calibration and self._calibrated else {}

    def modelled_as(self, rig: Rig) -> Rig:
        """Return the rig with the errors of another one: its effects and its calibration."""
        return self.model_copy(update={"effects": rig.effects}).with_calibration(rig.calibration, rig._calibrated)

    @field_validator("tests")
    @classmethod
    def _of_one_length(cls, tests: Tests, info: ValidationInfo) -> Tests:
        link = info.data.get("link")
        if link and tests.hemisphere and abs(link.length_mm - tests.hemisphere.radius_mm) > _LINK_OFF_MM:
            lengths = (
                f"the link is {link.length_mm:g} mm long and the hemisphere's radius_mm {tests.hemisphere.radius_mm:g}"
            )
            raise ValueError(f"{lengths}, more than {_LINK_OFF_MM:g} mm apart; correct one of them")
        return tests

    @field_validator("effects")
    @classmethod
    def _of_its_axes(cls, effects: tuple[AnyEffect, ...], info: ValidationInfo) -> tuple[AnyEffect, ...]:
        axes = len(info.data["robot"].axes) if "robot" in info.data else MOST_AXES
        for effect in effects:
            seat = max(getattr(effect, key, 0) for key in ("axis", "from_axis", "to_axis"))
            if seat > axes:
                raise ValueError(f"{name_of(effect)} is of axis {seat}, and the robot has {axes}; correct it")
        return effects

    @model_validator(mode="after")
    def _is_driven(self) -> Rig:
        axes = len(self.robot.axes)
        driven = self.tests.circle or self.tests.hemisphere or not isinstance(self.feedback, NoFeedback)
        if axes != DRIVEN_AXES and driven:
            problem = f"an arm of {axes} axes is measured by poses and touches that are imported"
            raise ValueError(f"{problem}: circle, hemisphere, gauges and feedback are of six axes; leave them out")
        if self.robot.rail and (driven or self.tests.iso9283):
            problem = "an arm on a rail is measured by poses and touches that are imported"
            stands = "circle, hemisphere, iso9283, gauges and feedback are of an arm that stands"
            raise ValueError(f"{problem}: {stands}; leave them out, or leave out the rail while it stands")
        return self

    @model_validator(mode="after")
    def _read_together(self) -> Rig:
        if dict(self.gauges) and isinstance(self.feedback, NoFeedback):
            problem = "gauges without feedback: rigd records both together"
            raise ValueError(f"{problem}; add feedback, or leave out gauges where a tracker alone measures")
        return self

    @field_validator("automatic")
    @classmethod
    def _possible(cls, automatic: Automatic | None, info: ValidationInfo) -> Automatic | None:
        if automatic is None or not {"feedback", "gauges"} <= info.data.keys():  # with mistakes of their own
            return automatic
        gauges = len(list(info.data["gauges"]))
        if not gauges or isinstance(info.data["feedback"], NoFeedback):
            raise ValueError("nothing is recorded without gauges and feedback; add both, or leave it out")
        if lacking := automatic.lacking(signal=carries_signal(info.data["feedback"]), gauges=gauges):
            raise ValueError("; ".join(lacking))
        return automatic

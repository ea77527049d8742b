"""A rig: robot, gauges, feedback, tests, known effects, what its daemon does by itself. One YAML file, one object."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, ValidationInfo, field_validator

from rigs.automatic import Automatic, Retention
from rigs.base import Part
from rigs.effects import Effect
from rigs.feedback import Feedback, carries_signal
from rigs.gauges import Gauges
from rigs.robot import Robot
from rigs.tests import Tests


class Rig(Part):
    """Everything that is known of a cell before it is measured."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,62}$")]
    """Lower case, digits, - and _: it names the socket, the service and the runs."""
    description: str = ""
    robot: Robot
    gauges: Gauges
    feedback: Feedback
    tests: Tests = Tests()
    effects: tuple[Effect, ...] = ()
    automatic: Automatic | None = None
    retention: Retention | None = None
    replay: str = ""
    """Of a cell that `rig replay` serves: the file where it says what is out of step."""

    @field_validator("automatic")
    @classmethod
    def _possible(cls, automatic: Automatic | None, info: ValidationInfo) -> Automatic | None:
        if automatic is None or not {"feedback", "gauges"} <= info.data.keys():  # with mistakes of their own
            return automatic
        gauges = len(list(info.data["gauges"]))
        if lacking := automatic.lacking(signal=carries_signal(info.data["feedback"]), gauges=gauges):
            raise ValueError("; ".join(lacking))
        return automatic

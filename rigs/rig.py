"""A rig: robot, gauges, feedback, tests and known effects. One YAML file, one object."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rigs.base import Part
from rigs.effects import Effect
from rigs.feedback import Feedback
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

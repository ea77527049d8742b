"""The interface of the writer of a maker: the files of a plan, and the feedback interfaces of the controllers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from analysis.apps.makers.motion_plan import Demand, MotionPlan

BY_ITSELF = "the controller provides the feedback without this program"


@dataclass(frozen=True)
class ProgramWriter:
    write: Callable[[MotionPlan, Demand], dict[str, str]]
    """Returns the files of a plan by name, with lines ending with a line feed."""
    feedbacks: Mapping[type, str] = field(default_factory=dict)
    """Interfaces served by the controllers in addition to Modbus, with the requirements."""
    newline: str = "\r\n"
    outputs: range = range(1, 4097)

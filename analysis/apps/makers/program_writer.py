"""What a maker's writer offers: the files of a plan, and the interfaces that its controllers serve."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from analysis.apps.makers.programs.motion_plan import Demand, Plan

BY_ITSELF = "the controller serves it without the program"


@dataclass(frozen=True)
class ProgramWriter:
    """write: the files of a plan by their names, lines ending with a line feed; feedbacks: the interfaces that this
    maker's controllers serve beside Modbus, and what they need for that; newline: what the controller's files end lines
    with; outputs: the numbers of its digital outputs, which count from 1: some have up to 4096, others
    fewer."""

    write: Callable[[Plan, Demand], dict[str, str]]
    feedbacks: Mapping[type, str] = field(default_factory=dict)
    newline: str = "\r\n"
    outputs: range = range(1, 4097)

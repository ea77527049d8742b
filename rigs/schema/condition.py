"""Condition of a robot in addition to its joint angles: columns and codes that are independent of the maker.

Each interface translates the data of its controllers. A missing value and an unknown code become nan.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from enum import IntEnum

PROGRAM, SAFETY, MOTORS, SPEED, PAYLOAD = "program_state", "safety_state", "motors_on", "speed_percent", "payload_kg"
FULL_PERCENT = 99.5
"""Speed below which the robot is slowed down. Controllers show whole percent."""
TEMPERATURES = tuple(f"temperature{axis}_c" for axis in range(1, 7))
"""Joint temperatures in °C."""
CURRENTS = tuple(f"current{axis}_a" for axis in range(1, 7))
"""Joint motor currents in A."""
CONDITION = (PROGRAM, SAFETY, MOTORS, SPEED, PAYLOAD, *TEMPERATURES, *CURRENTS)
"""All columns of the condition."""


class ProgramState(IntEnum):
    """State of the program on the controller (`program_state`)."""

    STOPPED = 0
    RUNNING = 1
    PAUSED = 2


class SafetyState(IntEnum):
    """State of the controller's safety functions (`safety_state`)."""

    NORMAL = 0
    REDUCED = 1
    """The robot moves within reduced limits."""
    PROTECTIVE_STOP = 2
    SAFEGUARD_STOP = 3
    """Stopped by a gate, a scanner or an enabling device."""
    EMERGENCY_STOP = 4
    RECOVERY = 5
    """The robot is outside the limits, and may only be moved back."""
    FAULT = 6


STOPPED = frozenset(SafetyState) - {SafetyState.NORMAL, SafetyState.REDUCED}
"""States in which programs cannot move the robot."""
UNDISTURBED = {
    PROGRAM: float(ProgramState.RUNNING),
    SAFETY: float(SafetyState.NORMAL),
    MOTORS: 1.0,
    SPEED: 100.0,
    PAYLOAD: 0.0,
    **dict.fromkeys(TEMPERATURES, 30.0),
    **dict.fromkeys(CURRENTS, 0.0),
}
"""Condition during an undisturbed test, with warm joints and unloaded motors."""


def condition_words(shown: Mapping[str, float]) -> Iterator[tuple[str, bool]]:
    """Yield the known parts of a condition as text, with a flag for a disturbance, such as a stop or reduced speed."""
    if shown.get(SAFETY, math.nan) in STOPPED:
        yield words_of(SafetyState(int(shown[SAFETY]))), True
    if shown.get(MOTORS) == 0:
        yield "motors off", True
    if shown.get(PROGRAM, math.nan) in set(ProgramState):
        state = ProgramState(int(shown[PROGRAM]))
        yield f"program {words_of(state)}", state is ProgramState.PAUSED
    if SPEED in shown:
        yield f"speed {shown[SPEED]:.0f} %", shown[SPEED] < FULL_PERCENT
    if PAYLOAD in shown:
        yield f"payload {shown[PAYLOAD]:.1f} kg", False
    if warm := [shown[name] for name in TEMPERATURES if name in shown]:
        yield f"joints {min(warm):.0f} to {max(warm):.0f} °C", False


def words_of(state: IntEnum) -> str:
    """Return a state as text, such as `protective stop`."""
    return state.name.lower().replace("_", " ")

"""Condition of a robot in addition to the joint angles: columns and codes independent of the maker.

Each interface translates the data of the controller. Missing values and unknown codes are nan, never assumed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from enum import IntEnum

PROGRAM, SAFETY, MOTORS, SPEED, PAYLOAD = "program_state", "safety_state", "motors_on", "speed_percent", "payload_kg"
FULL_PERCENT = 99.5
"""Speed below which it counts as reduced: controllers show integer percentages."""
TEMPERATURES = (
    "temperature1_c", "temperature2_c", "temperature3_c", "temperature4_c", "temperature5_c", "temperature6_c"
)  # fmt: skip
CURRENTS = ("current1_a", "current2_a", "current3_a", "current4_a", "current5_a", "current6_a")
POSE = (
    "controller_x_mm", "controller_y_mm", "controller_z_mm",
    "controller_rx_deg", "controller_ry_deg", "controller_rz_deg",
)  # fmt: skip
"""Pose that the controller computes for the reported angles, with roll, pitch and yaw about fixed axes.

Of the flange in the base, or of the tool in the frame that the controller uses.
"""
CONDITION = (PROGRAM, SAFETY, MOTORS, SPEED, PAYLOAD, *TEMPERATURES, *CURRENTS, *POSE)


class ProgramState(IntEnum):
    STOPPED = 0
    RUNNING = 1
    PAUSED = 2


class SafetyState(IntEnum):
    NORMAL = 0
    REDUCED = 1
    """The robot moves within reduced limits."""
    PROTECTIVE_STOP = 2
    SAFEGUARD_STOP = 3
    """Stop by a gate, a scanner or an enabling device."""
    EMERGENCY_STOP = 4
    RECOVERY = 5
    """The robot is outside of its limits and may only be moved back."""
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
    **dict.fromkeys(POSE, math.nan),
}
"""Condition during an undisturbed test: warm joints, and motors with no load."""


def condition_words(shown: Mapping[str, float]) -> Iterator[tuple[str, bool]]:
    """Yield the known parts of a condition as text, each with a flag for disturbances like a stop or reduced speed."""
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
    return state.name.lower().replace("_", " ")

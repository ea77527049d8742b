"""Findings about a cell, and checks of the robot before a recording: stops, paused programs, motors, speed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from daq.protocol.conversation import Sample
from rigs.schema.condition import CONDITION, FULL_PERCENT, MOTORS, PROGRAM, SAFETY, SPEED, ProgramState, SafetyState


class FindingVerdict(StrEnum):
    OK = "ok"
    DOUBTFUL = "doubtful"
    """The cell may work, but possibly not well."""
    WRONG = "wrong"
    """The cell will not work."""


@dataclass(frozen=True)
class CellFinding:
    about: str
    """Gauge, robot, disk, …"""
    verdict: FindingVerdict
    what: str
    remedy: str = ""
    """Empty if all is well."""


def ok(about: str, observation: str) -> CellFinding:
    return CellFinding(about, FindingVerdict.OK, observation)


def doubtful(about: str, observation: str, remedy: str) -> CellFinding:
    return CellFinding(about, FindingVerdict.DOUBTFUL, observation, remedy)


def wrong(about: str, observation: str, remedy: str) -> CellFinding:
    return CellFinding(about, FindingVerdict.WRONG, observation, remedy)


STOPS = {
    SafetyState.PROTECTIVE_STOP: ("protective stop", "find the cause, then unlock the robot on the pendant"),
    SafetyState.SAFEGUARD_STOP: ("safeguard stop", "close the safety gate and reset the stop"),
    SafetyState.EMERGENCY_STOP: ("emergency stop", "release the emergency stop and switch the robot on"),
    SafetyState.RECOVERY: ("recovery mode", "move the robot back into the limits"),
    SafetyState.FAULT: ("a fault", "read the message on the pendant; clear it, or restart the controller"),
}
"""Safety states that prevent programs from running, each with a remedy."""


def condition_in(columns: Sequence[str], sample: Sample) -> dict[str, float]:
    """Condition in a sample of a robot; nan for missing values."""
    return {name: value for name, value in zip(columns, sample.values, strict=True) if name in CONDITION}


def stop_reason(shown: Mapping[str, float]) -> str:
    """Reason and remedy for a robot that cannot run programs; empty if it can or if unknown."""
    return "; ".join(STOPS.get(shown.get(SAFETY), ()))  # type: ignore[call-overload] # nan is no state


def check_condition(about: str, shown: Mapping[str, float]) -> Iterator[CellFinding]:
    """Problems to solve before a recording. shown: columns of the condition; missing columns are not checked."""
    if shown.get(SAFETY) in STOPS:
        state, remedy = STOPS[SafetyState(int(shown[SAFETY]))]
        yield wrong(about, f"is in {state}", remedy)
    if shown.get(MOTORS) == 0:
        yield doubtful(about, "the motors are off", "switch the motors on before the recording")
    if shown.get(PROGRAM) == ProgramState.PAUSED:
        remedy = "resume the program; or stop the program and start it after the start of the recording"
        yield doubtful(about, "the program is paused", remedy)
    # A controller may show a speed of zero while no program is running, regardless of the setting.
    if 0 < shown.get(SPEED, 0.0) < FULL_PERCENT:
        observation = f"the speed is set to {shown[SPEED]:.0f} %"
        yield doubtful(about, observation, "set the speed to 100 %; results at other speeds are not comparable")

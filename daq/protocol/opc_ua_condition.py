"""The condition of a robot as OPC 40010-1 shows it, in the columns and codes of `rigs.schema.condition`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from daq.protocol.numerals import plausible
from rigs.schema.condition import MOTORS, PAYLOAD, PROGRAM, SAFETY, SPEED, TEMPERATURES, ProgramState, SafetyState

MODE, EMERGENCY, PROTECTIVE = "OperationalMode", "EmergencyStop", "ProtectiveStop"
DRIVES, OVERRIDE, MASS = "InControl", "SpeedOverride", "Mass"
STATE, READY = "CurrentState", "ReadySubstateMachine.CurrentState"
FRONT = (MODE, EMERGENCY, PROTECTIVE, DRIVES, OVERRIDE)
"""Browse names in the parameter sets of robot and safety state."""
_MANUAL_REDUCED = 1
"""OperationalModeEnumeration: MANUAL_REDUCED_SPEED."""
_STATES = {"Executing": ProgramState.RUNNING, "Ready": ProgramState.STOPPED, "Idle": ProgramState.STOPPED}
"""States of the TaskControlStateMachineType. A server may translate them; then they are not known."""
_SUSPENDED = "Suspended"
"""State of the ReadySubstateMachineType in which a program was stopped in its midst."""


def condition_of(shown: Mapping[str, Any]) -> dict[str, float]:
    """Return all columns of the condition. shown: values by browse name (temperatures by column); nan: not shown."""
    state, drives = shown.get(STATE), shown.get(DRIVES)
    program = float(_STATES.get(state, math.nan)) if isinstance(state, str) else math.nan
    if state == "Ready" and shown.get(READY) == _SUSPENDED:
        program = float(ProgramState.PAUSED)
    motors = float(drives) if isinstance(drives, bool) else math.nan
    columns = {PROGRAM: program, SAFETY: _safety(shown), MOTORS: motors}
    columns |= {SPEED: _number(shown.get(OVERRIDE)), PAYLOAD: _number(shown.get(MASS))}
    return columns | {name: _number(shown.get(name)) for name in TEMPERATURES}


def shown_of(condition: Mapping[str, float]) -> dict[str, Any]:
    """Return what a controller shows of a condition, the other way round: by browse name."""
    program, safety = condition[PROGRAM], condition[SAFETY]
    return {
        MODE: _MANUAL_REDUCED if safety == SafetyState.REDUCED else 3,
        EMERGENCY: safety == SafetyState.EMERGENCY_STOP,
        PROTECTIVE: safety == SafetyState.PROTECTIVE_STOP,
        DRIVES: condition[MOTORS] == 1,
        OVERRIDE: condition[SPEED],
        MASS: condition[PAYLOAD],
        STATE: "Executing" if program == ProgramState.RUNNING else "Ready",
        READY: _SUSPENDED if program == ProgramState.PAUSED else "AtProgramStart",
    } | {name: condition[name] for name in TEMPERATURES}


def _safety(shown: Mapping[str, Any]) -> float:
    """Both stops have to be shown for a robot to be called free of them."""
    emergency, protective = shown.get(EMERGENCY), shown.get(PROTECTIVE)
    if emergency is True:
        return float(SafetyState.EMERGENCY_STOP)
    if protective is True:
        return float(SafetyState.PROTECTIVE_STOP)
    if emergency is not False or protective is not False:
        return math.nan
    return float(SafetyState.REDUCED if shown.get(MODE) == _MANUAL_REDUCED else SafetyState.NORMAL)


def _number(value: Any) -> float:
    return plausible(float(value)) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan

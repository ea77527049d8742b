import math
from dataclasses import replace
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="asyncua is not installed: pip install '.[opcua]'")

from asyncua import ua

from daq.opc_ua.channel import MESSAGE, Channel
from daq.opc_ua.nodes import condition_of
from daq.opc_ua.values import AxisValue, Together
from rigs.schema.condition import ProgramState, SafetyState
from tests.support.conversation_logs import LOGS


def test_a_server_that_shows_more_nodes_than_robots_have_is_left():
    """The others of its conversations are on record."""
    (paged,) = [one for one in LOGS["opc_ua_robotics"] if one.title.startswith("paged browse")]
    script, channel = replace(paged, inputs=paged.inputs[:-2]).begun(), Channel()
    channel.number, channel.token = 7, 1
    shown = [ua.ReferenceDescription(BrowseName=ua.QualifiedName(str(k), 2)) for k in range(4000)]
    answer: Any = ua.BrowseResponse(Results=[ua.BrowseResult(References=shown, ContinuationPoint=b"more")])
    for page in range(1, 5):
        script.receive(channel.packed(MESSAGE, answer, len(paged.inputs) - 3 + page))
        if script.step.hang_up:
            break
        for reference in shown:
            object.__setattr__(reference.BrowseName, "Name", f"{reference.BrowseName.Name}.{page}")
        answer = ua.BrowseNextResponse()
        answer.Parameters.Results = [ua.BrowseResult(References=shown, ContinuationPoint=b"more")]
    (fault,) = script.taken()
    assert page == 3 and "12000 candidate nodes" in fault.detail


@pytest.mark.parametrize(
    ("shown", "expected"),
    [
        ({}, (math.nan, math.nan)),
        ({"EmergencyStop": False}, (math.nan, math.nan)),
        ({"EmergencyStop": False, "ProtectiveStop": False}, (math.nan, SafetyState.NORMAL)),
        ({"EmergencyStop": False, "ProtectiveStop": False, "OperationalMode": 1}, (math.nan, SafetyState.REDUCED)),
        ({"ProtectiveStop": True}, (math.nan, SafetyState.PROTECTIVE_STOP)),
        ({"EmergencyStop": True, "ProtectiveStop": True}, (math.nan, SafetyState.EMERGENCY_STOP)),
        ({"CurrentState": "Executing"}, (ProgramState.RUNNING, math.nan)),
        ({"CurrentState": "Ready"}, (ProgramState.STOPPED, math.nan)),
        ({"CurrentState": "Ready", "ReadySubstateMachine.CurrentState": "Suspended"}, (ProgramState.PAUSED, math.nan)),
        ({"CurrentState": "Läuft"}, (math.nan, math.nan)),
        ({"CurrentState": 3, "EmergencyStop": 1, "ProtectiveStop": "no"}, (math.nan, math.nan)),
    ],
)
def test_condition_is_shown_and_never_assumed(shown, expected):
    found = condition_of(shown)
    assert (found["program_state"], found["safety_state"]) == pytest.approx(expected, nan_ok=True)


def test_numbers_of_the_condition_that_nothing_can_have_are_not_shown():
    found = condition_of({"SpeedOverride": 1e300, "Mass": "heavy", "InControl": True, "temperature2_c": 41.5})
    assert math.isnan(found["speed_percent"]) and math.isnan(found["payload_kg"])
    assert found["motors_on"] == 1 and found["temperature2_c"] == 41.5


def test_values_without_stamps_are_the_last_of_each_axis():
    values = [AxisValue(axis, axis + step, math.nan) for axis in range(6) for step in (0.0, 0.5)]
    (position,) = Together(0.005).take(values)
    assert position.angles_deg == (0.5, 1.5, 2.5, 3.5, 4.5, 5.5)
    assert math.isnan(position.clock_s)

import math
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import pytest

import daq.feedback
from daq.acquisition.streams import Stream, robot_stream
from daq.discovery import trial
from daq.discovery.cell_finding import CellFinding, FindingVerdict, check_condition
from daq.discovery.examine import check_daemon
from daq.emulators.network_ports import TcpPort
from daq.protocol.conversation import Sample
from rigs.schema.condition import UNDISTURBED, ProgramState, SafetyState
from tests.support.drivers import rtde


@contextmanager
def _robot(condition: Sequence[float]) -> Iterator[Stream]:
    robot, stop = rtde(rate_hz=125), threading.Event()
    port = TcpPort(lambda: daq.feedback.device(robot, lambda now_ns: [1.0] * 6 + [*condition]))
    thread = threading.Thread(target=port.serve, args=(stop,))
    thread.start()
    try:
        yield replace(robot_stream(robot), port=port.port)
    finally:
        stop.set()
        thread.join()


def _beyond_answers(found: Sequence[CellFinding]) -> list[tuple[FindingVerdict, str]]:
    return [(finding.verdict, f"{finding.what}: {finding.remedy}") for finding in found if finding.remedy]


def test_robot_in_protective_stop_is_reported_with_program_and_speed():
    with _robot([ProgramState.PAUSED, SafetyState.PROTECTIVE_STOP, 40.0]) as stream:
        found = _beyond_answers(list(trial.examine_conversation(stream, 0.3)))
    assert [verdict for verdict, _ in found] == [
        FindingVerdict.WRONG,
        FindingVerdict.DOUBTFUL,
        FindingVerdict.DOUBTFUL,
    ], found
    assert "protective stop" in found[0][1] and "unlock" in found[0][1]
    assert "paused" in found[1][1] and "40 %" in found[2][1]


def test_missing_condition_fields_are_named_and_not_judged():
    readings = trial.Trial([Sample((*[1.0] * 6, math.nan, 0.0, *[math.nan] * 8), k, k, k, 9) for k in range(9)])
    finding = trial.check_answers(robot_stream(rtde()), readings, lambda: None)
    assert (
        finding.verdict is FindingVerdict.OK
        and "not available: program_state, speed_percent, payload_kg" in finding.what
    )


@pytest.mark.parametrize(
    ("shown", "count"),
    [
        ({}, 0),
        (UNDISTURBED, 0),
        (dict.fromkeys(UNDISTURBED, math.nan), 0),
        ({"program_state": 0.0, "speed_percent": 0.0, "safety_state": 1.0}, 0),
        ({"motors_on": 0.0}, 1),
        ({"speed_percent": 99.0}, 1),
        ({"safety_state": 6.0, "motors_on": 0.0}, 2),
    ],
)
def test_each_condition_by_itself(shown, count):
    assert len(list(check_condition("robot", shown))) == count


@pytest.mark.parametrize(
    ("connected", "age_s", "is_shown"), [(True, 0.1, True), (True, 60.0, False), (False, 0.1, False)]
)
def test_daemon_shows_the_present_condition(connected, age_s, is_shown):
    stream, last = robot_stream(rtde()), {"q1_deg": 1.0, "safety_state": 4.0, "temperature1_c": 30.0}
    robot = {
        "port": stream.port,
        "connected": connected,
        "rate_hz": 500.0,
        "counters": {"samples": 9},
        "last_fault": "",
    }
    robot |= {"last": last, "age_s": {"q1_deg": 0.1, "safety_state": age_s, "temperature1_c": 100.0}}
    found = check_daemon({"rig": "bench", "recording": None, "streams": {"robot": robot}}, [stream])
    assert any("emergency stop" in finding.what for finding in found) == is_shown

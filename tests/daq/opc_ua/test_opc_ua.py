import math
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="asyncua is not installed: pip install '.[opcua]'")

from asyncua import ua

import daq.feedback
from daq.opc_ua.channel import OPEN, decoded, type_of
from daq.opc_ua.nodes import CELSIUS, DEGREE
from daq.opc_ua.server import RobotServer, Space, robot_space
from daq.protocol.conversation import NO_TIME, ConversationStep, FaultKind, Item
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import open_link
from rigs.schema.feedback import OPCUARobotics
from rigs.schema.links import Line
from tests.support.drivers import NODES, opc_ua
from tests.support.opc_ua_chunks import faults, requests_in, samples
from tests.support.opc_ua_servers import RADIAN, library_robot, now
from tests.support.simulated_conversation import S, simulate

LINE = Line(baud=9600, bits=8, parity="N", stop=1)
ANGLES_DEG = [10.0, -20.5, 30.25, -40.125, 50.0625, 359.0]
PATIENCE_S = 60.0
T0 = datetime(2026, 11, 21, tzinfo=UTC)


# --- a server of the asyncua library ---


@pytest.fixture(scope="module")
def robot():
    with library_robot(RADIAN) as robot:
        yield robot


def read_until(
    feedback: OPCUARobotics, enough: Callable[[list[Item]], object], drive: Callable[[], None]
) -> list[Item]:
    items: list[Item] = []
    until_s = time.monotonic() + PATIENCE_S
    over = threading.Event()

    def driving() -> None:
        while not over.wait(0.02):
            drive()

    thread = threading.Thread(target=driving)
    thread.start()
    link = open_link("robot", feedback.port, LINE)
    try:
        host = daq.feedback.host(feedback)
        run_conversation(link, host, items.extend, lambda: bool(enough(items)) or time.monotonic() > until_s)
    finally:
        over.set()
        thread.join()
        link.close()
    assert enough(items), items[-3:]
    return items


def test_library_server_is_read_in_radians_with_source_stamps(robot):
    written: dict[float, float] = {}

    def drive() -> None:
        at, angle = now(), len(written) * 1e-3
        written[at.timestamp()] = angle
        robot.drive([angle + axis for axis in range(6)], at)

    items = read_until(opc_ua(port=robot.port, rate_hz=50), lambda items: len(samples(items)) > 20, drive)
    # A computer that is held up while it writes the axes has a position of two instants, which is counted.
    mixed = [fault for fault in faults(items) if fault.kind is FaultKind.DOUBTFUL]
    assert faults(items) == mixed
    whole = [sample for sample in samples(items)[1:] if sample.device_time_s in written]  # the first: not driven yet
    assert len(whole) >= len(samples(items)) - 1 - sum(fault.count for fault in mixed) and len(whole) > 10
    for sample in whole:
        expected = [math.degrees(written[sample.device_time_s] + axis) for axis in range(6)]
        assert sample.values[:6] == pytest.approx(expected, abs=1e-9) and sample.requested_ns == NO_TIME
    assert samples(items)[-1].values[6:] == pytest.approx([1, 0, 1, 100, math.nan, *range(31, 37)], nan_ok=True)


def test_a_robot_that_stands_with_stamps_that_stand_is_polled(robot):
    robot.drive(ANGLES_DEG, T0)
    items = read_until(
        opc_ua(port=robot.port, rate_hz=50, timeout_s=1), lambda items: len(samples(items)) > 20, lambda: None
    )
    polled = samples(items)[1:]
    assert all(0 < sample.requested_ns <= sample.first_byte_ns for sample in polled)
    assert all(math.isnan(sample.device_time_s) for sample in polled) and faults(items) == []


def test_server_without_robot_is_reported():
    with library_robot(names=()) as empty:
        missing = read_until(opc_ua(port=empty.port), faults, lambda: None)
    assert "contains no MotionDeviceSystem" in faults(missing)[0].detail


# --- the emulated server, in simulated time ---


def served(feedback: OPCUARobotics, until_ns: int = S, **server: Any) -> list[Item]:
    return simulate(daq.feedback.host(feedback), RobotServer(feedback, _standing(feedback), **server), until_ns)


def _standing(feedback: OPCUARobotics) -> Callable[[int], list[float]]:
    beside = [1.0, 0.0, 1.0, 100.0, 0.0, *[30.0] * 6] if feedback.condition else []
    return lambda _: [*ANGLES_DEG, *beside]


def test_a_server_without_subscriptions_is_polled_at_the_rate():
    items = served(opc_ua(rate_hz=100), 2 * S, subscriptions=False)
    polled = samples(items)
    assert 190 < len(polled) <= 201 and faults(items) == []
    assert {b.requested_ns - a.requested_ns for a, b in pairwise(polled)} == {S // 100}


def test_a_channel_is_renewed_in_time():
    opened: list[int] = []

    class Watched(RobotServer):
        def received(self, data: bytes, now_ns: int) -> ConversationStep:
            opened.extend([now_ns] * data.count(OPEN))
            return super().received(data, now_ns)

    feedback = opc_ua(rate_hz=1, condition=False, timeout_s=3)
    items = simulate(daq.feedback.host(feedback), Watched(feedback, _standing(feedback)), 6000 * S)
    assert len(samples(items)) == 6001 and faults(items) == []
    assert [at_ns // S for at_ns in opened] == [0, 2700, 5400]


def _space(**axes: int | None) -> Space:
    space = Space()
    for axis, unit in axes.items():
        space.add(f"DeviceSet/Cell/MotionDevices/Robot/Axes/{axis}/ParameterSet/ActualPosition", "q1", unit)
    return space


def _two_robots() -> Space:
    space = robot_space(opc_ua(device="Left"))
    for path, node in [("Right", None), ("Right/Axes", None)]:
        space.add(f"DeviceSet/System/MotionDevices/{path}", node=node)
    return space


SIX = {f"A{axis}": DEGREE for axis in range(1, 7)}


@pytest.mark.parametrize(
    ("space", "changes", "words"),
    [
        (Space(), {}, ("contains no MotionDeviceSystem", "node ids")),
        (_space(), {}, ("contains no MotionDeviceSystem",)),
        (_space(**SIX, A7=DEGREE), {}, ("A7", "`axes`")),
        (_space(Base=DEGREE, Shoulder=DEGREE), {}, ("Base, Shoulder", "`axes`")),
        (_space(**SIX), {"axes": ("A1", "A2", "A3", "A4", "A5", "E1")}, ("'E1'", "A1, A2")),
        (_space(**SIX | {"A2": CELSIUS}), {}, ("'A2'", "'°C'", "angle unit")),
        (_space(**dict.fromkeys(SIX)), {}, ("'A1'", "`units`")),
        (_two_robots(), {}, ("Left, Right", "`device`")),
        (_two_robots(), {"device": "Middle"}, ("Left, Right",)),
        (_two_robots(), {"device": "Right"}, ("none", "`axes`")),
    ],
)
def test_mismatch_with_the_rig_file_is_named(space, changes, words):
    items = served(opc_ua(**changes), space=space)
    fault = faults(items)[0]
    assert fault.kind is FaultKind.MISSING and samples(items) == []
    assert all(word in fault.detail for word in words), fault.detail


def test_unit_of_the_rig_file_replaces_a_missing_one():
    space = _space(**dict.fromkeys(SIX))
    (sample, *_) = samples(served(opc_ua(units="rad", condition=False), space=space))
    assert sample.values == pytest.approx([10.0] * 6)  # all of them show q1


@pytest.mark.parametrize(
    "changes",
    [
        {"axes": ("A1", "A1", "A2", "A3", "A4", "A5")},
        {"axes": (*NODES[:5], "A6")},
        {"port": "/dev/ttyUSB0"},
        {"path": "UA/Robot"},
    ],
)
def test_a_rig_file_that_cannot_be_meant_is_refused(changes):
    with pytest.raises(ValueError, match=r"twice|node id|TCP port|pattern"):
        opc_ua(**changes)


def test_only_services_that_read_are_asked_for():
    sent = bytearray()

    class Noted(RobotServer):
        def received(self, data: bytes, now_ns: int) -> ConversationStep:
            sent.extend(data)
            return super().received(data, now_ns)

    feedback = opc_ua()
    simulate(daq.feedback.host(feedback), Noted(feedback, _standing(feedback)), S)
    reading = (
        ua.OpenSecureChannelRequest,
        ua.CreateSessionRequest,
        ua.ActivateSessionRequest,
        ua.BrowseRequest,
        ua.ReadRequest,
        ua.CreateSubscriptionRequest,
        ua.CreateMonitoredItemsRequest,
        ua.PublishRequest,
    )
    asked = requests_in(bytes(sent))
    assert {type_of(body) for _, body in asked} == {kind().TypeId.Identifier for kind in reading}
    (_, activation) = asked[2]
    assert decoded(ua.ActivateSessionRequest, activation).Parameters.UserIdentityToken.PolicyId == "anonymous"

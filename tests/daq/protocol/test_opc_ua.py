"""OPC UA for Robotics: a server of the asyncua library as a peer, and messages that are wrong, late or refused."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="asyncua is not installed: pip install 'rig[opcua]'")

from asyncua import ua

import daq.feedback
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Item, Sample, Step
from daq.protocol.opc_ua import ACKNOWLEDGE, ERROR, MESSAGE, OPEN, Channel, decoded, type_of
from daq.protocol.opc_ua_condition import condition_of
from daq.protocol.opc_ua_nodes import CELSIUS, DEGREE
from daq.protocol.opc_ua_positions import ArmPosition, AxisValue, Together
from daq.protocol.opc_ua_server import RobotServer
from daq.protocol.opc_ua_space import Space, robot_space
from daq.wire.opening import open_link
from daq.wire.session import run_conversation
from rigs.schema.condition import ProgramState, SafetyState
from rigs.schema.links import Line
from rigs.schema.opc_ua import OPCUARobotics
from tests.support.drivers import NODES, opc_ua
from tests.support.opc_ua_servers import RADIAN, LibraryRobot, library_robot, now
from tests.support.simulated_conversation import S, Script, simulate

LINE = Line(baud=9600, bits=8, parity="N", stop=1)
ANGLES_DEG = [10.0, -20.5, 30.25, -40.125, 50.0625, 359.0]
PATIENCE_S = 60.0
T0 = datetime(2026, 11, 21, tzinfo=UTC)


def faults(items: Sequence[object]) -> list[Fault]:
    return [item for item in items if isinstance(item, Fault)]


def samples(items: Sequence[object]) -> list[Sample]:
    return [item for item in items if isinstance(item, Sample)]


# --- a server of the asyncua library ---


@pytest.fixture(scope="module")
def robot() -> Iterator[LibraryRobot]:
    with library_robot(RADIAN) as robot:
        yield robot


def read_until(
    feedback: OPCUARobotics, enough: Callable[[list[Item]], object], drive: Callable[[], None]
) -> list[Item]:
    """Read while the robot is driven, until there is enough."""
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


def test_the_library_s_server_is_read_in_radians_with_the_stamps_of_its_source(robot: LibraryRobot) -> None:
    written: dict[float, float] = {}

    def drive() -> None:
        at, angle = now(), len(written) * 1e-3
        written[at.timestamp()] = angle
        robot.drive([angle + axis for axis in range(6)], at)

    items = read_until(opc_ua(port=robot.port, rate_hz=50), lambda items: len(samples(items)) > 20, drive)
    assert faults(items) == []
    for sample in samples(items)[1:]:  # the first may be from before the robot was driven
        expected = [math.degrees(written[sample.device_time_s] + axis) for axis in range(6)]
        assert sample.values[:6] == pytest.approx(expected, abs=1e-9) and sample.requested_ns == NO_TIME
    assert samples(items)[-1].values[6:] == pytest.approx([1, 0, 1, 100, math.nan, *range(31, 37)], nan_ok=True)


def test_a_bad_value_is_a_fault_and_an_uncertain_one_keeps_its_code(robot: LibraryRobot) -> None:
    codes = iter([0, ua.StatusCodes.BadSensorFailure, ua.StatusCodes.UncertainSensorNotAccurate] * 1000)
    items = read_until(
        opc_ua(port=robot.port, rate_hz=50, condition=False),
        lambda items: len(faults(items)) > 6 and {sample.status for sample in samples(items)} > {0},
        lambda: robot.drive(ANGLES_DEG, now(), next(codes)),
    )
    assert {fault.kind for fault in faults(items)} == {FaultKind.DEVICE_ERROR}
    assert "axis 1: BadSensorFailure" in faults(items)[0].detail
    assert {sample.status for sample in samples(items)} == {0, ua.StatusCodes.UncertainSensorNotAccurate}


def test_a_robot_that_stands_with_stamps_that_stand_is_polled(robot: LibraryRobot) -> None:
    robot.drive(ANGLES_DEG, T0)
    items = read_until(
        opc_ua(port=robot.port, rate_hz=50, timeout_s=1), lambda items: len(samples(items)) > 20, lambda: None
    )
    polled = samples(items)[1:]
    assert all(0 < sample.requested_ns <= sample.first_byte_ns for sample in polled)
    assert all(math.isnan(sample.device_time_s) for sample in polled) and faults(items) == []


def test_a_server_without_a_robot_says_so() -> None:
    with library_robot(names=()) as empty:
        missing = read_until(opc_ua(port=empty.port), faults, lambda: None)
    assert "no MotionDeviceSystem" in faults(missing)[0].detail


# --- the emulated server, in simulated time ---


def served(feedback: OPCUARobotics, until_ns: int = S, **server: Any) -> list[Item]:
    return simulate(daq.feedback.host(feedback), RobotServer(feedback, _standing(feedback), **server), until_ns)


def _standing(feedback: OPCUARobotics) -> Callable[[int], list[float]]:
    beside = [1.0, 0.0, 1.0, 100.0, 0.0, *[30.0] * 6] if feedback.condition else []
    return lambda _: [*ANGLES_DEG, *beside]


def test_a_server_without_subscriptions_is_polled_at_the_rate() -> None:
    items = served(opc_ua(rate_hz=100), 2 * S, subscriptions=False)
    polled = samples(items)
    assert 190 < len(polled) <= 201 and faults(items) == []
    assert {b.requested_ns - a.requested_ns for a, b in pairwise(polled)} == {S // 100}


def test_a_channel_is_renewed_in_time() -> None:
    opened: list[int] = []

    class Watched(RobotServer):
        def received(self, data: bytes, now_ns: int) -> Step:
            opened.extend([now_ns] * data.count(OPEN))
            return super().received(data, now_ns)

    feedback = opc_ua(rate_hz=1, condition=False, timeout_s=3)
    items = simulate(daq.feedback.host(feedback), Watched(feedback, _standing(feedback)), 6000 * S)
    assert len(samples(items)) == 6001 and faults(items) == []
    assert [at_ns // S for at_ns in opened] == [0, 2700, 5400]


def _space(**axes: int | None) -> Space:
    """A robot with axes of these names, each with its unit."""
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
        (Space(), {}, ("no MotionDeviceSystem", "node ids")),
        (_space(), {}, ("no MotionDeviceSystem",)),
        (_space(**SIX, A7=DEGREE), {}, ("A7", "name six of them as `axes`")),
        (_space(Base=DEGREE, Shoulder=DEGREE), {}, ("Base, Shoulder", "`axes`")),
        (_space(**SIX), {"axes": ("A1", "A2", "A3", "A4", "A5", "E1")}, ("no axis 'E1'", "A1, A2")),
        (_space(**SIX | {"A2": CELSIUS}), {}, ("'A2'", "'°C'", "no angle")),
        (_space(**dict.fromkeys(SIX)), {}, ("unit of axis 'A1'", "`units`")),
        (_two_robots(), {}, ("Left, Right", "`device`")),
        (_two_robots(), {"device": "Middle"}, ("Left, Right",)),
        (_two_robots(), {"device": "Right"}, ("none", "`axes`")),
    ],
)
def test_what_does_not_fit_the_rig_file_is_named_with_the_remedy(
    space: Space, changes: dict[str, Any], words: tuple[str, ...]
) -> None:
    items = served(opc_ua(**changes), space=space)
    fault = faults(items)[0]
    assert fault.kind is FaultKind.MISSING and samples(items) == []
    assert all(word in fault.detail for word in words), fault.detail


def test_a_unit_of_the_rig_file_stands_where_the_server_states_none() -> None:
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
def test_a_rig_file_that_cannot_be_meant_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"twice|not some of each|not a TCP port|pattern"):
        opc_ua(**changes)


# --- a server driven by hand ---


class ByHand:
    """The server's side, one message at a time. `asked` is the request that waits for its answer."""

    def __init__(self, **changes: object) -> None:
        self.script = Script(daq.feedback.host(opc_ua(axes=NODES, units="deg", condition=False, **changes)))
        self.channel = Channel()
        self.say(ACKNOWLEDGE, ua.Acknowledge())
        opened = ua.OpenSecureChannelResponse()
        opened.Parameters.SecurityToken = ua.ChannelSecurityToken(7, 1, T0, 3_600_000)
        self.channel.number, self.channel.token = 7, 1
        self.say(OPEN, opened)

    def say(self, kind: bytes, message: Any, request: int | None = None) -> list[Item]:
        number = len(self.requests()) if request is None else request
        self.script.receive(self.channel.packed(kind, message, number))
        return self.script.taken()

    def requests(self) -> list[tuple[int, bytes]]:
        """All requests so far in their order: number and content."""
        own, found, sent = Channel(), [], self.script.sent
        while sent:
            size = int.from_bytes(sent[4:8], "little")
            received = own.read(sent[:size])
            sent = sent[size:]
            if received and received.request:
                found.append((received.request, received.body))
        return found

    def answer(self, response: Any) -> list[Item]:
        return self.say(MESSAGE, response)

    @property
    def asked(self) -> type[Any]:
        kinds = (ua.BrowseRequest, ua.ReadRequest, ua.PublishRequest, ua.CreateSubscriptionRequest)
        number = type_of(self.requests()[-1][1])
        return next((kind for kind in kinds if kind().TypeId.Identifier == number), object)

    def in_session(self) -> ByHand:
        created = ua.CreateSessionResponse()
        policy = ua.UserTokenPolicy(PolicyId="a", TokenType=ua.UserTokenType.Anonymous)
        created.Parameters.ServerEndpoints = [
            ua.EndpointDescription(SecurityMode=ua.MessageSecurityMode.None_, UserIdentityTokens=[policy])
        ]
        self.answer(created)
        self.answer(ua.ActivateSessionResponse())
        return self

    def subscribed(self) -> ByHand:
        self.in_session().answer(ua.BrowseResponse(Results=[ua.BrowseResult() for _ in range(6)]))
        created = ua.CreateSubscriptionResponse()
        created.Parameters.RevisedPublishingInterval, created.Parameters.RevisedMaxKeepAliveCount = 10.0, 50
        self.answer(created)
        self.answer(ua.CreateMonitoredItemsResponse(Results=[ua.MonitoredItemCreateResult() for _ in range(6)]))
        assert self.asked is ua.PublishRequest
        return self

    def publish(self, number: int, *values: tuple[int, float, float], **more: object) -> list[Item]:
        """Send values (axis, angle, ms after T0)."""
        notes = [
            ua.MonitoredItemNotification(
                axis, ua.DataValue(ua.Variant(angle), SourceTimestamp=T0 + timedelta(milliseconds=ms), **more)
            )
            for axis, angle, ms in values
        ]
        response = ua.PublishResponse()
        data = [ua.DataChangeNotification(MonitoredItems=notes)] if notes else []
        response.Parameters.NotificationMessage = ua.NotificationMessage(number, T0, data)
        return self.answer(response)


def every_axis(ms: float) -> list[tuple[int, float, float]]:
    return [(axis, axis + ms / 10, ms) for axis in range(6)]


def refusal(status: int) -> Any:
    fault = ua.ServiceFault()
    fault.ResponseHeader.ServiceResult = ua.StatusCode(status)
    return fault


def test_several_samples_in_one_message_are_told_apart_by_their_stamps() -> None:
    server = ByHand().subscribed()
    queued = [value for axis in range(6) for value in (every_axis(0)[axis], every_axis(10)[axis])]
    items = server.publish(1, *queued)
    assert [sample.values[0] for sample in samples(items)] == [0.0, 1.0]
    assert samples(items)[1].device_time_s - samples(items)[0].device_time_s == pytest.approx(0.01, abs=1e-6)


def test_a_position_in_two_messages_is_one_and_an_axis_at_rest_stays_where_it_was() -> None:
    server = ByHand().subscribed()
    assert server.publish(1, *every_axis(0)[:4]) == []
    assert len(server.publish(2, *every_axis(0)[4:])) == 1
    assert server.publish(3, (0, 5.0, 10.0)) == [], "more of it may come"
    (sample,) = samples(server.publish(4, (0, 6.0, 20.0)))
    assert sample.values == (5.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    (sample,) = samples(server.publish(5))
    assert sample.values[0] == 6.0, "nothing new: no more of it comes"


def test_missing_messages_and_a_queue_too_short_are_counted() -> None:
    server = ByHand().subscribed()
    server.publish(1, *every_axis(0))
    (fault,) = faults(server.publish(4, *every_axis(10)))
    assert (fault.kind, fault.count) == (FaultKind.SKIPPED, 2)
    overflow = faults(server.publish(5, *every_axis(20), StatusCode=ua.StatusCode(0x480)))
    assert {fault.kind for fault in overflow} == {FaultKind.SKIPPED} and "queue" in overflow[0].detail


def test_stamps_that_lie_apart_are_a_doubt_once() -> None:
    server = ByHand().subscribed()
    staggered = [[(axis, 1.0, ms + axis * 0.5) for axis in range(6)] for ms in (0, 10)]
    items = server.publish(1, *staggered[0]) + server.publish(2, *staggered[1])
    assert [fault.kind for fault in faults(items)] == [FaultKind.DOUBTFUL] and "2.5 ms" in faults(items)[0].detail
    assert samples(items)[0].device_time_s - T0.timestamp() == pytest.approx(0.00125, abs=1e-6)


@pytest.mark.parametrize(
    "odd", [ua.Variant("high"), ua.Variant([1.0, 2.0]), ua.Variant(math.inf), ua.Variant(1e9), None]
)
def test_what_is_no_angle_is_a_fault_and_makes_no_sample(odd: Any) -> None:
    server = ByHand().subscribed()
    note = ua.MonitoredItemNotification(0, ua.DataValue(odd, SourceTimestamp=T0))
    response = ua.PublishResponse()
    others = [ua.MonitoredItemNotification(k, ua.DataValue(ua.Variant(1.0), SourceTimestamp=T0)) for k in range(1, 6)]
    response.Parameters.NotificationMessage = ua.NotificationMessage(
        1, T0, [ua.DataChangeNotification(MonitoredItems=[note, *others])]
    )
    items = server.answer(response)
    assert samples(items) == [] and faults(items)[0].kind in (FaultKind.DEVICE_ERROR, FaultKind.GARBLED)


@pytest.mark.parametrize(
    ("kind", "message", "words"),
    [
        (
            ERROR,
            ua.ErrorMessage(ua.StatusCode(ua.StatusCodes.BadTcpEndpointUrlInvalid), "no"),
            ("`path`", "EndpointUrl"),
        ),
        (MESSAGE, refusal(ua.StatusCodes.BadTooManySessions), ("BadTooManySessions",)),
        (MESSAGE, refusal(ua.StatusCodes.BadSecurityPolicyRejected), ("BadSecurityPolicyRejected",)),
        (MESSAGE, ua.CreateSessionResponse(), ("allow anonymous reading",)),
        (MESSAGE, ua.ReadResponse(), ("CreateSessionResponse is expected",)),
    ],
)
def test_a_refusal_ends_the_link_and_says_why(kind: bytes, message: Any, words: tuple[str, ...]) -> None:
    server = ByHand()
    (fault,) = faults(server.say(kind, message))
    assert server.script.step.hang_up and all(word in fault.detail for word in words), fault.detail


def test_a_refused_subscription_is_no_fault_and_a_lost_one_is() -> None:
    refused = ByHand().in_session()
    refused.answer(ua.BrowseResponse(Results=[ua.BrowseResult() for _ in range(6)]))
    assert refused.asked is ua.CreateSubscriptionRequest
    assert refused.answer(refusal(ua.StatusCodes.BadServiceUnsupported)) == []
    assert refused.asked is ua.ReadRequest and not refused.script.step.hang_up
    lost = ByHand().subscribed()
    assert lost.answer(refusal(ua.StatusCodes.BadTooManyPublishRequests)) == []
    ended = ua.PublishResponse()
    ended.Parameters.NotificationMessage = ua.NotificationMessage(
        1, T0, [ua.StatusChangeNotification(ua.StatusCode(ua.StatusCodes.BadTimeout))]
    )
    (fault,) = faults(lost.say(MESSAGE, ended, lost.requests()[-2][0]))
    assert "BadTimeout" in fault.detail and lost.script.step.hang_up


def test_only_services_that_read_are_asked_for() -> None:
    feedback = opc_ua()
    server = RobotServer(feedback, _standing(feedback))
    sent = bytearray()

    class Noted(RobotServer):
        def received(self, data: bytes, now_ns: int) -> Step:
            sent.extend(data)
            return super().received(data, now_ns)

    server = Noted(feedback, _standing(feedback))
    simulate(daq.feedback.host(feedback), server, S)
    script = ByHand()
    script.script.sent = bytes(sent)
    reading = {
        kind().TypeId.Identifier
        for kind in (
            ua.OpenSecureChannelRequest,
            ua.CreateSessionRequest,
            ua.ActivateSessionRequest,
            ua.BrowseRequest,
            ua.ReadRequest,
            ua.CreateSubscriptionRequest,
            ua.ModifySubscriptionRequest,
            ua.CreateMonitoredItemsRequest,
            ua.PublishRequest,
        )
    }
    assert {type_of(body) for _, body in script.requests()} <= reading
    activation = next(
        decoded(ua.ActivateSessionRequest, body)
        for _, body in script.requests()
        if type_of(body) == ua.ActivateSessionRequest().TypeId.Identifier
    )
    assert activation.Parameters.UserIdentityToken.PolicyId == "anonymous"


# --- pure parts ---


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
def test_the_condition_is_what_is_shown_and_never_assumed(shown: dict[str, Any], expected: tuple[float, float]) -> None:
    found = condition_of(shown)
    assert (found["program_state"], found["safety_state"]) == pytest.approx(expected, nan_ok=True)


def test_numbers_of_the_condition_that_nothing_can_have_are_not_shown() -> None:
    found = condition_of({"SpeedOverride": 1e300, "Mass": "heavy", "InControl": True, "temperature2_c": 41.5})
    assert math.isnan(found["speed_percent"]) and math.isnan(found["payload_kg"])
    assert found["motors_on"] == 1 and found["temperature2_c"] == 41.5


def test_values_without_stamps_are_the_last_of_each_axis() -> None:
    values = [AxisValue(axis, axis + step, math.nan) for axis in range(6) for step in (0.0, 0.5)]
    (position,) = Together(0.005).take(values)
    assert isinstance(position, ArmPosition) and position.angles_deg == (0.5, 1.5, 2.5, 3.5, 4.5, 5.5)
    assert math.isnan(position.clock_s)

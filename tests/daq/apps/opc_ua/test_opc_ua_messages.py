from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="asyncua is not installed: pip install '.[opcua]'")

from asyncua import ua

import daq.feedback
from daq.apps.opc_ua.channel import ACKNOWLEDGE, ERROR, MESSAGE, NO_STAMP, OPEN, Channel, decoded, type_of
from daq.apps.opc_ua.nodes import condition_of
from daq.apps.opc_ua.values import ArmPosition, AxisValue, Together
from daq.protocol.conversation import Fault, FaultKind, Item
from rigs.schema.condition import ProgramState, SafetyState
from tests.support.drivers import NODES, opc_ua
from tests.support.opc_ua_chunks import faults, requests_in, samples
from tests.support.simulated_conversation import Script

T0 = datetime(2026, 11, 21, tzinfo=UTC)


class ByHand:
    """The server's side, one message at a time. `asked` is the request that waits for its answer."""

    def __init__(self, **changes: object) -> None:
        self.script = Script(daq.feedback.host(opc_ua(**{"axes": NODES, "units": "deg", "condition": False} | changes)))
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
        return requests_in(self.script.sent)

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
                axis, ua.DataValue(ua.Variant(angle), **{"SourceTimestamp": T0 + timedelta(milliseconds=ms)} | more)
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


def test_samples_of_one_message_differ_by_their_stamps():
    server = ByHand().subscribed()
    queued = [value for axis in range(6) for value in (every_axis(0)[axis], every_axis(10)[axis])]
    items = server.publish(1, *queued)
    assert [sample.values[0] for sample in samples(items)] == [0.0, 1.0]
    assert samples(items)[1].device_time_s - samples(items)[0].device_time_s == pytest.approx(0.01, abs=1e-6)


def test_resting_axis_keeps_its_value_between_messages():
    server = ByHand().subscribed()
    assert server.publish(1, *every_axis(0)[:4]) == []
    assert len(server.publish(2, *every_axis(0)[4:])) == 1
    assert server.publish(3, (0, 5.0, 10.0)) == []  # more of it may come
    (sample,) = samples(server.publish(4, (0, 6.0, 20.0)))
    assert sample.values == (5.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    (sample,) = samples(server.publish(5))
    assert sample.values[0] == 6.0  # nothing new: no more of it comes


def test_missing_messages_and_a_queue_too_short_are_counted():
    server = ByHand().subscribed()
    server.publish(1, *every_axis(0))
    (fault,) = faults(server.publish(4, *every_axis(10)))
    assert (fault.kind, fault.count) == (FaultKind.SKIPPED, 2)
    overflow = faults(server.publish(5, *every_axis(20), StatusCode=ua.StatusCode(0x480)))
    assert {fault.kind for fault in overflow} == {FaultKind.SKIPPED} and "queue" in overflow[0].detail


def test_invalid_stamp_is_replaced_by_that_of_the_server():
    axes = [(axis, 1.0, 0.0) for axis in range(6)]
    none, own = {"SourceTimestamp": NO_STAMP}, {"ServerTimestamp": T0}
    (sample,) = samples(ByHand().subscribed().publish(1, *axes, **none))
    assert math.isnan(sample.device_time_s)
    (sample,) = samples(ByHand().subscribed().publish(1, *axes, **none, **own))
    assert sample.device_time_s == T0.timestamp()


def test_stamps_that_lie_apart_are_a_doubt_once():
    server = ByHand().subscribed()
    staggered = [[(axis, 1.0, ms + axis * 0.5) for axis in range(6)] for ms in (0, 10)]
    items = server.publish(1, *staggered[0]) + server.publish(2, *staggered[1])
    assert [fault.kind for fault in faults(items)] == [FaultKind.DOUBTFUL] and "2.5 ms" in faults(items)[0].detail
    assert samples(items)[0].device_time_s - T0.timestamp() == pytest.approx(0.00125, abs=1e-6)


@pytest.mark.parametrize(
    "odd", [ua.Variant("high"), ua.Variant(True), ua.Variant([1.0, 2.0]), ua.Variant(math.inf), ua.Variant(1e9), None]
)
def test_invalid_angle_is_a_fault_without_sample(odd):
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
        (MESSAGE, refusal(ua.StatusCodes.BadTooManySessions), ("BadTooManySessions", "clients")),
        (ACKNOWLEDGE, ua.Acknowledge(), ("without a request",)),
        (OPEN, ua.OpenSecureChannelResponse(), ("instead of CreateSessionResponse",)),
        (MESSAGE, refusal(ua.StatusCodes.BadSecurityPolicyRejected), ("BadSecurityPolicyRejected",)),
        (MESSAGE, ua.CreateSessionResponse(), ("anonymous",)),
        (MESSAGE, ua.ReadResponse(), ("instead of CreateSessionResponse",)),
    ],
)
def test_refusal_ends_the_link_with_its_reason(kind, message, words):
    server = ByHand()
    (fault,) = faults(server.say(kind, message))
    assert server.script.step.hang_up and all(word in fault.detail for word in words), fault.detail


def test_paged_browse_results_are_read_completely():
    server = ByHand(axes=None, units=None).in_session()
    device_set = ua.ReferenceDescription(NodeId=ua.NodeId(5, 2), BrowseName=ua.QualifiedName("DeviceSet", 2))
    server.answer(ua.BrowseResponse(Results=[ua.BrowseResult(ContinuationPoint=b"more")]))
    assert type_of(server.requests()[-1][1]) == ua.BrowseNextRequest().TypeId.Identifier
    page = ua.BrowseNextResponse()
    page.Parameters.Results = [ua.BrowseResult(References=[device_set])]
    server.answer(page)
    (_, asked) = server.requests()[-1]
    assert decoded(ua.BrowseRequest, asked).Parameters.NodesToBrowse[0].NodeId == device_set.NodeId


def test_a_server_that_shows_more_nodes_than_robots_have_is_left():
    server = ByHand(axes=None, units=None).in_session()
    shown = [ua.ReferenceDescription(BrowseName=ua.QualifiedName(str(k), 2)) for k in range(4000)]
    faulty: list[Fault] = []
    server.answer(ua.BrowseResponse(Results=[ua.BrowseResult(References=shown, ContinuationPoint=b"more")]))
    for page in range(1, 100):
        for reference in shown:
            object.__setattr__(reference.BrowseName, "Name", f"{reference.BrowseName.Name}.{page}")
        more = ua.BrowseNextResponse()
        more.Parameters.Results = [ua.BrowseResult(References=shown, ContinuationPoint=b"more")]
        if faulty := faults(server.answer(more)):
            break
    assert page == 2 and "12000 candidate nodes" in faulty[0].detail and server.script.step.hang_up


def test_slow_publisher_still_sends_keep_alives():
    server = ByHand(timeout_s=6).in_session()
    server.answer(ua.BrowseResponse(Results=[ua.BrowseResult() for _ in range(6)]))
    created = ua.CreateSubscriptionResponse()
    created.Parameters.RevisedPublishingInterval, created.Parameters.RevisedMaxKeepAliveCount = 1000.0, 200
    server.answer(created)
    changed = decoded(ua.ModifySubscriptionRequest, server.requests()[-1][1]).Parameters
    assert (changed.RequestedPublishingInterval, changed.RequestedMaxKeepAliveCount) == (1000.0, 2)


def test_a_refused_subscription_is_no_fault_and_a_lost_one_is():
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
    assert isinstance(position, ArmPosition) and position.angles_deg == (0.5, 1.5, 2.5, 3.5, 4.5, 5.5)
    assert math.isnan(position.clock_s)

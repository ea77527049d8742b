import struct
import tracemalloc
import uuid
from contextlib import nullcontext
from datetime import UTC, datetime
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="asyncua is not installed: pip install '.[opcua]'")

import math
from dataclasses import replace

import pytest
from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.ua.ua_binary import struct_from_binary, struct_to_binary

from daq.opc_ua.channel import CHUNK, CHUNKS, ELEMENTS, LIMIT, MESSAGE, Channel, Unreadable, decoded
from daq.opc_ua.nodes import condition_of
from daq.opc_ua.values import AxisValue, Together
from rigs.schema.condition import ProgramState, SafetyState
from tests.support.conversation_logs import LOGS

T0 = datetime(2026, 11, 21, 12, 30, tzinfo=UTC)
CLAIMED = 2_000_000
"""Elements that a message claims: of one that believed it, the memory would show it and the test would still end."""
MOST_BYTES = 1 << 20


def variants() -> list[Any]:
    plain = [True, -5, 2**40, 1.5, "text", b"bytes", T0, uuid.UUID(int=7), None]
    kinds = ("SByte", "Byte", "Int16", "UInt16", "UInt32", "UInt64", "Float")
    typed = [ua.Variant(3, ua.VariantType[kind]) for kind in kinds]
    structures = [ua.NodeId("name", 3), ua.QualifiedName("name", 2), ua.LocalizedText("Wert", "de"), ua.StatusCode(5)]
    structures += [ua.EUInformation(UnitId=17476), ua.DataValue(ua.Variant(1.0))]
    arrays = [[1.0, 2.0], ["a", None, ""], [ua.NodeId(5, 2)], [ua.Variant(1), ua.Variant("b")]]
    return [*map(ua.Variant, plain), *typed, *map(ua.Variant, structures), *map(ua.Variant, arrays)]


def read_response(values: list[Any]) -> Any:
    results = [ua.DataValue(value, ua.StatusCode(0x40920000), T0, T0) for value in values]
    return ua.ReadResponse(Results=[*results, ua.DataValue()])


def messages() -> list[Any]:
    reference = ua.ReferenceDescription(
        NodeId=ua.ExpandedNodeId("a", 3), BrowseName=ua.QualifiedName("A1", 2), NodeClass=ua.NodeClass.Variable
    )
    session = ua.CreateSessionResponse()
    policy = ua.UserTokenPolicy(PolicyId="a", TokenType=ua.UserTokenType.UserName)
    session.Parameters.ServerEndpoints = [ua.EndpointDescription("opc.tcp://a", UserIdentityTokens=[policy, policy])]
    publish = ua.PublishResponse()
    notes = [ua.MonitoredItemNotification(k, ua.DataValue(ua.Variant(float(k)))) for k in range(3)]
    publish.Parameters.NotificationMessage = ua.NotificationMessage(
        3, T0, [ua.DataChangeNotification(MonitoredItems=notes), ua.StatusChangeNotification(ua.StatusCode(7))]
    )
    browsed = ua.BrowseResponse(Results=[ua.BrowseResult(References=[reference]), ua.BrowseResult()])
    plain = [ua.OpenSecureChannelResponse(), ua.ServiceFault(), ua.CreateMonitoredItemsResponse(), ua.Acknowledge()]
    return [*plain, browsed, session, publish, read_response(variants())]


@pytest.mark.parametrize("message", messages(), ids=lambda message: type(message).__name__)
def test_a_message_is_read_as_asyncua_reads_it(message):
    body = struct_to_binary(message)
    assert decoded(type(message), body) == struct_from_binary(type(message), Buffer(body))


def test_unknown_structure_stays_bytes():
    unknown = ua.ExtensionObject(ua.NodeId(4711, 5), Body=b"whatever")
    (first, second) = decoded(ua.ReadResponse, struct_to_binary(read_response([ua.Variant(unknown)]))).Results
    assert first.Value.Value.Body == b"whatever" and first.SourceTimestamp == T0 and second.Value == ua.Variant()


def test_additional_fields_of_later_versions_are_skipped():
    body = struct_to_binary(read_response([ua.Variant(ua.EUInformation(UnitId=17476))]))
    inner = struct_to_binary(ua.EUInformation(UnitId=17476))
    longer = body.replace(struct.pack("<i", len(inner)) + inner, struct.pack("<i", len(inner) + 3) + inner + b"new")
    (value, _) = decoded(ua.ReadResponse, longer).Results
    assert value.Value.Value.UnitId == 17476 and value.SourceTimestamp == T0


# --- claims ---

NULL, DOUBLE, TEXT, BYTES, VALUE = 0, 11, 12, 15, 23
ARRAY, MATRIX = 0x80, 0xC0


def i32(*numbers: int) -> bytes:
    return struct.pack(f"<{len(numbers)}i", *numbers)


CLAIMS = {
    "nulls": bytes([ARRAY | NULL]) + i32(CLAIMED),
    "more nulls than bytes": bytes([ARRAY | NULL]) + i32(50_000),
    "texts that take their lengths back": bytes([ARRAY | TEXT]) + i32(CLAIMED, -4),
    "byte strings that take their lengths back": bytes([ARRAY | BYTES]) + i32(CLAIMED, -4),
    "texts of negative length": bytes([ARRAY | TEXT]) + i32(4, -4),
    "numbers": bytes([ARRAY | DOUBLE]) + i32(CLAIMED),
    "numbers that take bytes back": bytes([ARRAY | DOUBLE]) + i32(-3),
    "values": bytes([ARRAY | VALUE]) + i32(CLAIMED) + bytes(20),
    "a matrix": bytes([MATRIX | DOUBLE]) + i32(0, 2, 1000, 1000),
    "the sides of a matrix": bytes([MATRIX | DOUBLE]) + i32(0, CLAIMED),
    "a text": bytes([TEXT]) + i32(CLAIMED),
    "more elements than a message may have": bytes([ARRAY | VALUE]) + i32(ELEMENTS + 1) + bytes(ELEMENTS + 1),
}
HARMLESS = ("numbers that take bytes back", "a matrix")
"""What is read: an array of fewer than no elements as none, and a matrix in one row."""


def claiming(claim: bytes) -> bytes:
    """The answer to a request for values in which one value is this."""
    empty = struct_to_binary(ua.ReadResponse())
    return empty[:-8] + i32(1) + b"\1" + claim + i32(0)


@pytest.mark.parametrize("what", CLAIMS)
def test_claimed_lengths_allocate_no_memory(what):
    body = claiming(CLAIMS[what])
    tracemalloc.start()
    try:
        with nullcontext() if what in HARMLESS else pytest.raises(Unreadable, match="ReadResponse"):
            decoded(ua.ReadResponse, body)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < MOST_BYTES


@pytest.mark.parametrize("where", ["StringTable", "Results", "DiagnosticInfos"])
def test_array_longer_than_its_bytes_is_refused(where):
    body = struct_to_binary(ua.ReadResponse())
    at = len(body) - {"StringTable": 15, "Results": 8, "DiagnosticInfos": 4}[where]
    with pytest.raises(Unreadable, match="array of 2147483647 elements"):
        decoded(ua.ReadResponse, body[:at] + i32(2**31 - 1) + body[at + 4 :])


def test_nested_values_end_with_the_bytes_or_the_depth_limit():
    with pytest.raises(Unreadable):
        decoded(ua.ReadResponse, claiming(bytes([24]) * (LIMIT // 2)))


# --- chunks ---


def chunk(more: bytes, part: bytes, request: int = 1) -> bytes:
    return MESSAGE + more + struct.pack("<IIIII", 24 + len(part), 0, 0, 1, request) + part


def test_long_message_is_sent_in_chunks():
    writer, reader = Channel(), Channel()
    writer.agree(8192)
    message = ua.BrowseRequest()
    message.Parameters.NodesToBrowse = [ua.BrowseDescription(ua.NodeId("x" * 100, 2)) for _ in range(200)]
    sent = writer.packed(MESSAGE, message, 5)
    sizes, rest = list[int](), sent
    while rest:
        sizes.append(int.from_bytes(rest[4:8], "little"))
        rest = rest[sizes[-1] :]
    assert len(sizes) > 2 and max(sizes) == 8192
    pieces = [sent[sum(sizes[:k]) : sum(sizes[: k + 1])] for k in range(len(sizes))]
    *begun, whole = [reader.read(piece) for piece in pieces]
    assert set(begun) == {None} and whole is not None
    assert decoded(ua.BrowseRequest, whole.body).Parameters.NodesToBrowse == message.Parameters.NodesToBrowse


@pytest.mark.parametrize(
    ("pieces", "words"),
    [
        ([chunk(b"C", b"")] * (CHUNKS + 1), f"{CHUNKS} chunks"),
        ([chunk(b"C", bytes(CHUNK - 24))] * (LIMIT // CHUNK + 1), f"{LIMIT} bytes"),
        ([chunk(b"C", b"a"), chunk(b"F", b"b", request=2)], "message 2 inside message 1"),
        ([chunk(b"X", b"a")], "b'X'"),
        ([chunk(b"A", struct_to_binary(ua.ErrorMessage(ua.StatusCode(0x80B90000), "big")))], "BadResponseTooLarge"),
        ([chunk(b"A", b"")], "ErrorMessage"),
        ([chunk(b"F", b"")[:20]], "SequenceHeader"),
    ],
)
def test_chunks_that_make_no_message_are_refused(pieces, words):
    channel = Channel()
    with pytest.raises(Unreadable, match=words):
        for piece in pieces:
            channel.read(piece)


def test_a_message_of_many_chunks_is_read_whole():
    channel = Channel()
    received = [channel.read(chunk(b"C", bytes([k]))) for k in range(CHUNKS - 1)] + [channel.read(chunk(b"F", b"z"))]
    assert received[-1] is not None and received[-1].body == bytes(range(CHUNKS - 1)) + b"z"


def test_a_server_that_shows_more_nodes_than_robots_have_is_left():
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

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU
from wsproto import ConnectionType, WSConnection
from wsproto.events import AcceptConnection

import daq.feedback
import daq.gauges
from daq.protocol.conversation import Conversation
from daq.protocol.framing import LIMIT
from rigs.schema.feedback import carries_signal

# private _data, _rtde, _rtu, _tcp: frames as the conversations of the other tests have them
from tests.daq.protocol.test_conversations import (
    ANGLES,
    BAUMER_REPLY,
    RECIPE,
    STARTED,
    VERSION,
    _data,
    _rtde,
    _rtu,
    _tcp,
)
from tests.daq.protocol.test_datagrams import EGM, PACKED, ROB, egm_robot, rob, status
from tests.daq.protocol.test_gauge_conversations import value
from tests.support.drivers import (
    FEEDBACKS,
    GAUGES,
    OPC_UA,
    PANDA,
    TCP,
    gauge,
    joint_states,
    keyence,
    lines,
    modbus,
    opc_ua,
    rtde,
    sylvac,
)
from tests.support.nightly import examples
from tests.support.replies import POLLED
from tests.support.simulated_conversation import S, Script, asked, held

HELD_MAX = 3 * LIMIT
HELD_BY = {"joint states": 16 * 1024, "opc ua": 65_536 + HELD_MAX}
"""As much of an HTTP header as h11 keeps; a chunk of OPC UA."""


def _polled(*gauges: Any) -> Callable[[], Script]:
    return lambda: asked(daq.gauges.host(gauges))


def _listening(feedback: Any) -> Callable[[], Script]:
    return lambda: Script(daq.feedback.host(feedback))


def _opened(feedback: Any) -> Script:
    server = WSConnection(ConnectionType.SERVER)
    script = Script(daq.feedback.host(feedback))
    server.receive_data(script.sent)
    assert list(server.events())
    script.receive(server.send(AcceptConnection()))
    script.sent = b""
    return script


def _frame(payload: bytes, kind: int = 0x81) -> bytes:
    """A message of a WebSocket server (RFC 6455, 5.2), of up to 65535 bytes: text, unless it is of another kind."""
    size = len(payload)
    return bytes([kind, size]) + payload if size < 126 else bytes([kind, 126]) + size.to_bytes(2, "big") + payload


PUBLISHED = (
    b'{"op":"publish","topic":"/joint_states","msg":{"header":{"stamp":{"sec":1,"nanosec":2}},"name":['
    + b",".join(b'"%s"' % name.encode() for name in PANDA)
    + b'],"position":[1,2,3,1,2,3]}}'
)
ENDLESS = b"x" * (2 * LIMIT + 17)
# host, replies to choose from, how many make one stream
STREAMS: dict[str, tuple[Callable[[], Script], Sequence[bytes], int]] = {
    "sylvac": (_polled(sylvac()), [b"+1.234\r", b"ERR0\r", b"SY\r", b"?!\r", ENDLESS + b"\r", b"+1"], 1),
    "sylvac continuous": (
        lambda: Script(daq.gauges.host([sylvac(mode="continuous")])),
        [b"+1.234\r", b"-7.0<\r", b"ERR0\r", b"SY\r", b"?!\r", ENDLESS],
        8,
    ),
    "keyence": (
        _polled(keyence(), keyence(channel=2)),
        [b"M0,+00.001,-00.002\r\n", b"M0,+00.001\r\n", b"ER,M0,20\r\n", b"??\r\n", ENDLESS + b"\r\n", b"M0\r"],
        1,
    ),
    "rtu": (_polled(modbus()), [BAUMER_REPLY, _rtu(1, 0x84, 2), BAUMER_REPLY[:-1] + b"?", ENDLESS, b"\1"], 1),
    "tcp": (
        _polled(modbus(port=TCP)),
        [
            _tcp(1, *BAUMER_REPLY[:-2]),
            _tcp(1, 1, 0x84, 2),
            _tcp(9, 1, 0x84, 2) + _tcp(1, *BAUMER_REPLY[:-2]),
            ENDLESS,
        ],
        1,
    ),
    "rtde": (
        _listening(rtde()),
        [
            VERSION + RECIPE + STARTED + _data(1, *ANGLES) + _data(1.002, *ANGLES) + _data(1.01, *ANGLES),
            _rtde(b"M", b"\1a\1b\1"),
            VERSION + _rtde(b"O", b"\0DOUBLE,IN_USE"),
            ENDLESS,
        ],
        3,
    ),
    **{
        name: (case.begun, [*case.replies, ENDLESS], 1) for name, case in POLLED.items() if case.gauges[0].units == "mm"
    },
    "ild1420": (
        lambda: Script(daq.gauges.host([gauge("micro_epsilon_ild1420")])),
        [value(2000) + value(3000), value(4000, further=True), b"E05\r\n->", value(10) + value(262076), ENDLESS],
        8,
    ),
    "modbus ascii": (
        _polled(modbus(framing="ascii")),
        [b":" + BAUMER_REPLY[:-2].hex().upper().encode() + b"D0\r\n", b":0184027A\r\n", b":01\r\n", ENDLESS + b"\r\n"],
        1,
    ),
    "joint states": (
        lambda: _opened(joint_states()),
        [_frame(PUBLISHED), _frame(b"{"), _frame(b"there?", 0x8A), _frame(b"\xff"), _frame(b"", 0x8F)],
        4,
    ),
    "lines": (_listening(lines()), [b"1,2,3,4,5,6,7\n", b"1,2\r\n", b"a,b,c,d,e,f,g\n", b"\n", ENDLESS], 8),
}

if OPC_UA:
    from tests.support.opc_ua_chunks import ENDED, OPENED, REFUSED, UNREADABLE

    STREAMS["opc ua"] = (
        _listening(opc_ua()),
        [OPENED + REFUSED, OPENED + UNREADABLE, ENDED, OPENED + ENDLESS, ENDLESS],
        2,
    )


def _cut(data: bytes, cuts: Sequence[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[a:b] for a, b in pairwise(edges) if a < b]


def _outcome(begin: Callable[[], Script], pieces: Sequence[bytes]) -> tuple[bytes, list[object], bool]:
    script = begin()
    now_ns = script.now_ns + S // 10
    for piece in pieces:
        script.receive(piece, now_ns)
    hung_up = script.step.hang_up
    for _ in range(3):
        if script.step.wake_ns is not None:
            script.wake()
    return script.sent, list(script.items), hung_up


@pytest.mark.parametrize("name", STREAMS)
@examples(15, 40)
def test_the_cut_makes_no_difference(name, examples):
    @settings(max_examples=examples)
    @given(data=st.data())
    def holds(data: st.DataObject) -> None:
        begin, replies, most = STREAMS[name]
        stream = b"".join(data.draw(st.lists(st.sampled_from(replies), min_size=1, max_size=most)))
        cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=12))
        whole = _outcome(begin, [stream])
        assert whole[1]  # a stream that tells nothing tests nothing
        assert _outcome(begin, _cut(stream, cuts)) == whole
        assert _outcome(begin, [stream[k : k + 1] for k in range(len(stream))]) == whole

    holds()


def _sides() -> dict[str, tuple[Callable[[], Conversation], list[bytes]]]:
    sides: dict[str, tuple[Callable[[], Conversation], list[bytes]]] = {}
    replies = [reply for _, choices, _ in STREAMS.values() for reply in choices if len(reply) < LIMIT]
    replies += [EGM, PACKED, ROB, egm_robot(8), rob(123645634567), status(1), status(2)]
    requests = [case.request for case in POLLED.values()]
    requests += [
        b"OUTPUT RS422\n",
        b":01031F42000299\r\n",
        b"?\r",
        b"OUT1\r",
        b"M0\r\n",
        _rtu(1, 4, 0, 200, 0, 13),
        _tcp(1, 1, 4, 0, 200, 0, 13),
    ]
    rates = (500.0, 1e-300, float("inf"), float("nan"), -1.0)
    recipes = [_rtde(b"O", struct.pack(">d", rate) + b"timestamp,actual_q") for rate in rates]
    requests += [*recipes, _rtde(b"V", b"\0\2"), _rtde(b"S"), _rtde(b"P"), _rtde(b"O"), _rtde(b"M")]
    requests += [b'<Sen Type="ImFree"><IPOC>4208000</IPOC></Sen>', b"\0\0\0\0\0\0\0\1", b"\0\0\0\2\0\0\0\1"]
    for name, gauges, _ in GAUGES:
        if gauges[0].units != "mm":
            continue  # the same bytes, times a factor
        sides[f"{name} host"] = (lambda gauges=gauges: daq.gauges.host(gauges)), replies
        sides[f"{name} device"] = (
            (lambda gauges=gauges: daq.gauges.device(gauges, lambda now_ns: [1e6] * len(gauges))),
            requests,
        )
    for name, feedback in FEEDBACKS:
        sides[f"{name} host"] = (lambda feedback=feedback: daq.feedback.host(feedback)), replies
        sides[f"{name} device"] = (
            (
                lambda feedback=feedback: daq.feedback.device(
                    feedback, lambda now_ns: [1.0] * (6 + carries_signal(feedback))
                )
            ),
            requests,
        )
    return sides


SIDES = _sides()


@st.composite
def _mutated(draw: st.DrawFn, good: Sequence[bytes]) -> bytes:
    data = bytearray(draw(st.sampled_from(good)))
    for _ in range(draw(st.integers(0, 3))):
        if data:
            data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    return bytes(data)


@pytest.mark.parametrize("name", SIDES)
@examples(8, 25)
def test_no_bytes_raise_or_fill_the_memory(name, examples):
    @settings(max_examples=examples)
    @given(data=st.data())
    def holds(data: st.DataObject) -> None:
        begin, good = SIDES[name]
        held_max = next((most for kind, most in HELD_BY.items() if kind in name), HELD_MAX)
        conversation = begin()
        conversation.connected(0)
        now_ns = S  # a polled host has listened long enough to ask
        step = conversation.tick(now_ns)
        pieces = data.draw(st.lists(st.binary(max_size=300) | _mutated(good), max_size=25))
        for piece in pieces:
            now_ns += data.draw(st.sampled_from([0, 1000, S // 5, 2 * S]))
            if step.wake_ns is not None and step.wake_ns <= now_ns:
                step = conversation.tick(now_ns)
            step = conversation.received(piece, now_ns)
            assert held(conversation) <= held_max
        for byte in (b"\0", b"+", b"\xff", b"1,"):
            conversation.received(byte * 2 * LIMIT, now_ns)
            assert held(conversation) <= held_max

    holds()


@pytest.mark.parametrize("port", ["/dev/ttyS0", TCP])
def test_modbus_gauge_survives_every_function(port):
    device = daq.gauges.device([modbus(port=port)], lambda now_ns: [1.0])
    for function in range(256):
        for filler in (0, 1, 200, 255):
            body = bytes([1, function, filler, filler, filler, filler])
            number = FramerRTU.compute_CRC(body).to_bytes(2, "big")
            device.received(_tcp(1, *body) if port == TCP else body + number, 0)
    request = _tcp(1, 1, 4, 0, 202, 0, 2) if port == TCP else _rtu(1, 4, 0, 202, 0, 2)
    assert device.received(request, 0).send

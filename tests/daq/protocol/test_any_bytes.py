from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wsproto import ConnectionType, WSConnection
from wsproto.events import AcceptConnection

import daq.feedback
import daq.gauges
from daq.protocol.framing import LIMIT

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
from tests.daq.protocol.test_gauge_conversations import value
from tests.support.drivers import (
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
from tests.support.simulated_conversation import S, Script, asked

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

"""ROS 2 joint states: messages as rosbridge writes them, the WebSocket below, and the websockets library as a peer."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from wsproto import ConnectionType, WSConnection
from wsproto.events import AcceptConnection, CloseConnection, Event, Ping, Pong, RejectConnection, TextMessage

import daq.feedback
from daq.protocol.conversation import Fault, FaultKind, Item, Sample
from daq.protocol.websocket import LIMIT
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import open_link
from rigs.schema.links import Line
from tests.support.drivers import PANDA, joint_states
from tests.support.simulated_conversation import S, Script

HALVES = [axis / 2 for axis in range(1, 7)]
SUBSCRIBED = {"op": "subscribe", "topic": "/joint_states", "type": "sensor_msgs/msg/JointState"}


def published(sec: int = 7, nanosec: int = 250_000_000, **changes: object) -> str:
    header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}
    state = {"header": header, "name": list(PANDA), "position": HALVES, "velocity": [], "effort": []}
    return json.dumps({"op": "publish", "topic": "/joint_states", "msg": state | changes})


class Server:
    def __init__(self, **changes: object) -> None:
        self.script = Script(daq.feedback.host(joint_states(**changes)))
        self.socket = WSConnection(ConnectionType.SERVER)
        assert len(self.heard()) == 1
        self.say(AcceptConnection())

    def heard(self) -> list[Event]:
        sent, self.script.sent = self.script.sent, b""
        self.socket.receive_data(sent)
        return list(self.socket.events())

    def say(self, *events: Event) -> list[Item]:
        self.script.receive(b"".join(map(self.socket.send, events)))
        return self.script.taken()

    def text(self, *texts: str) -> list[Item]:
        return self.say(*map(TextMessage, texts))


def fault(items: list[Item], kind: FaultKind, *words: str) -> None:
    (one,) = items
    assert isinstance(one, Fault) and one.kind is kind
    assert all(word in one.detail for word in words), one.detail


def test_it_subscribes_and_sends_nothing_else():
    server = Server()
    (asked,) = server.heard()
    assert isinstance(asked, TextMessage) and json.loads(asked.data) == SUBSCRIBED
    server.text(published(), published(8))
    assert server.heard() == []


def test_joints_are_read_by_name_and_the_stamp_is_the_clock():
    mixed = {"name": ["hand", *reversed(PANDA)], "position": [9.0, *reversed(HALVES)]}
    (sample,) = Server().text(published(**mixed))
    assert isinstance(sample, Sample) and sample.device_time_s == 7.25
    assert sample.values == pytest.approx([math.degrees(angle) for angle in HALVES])


def test_a_message_in_pieces_and_two_in_one():
    server = Server()
    data = server.socket.send(TextMessage(published(), message_finished=True))
    for byte in data:
        server.script.receive(bytes([byte]))
    assert len(server.script.taken()) == 1
    assert len(server.text(published(8), published(9))) == 2


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        (published(name=["a"], position=[0.0]), FaultKind.MISSING, ("panda_joint1", "available: a", "`joints`")),
        (published(position=HALVES[:5]), FaultKind.MISSING, ("panda_joint6",)),
        (published(position=[None, *HALVES[1:]]), FaultKind.MISSING, ("panda_joint1",)),
        (published(position=[1e9, *HALVES[1:]]), FaultKind.GARBLED, ("angles",)),
        (published(position="no"), FaultKind.GARBLED, ("valid array",)),
        (published(position=["0.5", *HALVES[1:]]), FaultKind.GARBLED, ("valid number",)),
        (published(10**400), FaultKind.GARBLED, ("less than",)),
        (published(-1), FaultKind.GARBLED, ("greater than",)),
        ("{", FaultKind.GARBLED, ("JSON",)),
        ("[" * 5000, FaultKind.GARBLED, ("not a joint state",)),
        ('{"op": "fragment", "data": ""}', FaultKind.GARBLED, ("not a joint state",)),
        ('{"op": "status", "level": "error", "msg": "no type"}', FaultKind.DEVICE_ERROR, ("rosbridge: no type",)),
    ],
)
def test_invalid_joint_state_is_a_fault(text, kind, words):
    server = Server()
    fault(server.text(text), kind, *words)
    assert len(server.text(published())) == 1  # and the next is read


def test_a_hand_that_publishes_on_the_same_topic_does_no_harm():
    server = Server()
    hand = published(9, name=["finger"], position=[0.01])
    assert [type(item) for item in server.text(published(), hand, published(8), hand)] == [Sample, Sample]


def test_repeated_message_counts_once_and_a_simulation_may_restart():
    server = Server()
    items = server.text(published(50), published(50), published(49, 900_000_000), published(51), published(1))
    assert [getattr(item, "kind", None) for item in items] == [None, FaultKind.LATE, FaultKind.LATE, None, None]


def test_a_driver_that_leaves_the_stamp_empty_has_no_clock():
    samples = Server().text(published(0, 0), published(0, 0))
    assert len(samples) == 2 and all(isinstance(one, Sample) and math.isnan(one.device_time_s) for one in samples)


def test_pings_are_answered():
    server = Server()
    server.heard()
    assert server.say(Ping(b"there?")) == []
    assert server.heard() == [Pong(b"there?")]


def test_a_server_that_closes_or_refuses_ends_the_link():
    server = Server()
    fault(server.say(CloseConnection(1001, "going away")), FaultKind.DEVICE_ERROR, "1001 going away")
    assert server.script.step.hang_up
    refusing = WSConnection(ConnectionType.SERVER)
    script = Script(daq.feedback.host(joint_states()))
    refusing.receive_data(script.sent)
    list(refusing.events())
    script.receive(refusing.send(RejectConnection(status_code=403)))
    fault(script.taken(), FaultKind.DEVICE_ERROR, "403")
    assert script.step.hang_up


@pytest.mark.parametrize(
    "answer", [b"MODBUS\r\n\r\n", b"HTTP/1.1 200 OK\r\n\r\n<html>", b"HTTP/1.1 101 \xff\r\nUpgrade: \xff\r\n\r\n"]
)
def test_another_server_is_not_taken_for_one(answer):
    script = Script(daq.feedback.host(joint_states()))
    script.receive(answer)
    assert script.step.hang_up and len(script.taken()) == 1


def test_a_server_that_does_not_answer_is_left_after_the_timeout():
    script = Script(daq.feedback.host(joint_states(timeout_s=2)))
    script.wake()
    fault(script.taken(), FaultKind.SILENT, "2 s", "WebSocket")
    assert script.step.hang_up and script.now_ns == 2 * S


def test_a_topic_without_a_publisher_is_silent_once_per_timeout():
    server = Server(topic="/arm/joint_states")
    server.script.wake()
    server.script.wake()
    items = server.script.taken()
    assert [item.kind for item in items if isinstance(item, Fault)] == [FaultKind.SILENT] * 2
    assert isinstance(items[0], Fault) and "/arm/joint_states" in items[0].detail and not server.script.step.hang_up


def test_a_message_without_end_ends_the_link():
    server = Server()
    items = server.say(*[TextMessage("x" * 1000, message_finished=False)] * (LIMIT // 1000 + 1))
    fault(items, FaultKind.GARBLED, str(LIMIT))
    assert server.script.step.hang_up


# --- the websockets library, which shares nothing with wsproto ---


@contextmanager
def _served(handler: Callable[[Any], None]) -> Iterator[str]:
    server = pytest.importorskip("websockets.sync.server")
    with server.serve(handler, "127.0.0.1", 0) as serving:
        thread = threading.Thread(target=serving.serve_forever)
        thread.start()
        yield f"tcp://127.0.0.1:{serving.socket.getsockname()[1]}"
        serving.shutdown()
        thread.join()


def test_our_host_reads_a_server_of_the_websockets_library():
    asked, items = [], list[Item]()

    def handler(connection: Any) -> None:
        asked.append(json.loads(connection.recv()))
        for sec in range(1, 51):
            connection.send(published(sec))
            connection.ping()
        connection.send(iter((published(51)[:40], published(51)[40:])))  # fragmented
        connection.recv(timeout=5)

    with _served(handler) as port:
        feedback = joint_states(port=port)
        link = open_link("robot", port, Line(baud=9600, bits=8, parity="N", stop=1))
        try:
            run_conversation(link, daq.feedback.host(feedback), items.extend, lambda: len(items) >= 51)
        finally:
            link.close()
    assert asked == [SUBSCRIBED]
    assert [item.device_time_s for item in items if isinstance(item, Sample)] == [sec + 0.25 for sec in range(1, 52)]

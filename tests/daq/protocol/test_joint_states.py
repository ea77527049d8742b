import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from wsproto import ConnectionType, WSConnection
from wsproto.events import AcceptConnection, TextMessage

import daq.feedback
from daq.acquisition.stream_buffer import samples_of
from daq.protocol.conversation import FaultKind, Item
from daq.protocol.websocket import LIMIT
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import open_link
from rigs.schema.links import Line
from tests.support.drivers import PANDA, joint_states
from tests.support.simulated_conversation import Script

HALVES = [axis / 2 for axis in range(1, 7)]
SUBSCRIBED = {"op": "subscribe", "topic": "/joint_states", "type": "sensor_msgs/msg/JointState"}


def published(sec: int = 7, **changes: object) -> str:
    header = {"stamp": {"sec": sec, "nanosec": 250_000_000}, "frame_id": ""}
    state = {"header": header, "name": list(PANDA), "position": HALVES, "velocity": [], "effort": []}
    return json.dumps({"op": "publish", "topic": "/joint_states", "msg": state | changes})


def test_a_message_without_end_ends_the_link():
    server, script = WSConnection(ConnectionType.SERVER), Script(daq.feedback.host(joint_states()))
    server.receive_data(script.sent)
    assert len(list(server.events())) == 1
    pieces = [TextMessage("x" * 1000, message_finished=False)] * (LIMIT // 1000 + 1)
    script.receive(b"".join(map(server.send, [AcceptConnection(), *pieces])))
    (fault,) = script.taken()
    assert fault.kind is FaultKind.GARBLED and str(LIMIT) in fault.detail
    assert script.step.hang_up


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
    assert [item.device_time_s for item in samples_of(items)] == [sec + 0.25 for sec in range(1, 52)]

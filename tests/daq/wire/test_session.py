import time
from collections.abc import Sequence

import pytest

from daq.protocol.conversation import NO_TIME, Arrival, ConversationStep, Item, Sample
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import LinkLost


class Pieces:
    def __init__(self, *pieces: bytes) -> None:
        self.pieces = list(pieces)

    def read(self, timeout_s: float) -> bytes:
        if not self.pieces:
            raise LinkLost("unplugged")
        return self.pieces.pop(0)

    def write(self, data: bytes) -> None: ...


class Gathered:
    """A conversation that gathers for a minute, of which each byte is a reading."""

    gather_ns = 60 * 10**9

    def __init__(self) -> None:
        self.calls: list[Sequence[Arrival]] = []

    def connected(self, now_ns: int) -> ConversationStep:
        return ConversationStep()

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        raise AssertionError("it gathers")

    def received_all(self, arrivals: Sequence[Arrival]) -> ConversationStep:
        self.calls.append(arrivals)
        samples = [Sample((float(byte),), NO_TIME, at_ns, at_ns, 1) for data, at_ns in arrivals for byte in data]
        return ConversationStep(items=tuple(samples), wake_ns=0)

    def tick(self, now_ns: int) -> ConversationStep:
        return ConversationStep(wake_ns=0)


def _run(conversation: Gathered, link: Pieces) -> list[Item]:
    delivered: list[Item] = []
    with pytest.raises(LinkLost, match="unplugged"):
        run_conversation(link, conversation, delivered.extend, lambda: False)
    return delivered


def test_pending_bytes_of_a_lost_link_are_delivered_with_their_stamps():
    conversation, before_ns = Gathered(), time.monotonic_ns()
    delivered = _run(conversation, Pieces(b"\1\2", b"", b"\3", b"\4"))
    assert [item.values[0] for item in delivered if isinstance(item, Sample)] == [1, 2, 3, 4]
    (arrivals,) = conversation.calls
    stamps_ns = [at_ns for _, at_ns in arrivals]
    assert len(stamps_ns) == 3 and before_ns < stamps_ns[0] <= stamps_ns[1] <= stamps_ns[2] <= time.monotonic_ns()


def test_a_gathering_ends_after_as_many_bytes_as_one_read_brings():
    conversation = Gathered()
    _run(conversation, Pieces(*[bytes(10_000)] * 14))
    assert [sum(len(data) for data, _ in arrivals) for arrivals in conversation.calls] == [70_000, 70_000]


def test_a_gathering_ends_after_its_time():
    conversation = Gathered()
    conversation.gather_ns = 0
    assert len(_run(conversation, Pieces(b"\1", b"\2", b"\3"))) == 3
    assert [len(arrivals) for arrivals in conversation.calls] == [1, 1, 1]

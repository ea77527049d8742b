import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq import feedback, gauges
from daq.acquisition.stream_buffer import faults_of, samples_of, size_of
from daq.protocol.conversation import (
    NO_SAMPLES,
    NO_TIME,
    Arrival,
    Fault,
    FaultKind,
    Item,
    Sample,
    SampleBlock,
    packed,
)
from rigs.schema.feedback import URRTDE
from rigs.schema.gauges import MicroEpsilonILD1420

GAUGE = MicroEpsilonILD1420.model_validate(
    {"interface": "micro_epsilon_ild1420", "port": "/dev/x", "range_mm": 10, "offset_mm": 25, "accuracy_mm": 0.01}
)
MANY = [Sample((k / 7, k / 3), NO_TIME, 10 * k, 10 * k + 3, 3, k / 11, k % 2) for k in range(20)]
FAULT = Fault(FaultKind.SILENT, 1, "nothing")


def test_a_block_holds_the_samples_that_it_is_made_of():
    block = SampleBlock.of(MANY)
    assert list(block) == MANY and len(block) == 20 and block[3] == MANY[3] and block[-1] == MANY[-1]
    assert list(block[5:9]) == MANY[5:9] and list(block.chosen(block.status == 1)) == MANY[1::2]
    assert list(SampleBlock.joined([block[:4], NO_SAMPLES, block[4:]])) == MANY
    assert not len(SampleBlock.of([])) and not len(SampleBlock.joined([])) and list(NO_SAMPLES) == []


def test_packing_keeps_the_order_and_every_sample():
    items: list[Item] = [FAULT, *MANY[:3], SampleBlock.of(MANY[3:9]), FAULT, FAULT, *MANY[9:]]
    found = packed(items)
    assert [size_of(item) for item in found] == [1, 3, 6, 1, 1, 11] and found[0] is FAULT
    assert list(samples_of(items)) == MANY and faults_of(items) == [FAULT] * 3


def _value(code: int) -> bytes:
    return bytes(tag << 6 | code >> 6 * tag & 0x3F for tag in range(3))


PIECES = st.lists(
    st.one_of(
        st.integers(643, 64_877).map(_value),
        st.lists(st.integers(643, 64_877).map(_value), max_size=30).map(b"".join),
        st.sampled_from([_value(12), _value(70_000), _value(262_076), b"OUTPUT RS422\r\n->"]),
        st.binary(min_size=1, max_size=4),
        st.integers(643, 64_877).map(lambda code: _value(code)[:2] + bytes([_value(code)[2] | 0xC0])),
    ),
    max_size=25,
).map(b"".join)


def _cut(data: bytes, cuts: list[int]) -> list[Arrival]:
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    pieces = (data[begin:end] for begin, end in pairwise(places))
    return [(piece, 1_000_000 * number) for number, piece in enumerate(filter(None, pieces), 1)]


@given(PIECES, st.lists(st.integers(0, 10_000), max_size=12), st.integers(1, 6))
def test_array_reader_equals_message_reader(data, cuts, at_once):
    arrivals = _cut(b"\x80" + data, cuts)
    single, gathering = gauges.host([GAUGE]), gauges.host([GAUGE])
    for conversation in (single, gathering):
        conversation.connected(0)
    one_by_one = [item for piece, at_ns in arrivals for item in single.received(piece, at_ns).items]
    gathered = [
        item
        for first in range(0, len(arrivals), at_once)
        for item in gathering.received_all(arrivals[first : first + at_once]).items
    ]
    assert _plain(gathered) == _plain(one_by_one)
    assert single.handle_link_loss(10**9) == gathering.handle_link_loss(10**9)


def _plain(items: list[Item]) -> list[object]:
    """All items, single and comparable: nan is never equal to itself."""
    singles = [single for item in items for single in (item if isinstance(item, SampleBlock) else [item])]
    assert all(isinstance(one, Fault) or math.isnan(one.device_time_s) for one in singles)
    return [one if isinstance(one, Fault) else (one.values, one.first_byte_ns, one.last_byte_ns) for one in singles]


@pytest.mark.parametrize("begin", [b"", b"OUTPUT RS422\r\n->"])
@pytest.mark.parametrize("damage", [b"", b"\xff", b"\x00"])
def test_arrays_are_used_again_once_a_stream_is_in_step(begin, damage):
    conversation = gauges.host([GAUGE])
    conversation.connected(0)
    values = begin + _value(1000) * 5000 + damage + _value(1000) * 5000
    items = conversation.received_all([(values, 1)]).items
    singly = [item for item in items if isinstance(item, Sample)]
    assert len(samples_of(items)) >= 9995 and len(singly) < 100


@given(st.lists(st.integers(0, 10_000), max_size=12), st.integers(1, 6))
def test_packets_of_a_controller_decoded_together_are_the_same_samples(cuts, at_once):
    robot = URRTDE.model_validate({"interface": "ur_rtde", "port": "tcp://127.0.0.1:1", "condition": False})
    device = feedback.device(robot, lambda _: (0.0,) * 6)
    device.connected(0)
    single, gathering = feedback.host(robot), feedback.host(robot)
    question, sent, now_ns = single.connected(0).send, b"", 0
    gathering.connected(0)
    asked = feedback.host(robot)
    asked.connected(0)
    while question:  # the handshake
        answer = device.received(question, now_ns).send
        sent, question = sent + answer, asked.received(answer, now_ns).send
    for now_ns in range(0, 100_000_000, 2_000_000):
        sent += device.tick(now_ns).send
    arrivals = _cut(sent, cuts)
    one_by_one = [single.received(piece, at_ns) for piece, at_ns in arrivals]
    together = [gathering.received_all(arrivals[at : at + at_once]) for at in range(0, len(arrivals), at_once)]
    for name in ("items", "send"):
        joined = [[part for step in steps for part in getattr(step, name)] for steps in (one_by_one, together)]
        assert joined[0] == joined[1] and joined[0]

import json
import math
from itertools import pairwise
from typing import Any

import pytest

from daq.acquisition.stream_buffer import StreamBuffer
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample, SampleBlock
from daq.service.answers import LONGEST_ANSWER, read_answer
from daq.service.daemon import MOST, recent_samples
from tests.support.refusals import refused


def delivered(count: int, *values: float) -> StreamBuffer:
    buffer = StreamBuffer("g1", ("g1_mm",) * max(1, len(values)))
    for k in range(1, count + 1):
        buffer.deliver([Sample(values or (float(k),), NO_TIME, k, k, 8)])
    return buffer


def asked(buffer: StreamBuffer, after: int = 0) -> dict[str, Any]:
    answer = recent_samples({"command": "samples", "after": {"g1": after}}, {"g1": buffer}, "name: x\n")
    return dict(answer["streams"]["g1"])


def numbers(stream: dict[str, Any]) -> list[float]:
    return [row[1] for row in stream["rows"]]


def test_each_sample_comes_once():
    buffer = delivered(5)
    assert numbers(asked(buffer)) == [1, 2, 3, 4, 5] and asked(buffer)["newest"] == 5
    assert numbers(asked(buffer, 3)) == [4, 5] and numbers(asked(buffer, 5)) == []


def test_recorded_samples_remain_visible():
    buffer = delivered(5)
    buffer.drain()
    assert len(numbers(asked(buffer))) == 5


def test_many_are_thinned_evenly_to_the_newest():
    found = numbers(asked(delivered(990)))
    assert len(found) <= MOST and found[-1] == 990
    assert len({b - a for a, b in pairwise(found)}) == 1
    assert len(numbers(asked(delivered(5000)))) <= MOST


def test_blocks_are_cut_at_the_client_and_bounded():
    buffer = StreamBuffer("g1", ("g1_mm",))
    for first in range(0, 4800, 240):
        block = [Sample((float(k),), NO_TIME, k, k, 3) for k in range(first + 1, first + 241)]
        buffer.deliver([SampleBlock.of(block)])
    assert numbers(asked(buffer, 4790)) == list(range(4791, 4801))
    newest, kept = buffer.recent(0)
    assert newest == 4800 and [kept[0].values, kept[-1].values] == [(3601.0,), (4800.0,)]


def test_client_of_an_earlier_daemon_gets_nothing_until_it_asks_again():
    assert numbers(asked(delivered(5), 4000)) == []


def test_a_fault_is_no_sample():
    buffer = delivered(2)
    buffer.deliver([Fault(FaultKind.SILENT, 3, "nothing")])
    assert asked(buffer)["newest"] == 2 and len(numbers(asked(buffer))) == 2


def test_no_answer_is_longer_than_a_client_takes():
    buffers = {f"s{k}": delivered(1000, *[-math.pi * 1e5] * 7, math.nan, math.inf) for k in range(3)}
    answer = recent_samples({"command": "samples", "rig": True}, buffers, "x: 1\n" * 300_000)
    assert answer["rig_lines"] == [] and len(json.dumps(answer)) < LONGEST_ANSWER / 20
    assert read_answer("samples", json.dumps({"ok": True, **answer}).encode())["streams"].keys() == buffers.keys()
    assert answer["streams"]["s0"]["rows"][0][-2:] == [None, None]


@pytest.mark.parametrize(
    "request_", [{"after": 3}, {"after": {"g1": -1}}, {"after": {"g1": "x"}}, {"rig": "maybe"}, {"more": 1}]
)
def test_a_wrong_request_is_refused_in_one_line(request_):
    with refused("request.invalid", "invalid samples request"):
        recent_samples({"command": "samples", **request_}, {}, "")

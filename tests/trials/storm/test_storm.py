"""The daemon comes through a storm of faults in simulated time, and one with a bug does not."""

from collections.abc import Sequence
from typing import Any

import pytest

from daq.acquisition.reader import StreamReader
from daq.acquisition.stream_buffer import StreamBuffer
from daq.protocol.conversation import FaultKind, Item
from tests.support.nightly import cases
from tests.trials.storm.storm import weather


@pytest.mark.parametrize("seed", cases((0, 2, 5), (0, 2)))
def test_the_daemon_comes_through_the_storm_the_same_each_time(seed):
    told = weather(seed)
    assert told.violations == [], f"scripts/dev storm --seed {seed}"
    assert told.rows and told.blows
    if seed == 2:
        again = weather(seed)
        same = [(one.rows, one.blows, one.faults, one.seconds) for one in (told, again)]
        assert same[0] == same[1]


def test_storm_finds_samples_lost_after_an_outage(monkeypatch):
    deliver = StreamReader._deliver  # private: the bug is planted there

    def without_first_samples(self: StreamReader, items: Sequence[Item]) -> None:
        was_out = self._lost_ns is not None
        deliver(self, items)
        if was_out and self._lost_ns is None:
            self._buffer.drain()

    monkeypatch.setattr(StreamReader, "_deliver", without_first_samples)
    assert weather(0).violations


@pytest.mark.nightly
def test_storm_finds_uncounted_overflow(monkeypatch):
    drain = StreamBuffer.drain

    def without_count(self: StreamBuffer) -> Any:
        self._without_room.pop(FaultKind.DROPPED, None)  # private: the bug is planted there
        return drain(self)

    monkeypatch.setattr(StreamBuffer, "drain", without_count)
    assert weather(5).violations

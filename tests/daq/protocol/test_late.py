from collections import deque

import pytest

import daq.gauges
from daq.acquisition.stream_buffer import samples_of
from daq.protocol.conversation import ConversationStep, Device, FaultKind
from daq.protocol.framing import Message
from daq.protocol.modbus import Resync, RtuRequests
from daq.protocol.polled import STIR_EVERY_NS, Polled
from tests.support.drivers import TCP, modbus
from tests.support.lateness import TIMEOUT_S, Numbered, polled, simulated
from tests.support.simulated_conversation import S, simulate

CASES = polled()
RTU = modbus(timeout_s=TIMEOUT_S)


@pytest.mark.parametrize("name", CASES)
def test_each_value_belongs_to_its_own_request(name):
    requests = 3_000 if name == next(iter(CASES)) else 300
    late = simulated(CASES[name], requests, 7)
    assert late.requests >= requests * (0.7 if "orbit" in name else 1) and late.shifted == 0
    assert late.samples > (0.1 if "orbit" in name else 0.3) * requests  # an orbit takes two answers in time
    assert late.faults[FaultKind.SILENT] > 0.3 * requests
    assert set(late.faults) == {FaultKind.SILENT, FaultKind.LATE}
    assert abs(late.faults[FaultKind.SILENT] - late.faults[FaultKind.LATE]) <= 1  # every late answer was told


@pytest.mark.parametrize("name", [name for name, gauge in CASES.items() if gauge.port != TCP])
def test_without_the_drain_answers_are_one_behind(name, monkeypatch):
    # private: the driver as it would be without the drain
    monkeypatch.setattr(Polled, "_give_up", lambda self, items, now_ns: self._ask(items, now_ns))
    monkeypatch.setattr(Resync, "ask", lambda self, count: count)
    assert simulated(CASES[name], 500, 7).shifted > 50


def test_drain_alone_does_not_stop_an_answer_three_time_outs_late(monkeypatch):
    assert simulated(RTU, 500, 7, slowest=3).shifted == 0
    monkeypatch.setattr(Resync, "ask", lambda self, count: count)
    assert simulated(RTU, 500, 7, slowest=3).shifted > 50


def test_an_instrument_that_answers_nothing_but_its_usual_request_is_read(monkeypatch):
    answer = RtuRequests.feed

    def usual(self: RtuRequests, data: bytes, now_ns: int) -> list[Message]:
        return [message for message in answer(self, data, now_ns) if message.data[5] == RTU.count]

    monkeypatch.setattr(RtuRequests, "feed", usual)
    late = simulated(RTU, 500, 7)
    assert late.samples > 100 and late.shifted == 0


class _InMenu:
    """A device with an open menu from 2 s to 9 s: it reads requests meanwhile and answers them afterwards."""

    sent = 0

    def __init__(self, device: Device) -> None:
        self._device, self._waiting = device, deque[bytes]()

    def connected(self, now_ns: int) -> ConversationStep:
        return self._device.connected(now_ns)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        if self._waiting or 2 * S <= now_ns < 9 * S:
            self._waiting.append(data)
            return ConversationStep(wake_ns=max(now_ns, 9 * S))
        return self._device.received(data, now_ns)

    def tick(self, now_ns: int) -> ConversationStep:
        step = self._device.received(self._waiting.popleft(), now_ns)
        return ConversationStep(step.send, wake_ns=now_ns if self._waiting else None)


@pytest.mark.parametrize("name", CASES)
def test_burst_after_a_menu_shifts_nothing(name):
    instrument = Numbered()
    device = _InMenu(daq.gauges.device([CASES[name]], instrument.read))
    items = simulate(daq.gauges.host([CASES[name]]), device, 12 * S, character_ns=500_000)
    samples = samples_of(items)
    early_ns = [s.requested_ns - instrument.took_ns(s) for s in samples]
    stirred = 12 * S // STIR_EVERY_NS
    # at most the burst's first and where the line is stirred
    assert sum(early > 0 for early in early_ns) <= 1 + stirred
    assert max(early_ns) < TIMEOUT_S * S
    assert all(instrument.took_ns(s) <= s.first_byte_ns for s in samples)
    assert min(s.last_byte_ns for s in samples) < S and max(s.last_byte_ns for s in samples) > 11 * S

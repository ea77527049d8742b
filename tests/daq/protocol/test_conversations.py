import sys

import pytest

import daq.feedback
import daq.gauges
from daq.acquisition.stream_buffer import faults_of, samples_of
from daq.acquisition.streams import robot_stream
from daq.protocol.conversation import Fault, FaultKind, Sample
from daq.protocol.framing import LIMIT, DelimitedLines, Message, Sized
from tests.support.drivers import egm, gauge, keyence, lines, opc_ua, rsi, rtde, sylvac
from tests.support.refusals import refused
from tests.support.simulated_conversation import S, Script, asked


def test_repeated_error_is_reported_once_a_second():
    script = asked(daq.gauges.host([sylvac()]))
    while script.now_ns < 10 * S:
        script.receive(b"ERR0\r")
        script.wake()
    faults = faults_of(script.taken())
    assert 9 <= len(faults) <= 11 and faults[0].count == 1
    assert 85 <= sum(fault.count for fault in faults) <= 95


def test_garbage_without_end_is_one_fault():
    script = asked(daq.gauges.host([keyence()]))
    for _ in range(100):
        script.receive(bytes(range(32, 127)) * 10)
    (fault,) = script.taken()
    assert (fault.kind, fault.count) == (FaultKind.GARBLED, 1)
    assert str(LIMIT) in fault.detail


def test_burst_of_garbage_is_reported_with_its_count():
    script = Script(daq.gauges.host([sylvac(mode="continuous")]))
    script.receive(b"\x7f@\r" * 5000 + b"+1.000\r")
    first, rest, sample = script.taken()
    assert isinstance(first, Fault) and isinstance(rest, Fault) and isinstance(sample, Sample)
    assert (first.count, rest.count) == (1, 4999)


def test_late_answers_are_counted_before_a_lost_link():
    host = daq.gauges.host([sylvac()])
    script = asked(host)
    script.wake()
    script.receive(b"+1.000\r+2.00")
    (late,) = host.handle_link_loss(script.now_ns)
    assert (late.kind, late.count) == (FaultKind.LATE, 2)
    script.wake()
    assert script.sent.endswith(b"?\r") and host.handle_link_loss(script.now_ns) == ()


def value(x: int, further: bool = False) -> bytes:
    """A reading of the ild1420 in its three tagged bytes."""
    return bytes([x & 0x3F, 0x40 | x >> 6 & 0x3F, (0xC0 if further else 0x80) | x >> 12])


def _listening() -> Script:
    script = Script(daq.gauges.host([gauge("micro_epsilon_ild1420")]))
    script.receive(b"OUTPUT RS422\r\n->" + value(32000)[1:])  # joined amid the answer and a value
    assert script.taken() == []
    return script


@pytest.mark.parametrize("position", range(3))
@pytest.mark.parametrize("damage", ["lost", "twice", "text", "block"])
def test_ild1420_finds_its_place_again(damage, position):
    true = [10_000 + 4_321 * k for k in range(8)]
    stream = b"".join(map(value, true))
    at = 9 + position
    between = {"lost": b"", "twice": stream[at : at + 1] * 2, "text": b"E05 no\r\n->0a", "block": b"\xc1"}[damage]
    script = _listening()
    script.receive(stream[:at] + between + stream[at + (damage in ("lost", "twice")) :])
    items = script.taken()
    samples = samples_of(items)
    distances = [(102 / 65520 * x - 1) / 10 for x in true]
    kept = [min(range(8), key=lambda k: abs(distances[k] - sample.values[0])) for sample in samples]
    assert [distances[k] for k in kept] == pytest.approx([sample.values[0] for sample in samples])
    assert kept[:3] == [0, 1, 2] and kept[-2:] == [6, 7] and len(kept) >= 6
    assert FaultKind.GARBLED in {item.kind for item in faults_of(items)}


def test_ild1420_takes_none_of_several_values():
    script = _listening()
    for k in range(1000):
        script.receive(value(30_000, further=True) + value(2000), k * S // 1000)
    faults = script.taken()
    assert all(isinstance(item, Fault) and "distance" in item.detail for item in faults)
    assert len(faults) < 5


@pytest.mark.parametrize(("feedback", "sent"), [(egm(), 1), (rsi(), 1), (lines(), 11)])
def test_late_tick_sends_one_datagram_or_all_missed_ones(feedback, sent):
    device = daq.feedback.device(feedback, lambda _: [0.0] * 6)
    assert device.connected(5 * S).wake_ns == 5 * S
    wake_ns = device.tick(5 * S + S // 10).wake_ns
    assert device.sent == sent
    assert (wake_ns <= 5 * S + S // 10) is (sent == 1)  # the next at once, or in its time


def test_currents_are_those_that_a_rig_file_wants_and_its_robot_has():
    assert not [name for name in robot_stream(rtde()).columns if name.startswith("current")]
    with pytest.raises(ValueError, match="unknown part 'current1_a'"):
        rsi(condition={"current1_a": "MACur.A1"})


def test_a_missing_package_is_named_before_anything_is_opened(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("daq.opc_ua")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "asyncua", None)
    with refused("package.missing"):
        robot_stream(opc_ua())


def test_a_delimiter_cut_in_two_ends_a_line_too_long():
    frames = DelimitedLines(b"\r\n")
    (fault,) = frames.feed(b"x" * LIMIT + b"\r", 1)
    assert fault.kind is FaultKind.GARBLED
    assert frames.feed(b"\nM0\r\n", 2) == [Message(b"M0", 4, 2, 2)]
    assert not frames.pending


def test_a_stream_out_of_step_stays_so_until_cleared():
    frames = Sized(1, lambda head: 2 if head == b"a" else None)
    good, fault = frames.feed(b"a1?a2", 1)
    assert good == Message(b"a1", 2, 1, 1) and isinstance(fault, Fault)
    assert frames.feed(b"a3", 2) == [] and frames.pending
    frames.clear()
    assert frames.feed(b"a4", 3) == [Message(b"a4", 2, 3, 3)]

from __future__ import annotations

import math
import struct

import pytest
from pymodbus.framer import FramerRTU

import daq.feedback
import daq.gauges
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample
from daq.protocol.framing import LIMIT
from daq.protocol.polled import PAUSE_NS
from rigs.schema.gauges import Gauge
from tests.support.drivers import TCP, joints, keyence, lines, modbus, rtde, sylvac
from tests.support.simulated_conversation import S, Script, asked

GARBLED, DEVICE_ERROR, MISSING = FaultKind.GARBLED, FaultKind.DEVICE_ERROR, FaultKind.MISSING


def _asked(*gauges: Gauge) -> Script:
    return asked(daq.gauges.host(gauges))


def _fault(script: Script, kind: FaultKind, *words: str) -> Fault:
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is kind
    for word in words:
        assert word in fault.detail
    return fault


def _rtu(*content: int) -> bytes:
    frame = bytes(content)
    return frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big")


# --- Polling: what every asked instrument has in common ---


def test_the_line_is_quiet_before_the_first_request():
    script = Script(daq.gauges.host([sylvac(timeout_s=0.5)]))
    assert script.sent == b"OUT0\r" and script.step.wake_ns == S // 2
    script.receive(b"+1.000\r", S // 4)
    assert script.step.wake_ns == 3 * S // 4 and script.taken() == []
    assert script.wake().send == b"?\r"


def test_the_stamps_are_those_of_the_pieces():
    script = _asked(sylvac())
    requested_ns = script.now_ns
    first_ns = requested_ns + S // 10
    script.receive(b"+12", first_ns)
    script.receive(b".3", first_ns + 1)
    step = script.receive(b"45\r", first_ns + 2)
    assert script.taken() == [Sample((12.345,), requested_ns, first_ns, first_ns + 2, 8)]
    assert step.send == b"?\r" and step.wake_ns == first_ns + 2 + S // 2


def test_silence_is_reported_and_the_late_answer_ignored():
    script = _asked(sylvac())
    script.wake()
    _fault(script, FaultKind.SILENT, "0.5 s", "cable")
    assert script.sent == b""
    script.receive(b"+1.000\r", script.now_ns + S // 4)
    quiet_from_ns = script.now_ns
    assert script.taken() == []
    step = script.wake()
    assert step.send == b"?\r" and script.now_ns == quiet_from_ns + S // 2
    assert _fault(script, FaultKind.LATE, "timeout_s").count == 1


def test_half_an_answer_is_no_answer():
    script = _asked(sylvac())
    script.receive(b"+1.0")
    script.wake()
    _fault(script, FaultKind.SILENT)
    script.wake()
    _fault(script, FaultKind.LATE)
    script.receive(b"+2.000\r")
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.values == (2.0,)


def test_more_than_the_answer_is_not_taken_for_the_next():
    script = _asked(sylvac())
    script.receive(b"+1.000\r+2.000\r+3.0")
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.values == (1.0,)
    assert script.sent == b""
    script.wake()
    assert _fault(script, FaultKind.LATE).count == 2
    assert script.sent == b"?\r"


def test_an_error_answer_makes_a_pause():
    script = _asked(sylvac())
    step = script.receive(b"ERR0\r")
    assert step.send == b"" and step.wake_ns == script.now_ns + PAUSE_NS
    assert script.wake().send == b"?\r"


def test_repeated_error_is_reported_once_a_second():
    script = _asked(sylvac())
    while script.now_ns < 10 * S:
        script.receive(b"ERR0\r")
        script.wake()
    faults = [item for item in script.taken() if isinstance(item, Fault)]
    assert 9 <= len(faults) <= 11 and faults[0].count == 1
    assert 85 <= sum(fault.count for fault in faults) <= 95


def test_a_silence_ends_the_counting():
    script = _asked(sylvac())
    for _ in range(3):
        script.receive(b"ERR0\r")
        script.wake()
    script.wake()
    faults = [(item.kind, item.count) for item in script.taken() if isinstance(item, Fault)]
    assert faults == [(DEVICE_ERROR, 1), (DEVICE_ERROR, 2), (FaultKind.SILENT, 1)]


def test_continuous_instrument_is_reported_and_silenced():
    script = Script(daq.gauges.host([sylvac()]))
    for number in range(1, 101):
        script.receive(b"+1.000\r", number * S // 10)
    faults = [item for item in script.taken() if isinstance(item, Fault)]
    assert {fault.kind for fault in faults} == {FaultKind.LATE} and len(faults) == 5
    assert sum(fault.count for fault in faults) == 100
    assert script.sent == b"OUT0\r" * 6


def test_garbage_without_end_is_one_fault():
    script = _asked(keyence())
    for _ in range(100):
        script.receive(bytes(range(32, 127)) * 10)
    assert _fault(script, GARBLED, str(LIMIT)).count == 1


# --- Sylvac ---


def test_sylvac_continuous():
    script = Script(daq.gauges.host([sylvac(mode="continuous")]))
    assert script.sent == b"OUT1\r"
    script.receive(b"+1.000\r-2.0", 5)
    script.receive(b"00\r", 9)
    assert script.taken() == [Sample((1.0,), NO_TIME, 5, 5, 7), Sample((-2.0,), NO_TIME, 5, 9, 7)]
    assert script.receive(b"SY 228\r").send == b"OUT1\r"
    script.taken()
    assert script.wake().send == b"OUT1\r"
    _fault(script, FaultKind.SILENT)


def test_burst_of_garbage_is_reported_with_its_count():
    script = Script(daq.gauges.host([sylvac(mode="continuous")]))
    script.receive(b"\x7f@\r" * 5000 + b"+1.000\r")
    first, rest, sample = script.taken()
    assert isinstance(first, Fault) and isinstance(rest, Fault) and isinstance(sample, Sample)
    assert (first.count, rest.count) == (1, 4999)


def test_late_answers_are_counted_also_where_the_link_is_then_lost():
    host = daq.gauges.host([sylvac()])
    script = asked(host)
    script.wake()
    _fault(script, FaultKind.SILENT)
    script.receive(b"+1.000\r+2.00")
    (late,) = host.handle_link_loss(script.now_ns)
    assert isinstance(late, Fault) and (late.kind, late.count) == (FaultKind.LATE, 2)
    script.wake()
    assert script.sent.endswith(b"?\r") and host.handle_link_loss(script.now_ns) == ()


def test_sylvac_cable():
    device = daq.gauges.device([sylvac()], lambda now_ns: [-1.5 if now_ns < 5 else math.nan])
    script = Script(device)
    script.receive(b"?\rID?\rUNI?\rSET?\rMOD?\rXYZ\r", 1)
    assert script.sent.startswith(b"-1.5000\rSY") and script.sent.endswith(b"ERR1\r")
    assert script.sent.count(b"\r") == 6 and b"MM\r" in script.sent and device.sent == 1
    assert script.receive(b"OUT1\r", 2).wake_ns == 2
    assert script.wake().send == b"-1.5000\r"
    assert script.receive(b"OUT0\r").wake_ns is None
    assert script.receive(b"?\r", 7).send == b"ERR0\r"
    assert device.sent == 2


# --- Keyence ---


def test_keyence_a_head_missing():
    script = _asked(keyence(channel=1), keyence(channel=2))
    assert script.receive(b"M0,-00.007\r\n").send == b"M0\r\n"
    sample, fault = script.taken()
    assert isinstance(sample, Sample) and sample.values[0] == -0.007 and math.isnan(sample.values[1])
    assert isinstance(fault, Fault) and fault.kind is MISSING and "channel 2" in fault.detail


def test_keyence_unit_refuses_unknown_commands():
    script = Script(daq.gauges.device([keyence()], lambda now_ns: [0.007]))
    assert script.receive(b"M0\r\n").send == b"M0,+00.007\r\n"
    assert script.receive(b"XX,1\r\n").send == b"ER,XX,00\r\n"


# --- Modbus ---

BAUMER_REPLY = _rtu(1, 4, 26, 0, 0, 0, 0, 0x7C, 0x37, 0x42, 0x8B, *[0] * 10, 0, 5, 0, 0, 0xA1, 0x20, 0, 7)


def test_baumer_over_rtu():
    script = Script(daq.gauges.host([modbus()]))
    assert script.wake().send == _rtu(1, 4, 0, 200, 0, 13)
    requested_ns = script.now_ns
    step = script.receive(BAUMER_REPLY, S)
    assert step.send == _rtu(1, 4, 0, 200, 0, 13)
    (sample,) = script.taken()
    assert isinstance(sample, Sample)
    assert sample.values == pytest.approx((69.743,), abs=5e-4)
    assert (sample.requested_ns, sample.size, sample.status) == (requested_ns, 31, 0)
    assert sample.device_time_s == pytest.approx(5 + ((7 << 16) + 0xA120) * 1e-6)


@pytest.mark.parametrize(
    ("code", "name"),
    [(1, "ILLEGAL_FUNCTION"), (2, "ILLEGAL_ADDRESS"), (4, "DEVICE_FAILURE"), (11, "GATEWAY"), (99, "unknown")],
)
def test_modbus_exceptions(code, name):
    script = _asked(modbus())
    step = script.receive(_rtu(1, 0x84, code))
    _fault(script, DEVICE_ERROR, str(code), name)
    assert step.send == b"" and step.wake_ns == script.now_ns + PAUSE_NS


def _with_quality(quality: int) -> bytes:
    return _rtu(*BAUMER_REPLY[:3], 0, quality, *BAUMER_REPLY[5:-2])


def test_modbus_status():
    script = _asked(modbus())
    script.receive(_with_quality(1))
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.status == 1
    script.receive(_with_quality(2))
    _fault(script, DEVICE_ERROR, "status 2")


@pytest.mark.parametrize(
    "reply",
    [
        BAUMER_REPLY[:-1] + b"\0",
        _rtu(2, *BAUMER_REPLY[1:-2]),
        _rtu(1, 3, *BAUMER_REPLY[2:-2]),
        _rtu(1, 4, 24, *[0] * 24),
        b"\0" * 40,
    ],
    ids=["checksum", "unit", "function", "count", "zeros"],
)
def test_rtu_garbage_is_drained(reply):
    script = _asked(modbus())
    script.receive(reply)
    _fault(script, GARBLED)
    script.receive(BAUMER_REPLY, script.now_ns + 1)
    assert script.taken() == [] and script.sent == b""
    script.wake()
    assert script.sent == _rtu(1, 4, 0, 200, 0, 1) and script.taken() == []
    script.receive(_rtu(1, 4, 2, 0, 0))
    assert script.sent[8:] == _rtu(1, 4, 0, 200, 0, 13) and script.taken() == []
    script.receive(BAUMER_REPLY)
    assert isinstance(script.taken()[0], Sample)


def _tcp(number: int, *content: int) -> bytes:
    return struct.pack(">HHH", number, 0, len(content)) + bytes(content)


def test_modbus_tcp_transaction_ids():
    script = Script(daq.gauges.host([modbus(port=TCP)]))
    content = BAUMER_REPLY[:-2]
    assert script.wake().send == _tcp(1, 1, 4, 0, 200, 0, 13)
    script.receive(_tcp(1, *content))
    assert isinstance(script.taken()[0], Sample) and script.step.send == _tcp(2, 1, 4, 0, 200, 0, 13)
    script.receive(_tcp(1, *content))
    _fault(script, FaultKind.LATE, "answer 1")
    script.receive(_tcp(2, *content))
    assert isinstance(script.taken()[0], Sample)
    script.receive(_tcp(3, 1, 0x84, 2))
    _fault(script, DEVICE_ERROR, "ILLEGAL_ADDRESS")


@pytest.mark.parametrize(
    "reply",
    [
        _tcp(1, 2, 4, 2, 0, 0),
        _tcp(1, 1, 3, 2, 0, 0),
        _tcp(1, 1, 4, 2, 0, 0),
        _tcp(1, 1, 4, 26, 0, 0),
        b"\0\1\0\1\0\3\0\0",
    ],
    ids=["unit", "function", "count", "cut", "protocol"],
)
def test_modbus_tcp_garbage(reply):
    script = _asked(modbus(port=TCP))
    script.receive(reply)
    _fault(script, GARBLED)


def _joints_reply(number: int, state: int, *angles: float) -> bytes:
    return _tcp(number, 1, 3, 26, *struct.pack(">6fH", *angles, state))


def test_modbus_joints():
    script = asked(daq.feedback.host(joints()))
    script.receive(_joints_reply(1, 2, 1.5, -2, 3, 4, 5, 360), script.now_ns + 3)
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.values == (1.5, -2, 3, 4, 5, 360)
    assert sample.last_byte_ns - sample.requested_ns == 3 and math.isnan(sample.device_time_s) and sample.status == 0
    assert script.wake().send == _tcp(2, 1, 3, 0, 100, 0, 13)
    script.receive(_joints_reply(2, 4, 0, 0, 0, 0, 0, 0))
    assert [sample.status for sample in script.taken() if isinstance(sample, Sample)] == [4]


@pytest.mark.parametrize(
    ("state", "last", "kind", "word"),
    [
        (9, 6.0, DEVICE_ERROR, "status 9"),
        (2, math.nan, GARBLED, "word_order"),
        (2, math.inf, GARBLED, "word_order"),
        (2, 1e30, GARBLED, "word_order"),
    ],
)
def test_modbus_joints_that_are_none(state, last, kind, word):
    script = asked(daq.feedback.host(joints()))
    script.receive(_joints_reply(1, state, 1, 2, 3, 4, 5, last))
    _fault(script, kind, word)
    script.wake()
    assert script.step.send == _tcp(2, 1, 3, 0, 100, 0, 13)  # it is asked again


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        (_rtu(1, 3, 0, 200, 0, 13), _rtu(1, 0x83, 1)),
        (_rtu(1, 4, 0, 199, 0, 13), _rtu(1, 0x84, 2)),
        (_rtu(1, 4, 0, 201, 0, 13), _rtu(1, 0x84, 2)),
        (_rtu(1, 4, 0, 200, 0, 0), _rtu(1, 0x84, 3)),
        (_rtu(2, 4, 0, 200, 0, 13), b""),
        (_rtu(1, 4, 0, 202, 0, 2), _rtu(1, 4, 4, 0, 0, 0x3F, 0x80)),
        (b"\1\4\0" + _rtu(1, 4, 0, 202, 0, 2), _rtu(1, 4, 4, 0, 0, 0x3F, 0x80)),
    ],
)
def test_modbus_gauge_answers(request_, answer):
    script = Script(daq.gauges.device([modbus()], lambda now_ns: [1.0]))
    assert script.receive(request_).send == answer


# --- RTDE ---


def _rtde(kind: bytes, payload: bytes = b"") -> bytes:
    return struct.pack(">HB", 3 + len(payload), kind[0]) + payload


def _data(clock_s: float, *angles_deg: float, recipe: int = 1) -> bytes:
    return _rtde(b"U", struct.pack(">B7d", recipe, clock_s, *map(math.radians, angles_deg)))


VERSION, RECIPE, STARTED = _rtde(b"V", b"\1"), _rtde(b"O", b"\1DOUBLE,VECTOR6D"), _rtde(b"S", b"\1")
ANGLES = (0.0, -90.0, 90.0, 45.0, -45.0, 360.0)


def test_rtde_handshake_and_data():
    script = Script(daq.feedback.host(rtde(rate_hz=125, condition=False)))
    assert script.sent == bytes.fromhex("0005560002")
    assert script.receive(VERSION).send == _rtde(b"O", struct.pack(">d", 125) + b"timestamp,actual_q")
    assert script.receive(RECIPE).send == _rtde(b"S")
    assert script.receive(STARTED).send == b""
    packet = _data(12.5, *ANGLES)
    script.receive(packet[:10], 4)
    script.receive(packet[10:], 6)
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.values == pytest.approx(ANGLES)
    assert (sample.first_byte_ns, sample.last_byte_ns, sample.size) == (4, 6, 60)
    assert (sample.device_time_s, sample.requested_ns) == (12.5, NO_TIME)


@pytest.mark.parametrize(
    ("replies", "word"),
    [
        ([_rtde(b"V", b"\0")], "version"),
        ([VERSION, _rtde(b"O", b"\0DOUBLE,NOT_FOUND")], "NOT_FOUND for actual_q"),
        ([VERSION, _rtde(b"O", b"\0IN_USE,VECTOR6D")], "IN_USE for timestamp"),
        ([VERSION, RECIPE, _rtde(b"S", b"\0")], "start"),
    ],
)
def test_rtde_refusals(replies, word):
    script = Script(daq.feedback.host(rtde(condition=False)))
    for reply in replies:
        script.receive(reply)
    _fault(script, DEVICE_ERROR, word, ";")
    assert script.step.hang_up


@pytest.mark.parametrize(
    "packet",
    [b"\0\2U", b"\xff\xffU", b"\0\5?ab", _rtde(b"U", b"\1"), _data(1, *ANGLES, recipe=2), VERSION, _rtde(b"M", b"\7")],
    ids=["short", "long", "kind", "size", "recipe", "unasked", "text"],
)
def test_rtde_out_of_step_asks_for_a_new_link(packet):
    script = Script(daq.feedback.host(rtde(condition=False)))
    script.receive(VERSION + RECIPE + STARTED + packet + _data(1, *ANGLES))
    _fault(script, GARBLED)
    assert script.step.hang_up
    assert script.receive(_data(2, *ANGLES)).hang_up and script.taken() == []


def test_rtde_numbers_that_are_none():
    script = Script(daq.feedback.host(rtde(condition=False)))
    script.receive(VERSION + RECIPE + STARTED + _data(math.nan, *ANGLES))
    _fault(script, GARBLED, "nan")
    assert not script.step.hang_up


def test_rtde_silence():
    script = Script(daq.feedback.host(rtde(timeout_s=2, condition=False)))
    assert script.step.wake_ns == 2 * S
    script.wake()
    _fault(script, FaultKind.SILENT, "2 s")
    assert script.step.hang_up


def test_rtde_texts():
    script = Script(daq.feedback.host(rtde(condition=False)))
    script.receive(_rtde(b"M", b"\2hi\4RTDE\3"))
    assert script.taken() == []
    script.receive(_rtde(b"M", b"\4slow\4RTDE\2"))
    _fault(script, DEVICE_ERROR, "warning from RTDE: slow")


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, 1e-300, 501.0, math.inf, math.nan])
def test_rtde_controller_refuses_rates(rate_hz):
    script = Script(daq.feedback.device(rtde(), lambda now_ns: [0.0] * 6))
    wrong = _rtde(b"O", struct.pack(">d", rate_hz) + b"timestamp,actual_q")
    assert script.receive(wrong).send == _rtde(b"O", b"\0DOUBLE,VECTOR6D")
    assert script.receive(_rtde(b"S")).send == _rtde(b"S", b"\0")


def test_rtde_controller_refuses():
    script = Script(daq.feedback.device(rtde(), lambda now_ns: [0.0] * 6))
    assert script.receive(_rtde(b"V", b"\0\1")).send == _rtde(b"V", b"\0")
    assert script.receive(_rtde(b"S")).send == _rtde(b"S", b"\0")
    wrong = _rtde(b"O", struct.pack(">d", 500) + b"timestamp,actual_x")
    assert script.receive(wrong).send == _rtde(b"O", b"\0DOUBLE,NOT_FOUND")
    right = _rtde(b"O", struct.pack(">d", 500) + b"timestamp,actual_q")
    assert script.receive(right).send == RECIPE
    assert script.receive(_rtde(b"O", right[3:] + b",")).send == RECIPE  # as SDU's client ends the list
    assert script.receive(_rtde(b"S")).send == STARTED and script.step.wake_ns == 0
    assert script.receive(_rtde(b"P")).send == _rtde(b"P", b"\1") and script.step.wake_ns is None


# --- Lines ---


def test_line_feed():
    script = Script(daq.feedback.host(lines()))
    script.receive(b"1500,1,2,3,4,5,-6\n", 7)
    assert script.taken() == [Sample((1, 2, 3, 4, 5, -6), NO_TIME, 7, 7, 18, 1.5)]
    script = Script(daq.feedback.host(lines(fields=("_", *(f"q{k}_rad" for k in range(6, 0, -1))), separator=" ")))
    script.receive(b"J:\t 0 0  0 0 0 3.141592653589793 \r\n")
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.values == pytest.approx((180, 0, 0, 0, 0, 0))
    assert math.isnan(sample.device_time_s)


@pytest.mark.parametrize(
    ("line", "word"),
    [
        (b"1500,1,2,3,4,5\n", "6 fields"),
        (b"1500,1,2,3,4,5,6,7\n", "8 fields"),
        (b"1500,1,2,3,4,5,six\n", "q6_deg"),
        (b"1500,1,2,3,4,5,nan\n", "q6_deg"),
        (b"1500,1,2,3,4,5,1_0\n", "q6_deg"),
        (b"\xff\xfe\n", "fields"),
        (b"\n", "fields"),
    ],
)
def test_line_feed_garbage(line, word):
    script = Script(daq.feedback.host(lines()))
    script.receive(line)
    _fault(script, GARBLED, word)


def test_a_datagram_holds_whole_lines_and_continues_nothing():
    script = Script(daq.feedback.host(lines(port="udp://127.0.0.1:9000", listens=True)))
    script.receive(b"1000,1,2,3,4,5,6\r\n1010,1,2,3,4,5,6")
    assert [item.device_time_s for item in script.taken() if isinstance(item, Sample)] == [1.0, 1.01]
    script.receive(b"1020,1,2,3")
    _fault(script, GARBLED, "4 fields")
    script.receive(b"1030,1,2,3,4,5,6")
    assert len(script.taken()) == 1


def test_overtaken_datagram_is_ignored_but_a_restart_is_not():
    script = Script(daq.feedback.host(lines(port="udp://127.0.0.1:9000", listens=True)))
    for clock_ms in (5000, 5020, 5010):
        script.receive(b"%d,1,2,3,4,5,6\n" % clock_ms)
    assert [getattr(item, "kind", None) for item in script.taken()] == [None, None, FaultKind.LATE]
    script.receive(b"0,1,2,3,4,5,6\n")
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.device_time_s == 0


def test_line_feed_silence_once_per_timeout():
    script = Script(daq.feedback.host(lines(timeout_s=2)))
    script.wake()
    _fault(script, FaultKind.SILENT)
    script.wake()
    _fault(script, FaultKind.SILENT, "interface: ur_rtde")
    assert script.now_ns == 4 * S and not script.step.hang_up
    script = Script(daq.feedback.host(lines(port="/dev/ttyS0")))
    script.wake()
    assert "ur_rtde" not in _fault(script, FaultKind.SILENT).detail

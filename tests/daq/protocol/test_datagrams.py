from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import replace

import pytest

import daq.feedback
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Item, Sample
from daq.protocol.positions import LIMIT
from rigs.schema.feedback import Feedback
from tests.support.drivers import egm, j519, lines, rsi
from tests.support.simulated_conversation import S, Script

GARBLED, LATE, MISSING, SKIPPED = FaultKind.GARBLED, FaultKind.LATE, FaultKind.MISSING, FaultKind.SKIPPED

# Public, from the parser's test of a ROS driver, with one more element as other configurations send it.
ROB = (
    b'<Rob TYPE="KUKA">\r\n  <RIst X="1.0" Y="2.0" Z="3.0" A="0.5" B="1.0" C="1.5" />'
    b'  <ASPos A1="1.0" A2="0.9" A3="0.8" A4="0.7" A5="0.6" A6="0.5" />'
    b'  <AIPos A1="0.1" A2="-0.2" A3="0.3" A4="4e1" A5="0.5" A6="180.25" /><Digout o1="0" o2="1" />'
    b'  <Delay D="0" /><IPOC>123645634563</IPOC></Rob>\r\n'
)
RSI_ANGLES = (0.1, -0.2, 0.3, 40.0, 0.5, 180.25)

# EgmRobot by hand: header {seqno 7, tm 2000 ms, mtype 2}, feedBack {joints 6 × fixed64, a field 3 to pass over,
# time {sec 1700000000, usec 500000}}, and fields 3, 6 and 10 that nobody asked for.
EGM_ANGLES = (0.0, -90.0, 90.0, 45.0, -45.0, 360.0)
_JOINTS = b"".join(b"\x09" + struct.pack("<d", angle) for angle in EGM_ANGLES)
_TIME = bytes.fromhex("08 80 e2 cf aa 06 10 a0 c2 1e")
_FEEDBACK = b"\x0a\x36" + _JOINTS + b"\x1a\x00" + b"\x22\x0a" + _TIME
EGM = bytes.fromhex("0a 07 08 07 10 d0 0f 18 02") + b"\x12\x46" + _FEEDBACK + bytes.fromhex("1a 00 30 01 51") + bytes(8)
PACKED = bytes.fromhex("0a 07 08 08 10 d4 0f 18 02 12 34 0a 32 0a 30") + struct.pack("<6d", *EGM_ANGLES)


def rob(ipoc: int, joint: str = "1") -> bytes:
    joints = " ".join(f'A{axis}="{joint}"' for axis in range(1, 7))
    return f'<Rob Type="KUKA"><AIPos {joints}/><IPOC>{ipoc}</IPOC></Rob>'.encode()


def egm_robot(number: int, joint: float = 1.0, mtype: int = 2, joints: int = 6) -> bytes:
    angles = (b"\x09" + struct.pack("<d", joint)) * joints
    low = bytes([number & 0x7F | 0x80, number >> 7 & 0x7F | 0x80, number >> 14 & 0x7F | 0x80])
    header = b"\x08" + low + bytes([number >> 21 & 0x7F | 0x80, number >> 28]) + b"\x18" + bytes([mtype])
    content = b"\x0a" + bytes([len(angles)]) + angles
    return b"\x0a" + bytes([len(header)]) + header + b"\x12" + bytes([len(content)]) + content


def status(number: int, joint: float = 1.0, stamp_ms: int = 1000, kind: int = 0) -> bytes:
    head = struct.pack(">IIIBBHHHI", kind, 3, number, 15, 0, 0, 0, 0, stamp_ms)
    return head + struct.pack(">27f", *[500.0] * 9, *[joint] * 6, *[0.0] * 3, *[2.0] * 9)


def test_rsi_reads_the_angles_and_answers_with_the_same_ipoc():
    script = Script(daq.feedback.host(rsi()))
    assert script.sent == b""  # the controller speaks first
    step = script.receive(ROB, 9)
    assert step.send == b'<Sen Type="ImFree"><IPOC>123645634563</IPOC></Sen>'
    assert script.taken() == [Sample(RSI_ANGLES, NO_TIME, 9, 9, len(ROB), 123645634.563)]


def test_rsi_answers_with_every_digit_of_the_ipoc():
    answer = Script(daq.feedback.host(rsi())).receive(rob(8).replace(b">8<", b">0000000008<")).send
    assert answer == b'<Sen Type="ImFree"><IPOC>0000000008</IPOC></Sen>'


def test_rsi_answers_only_by_the_configured_name():
    assert Script(daq.feedback.host(rsi(sentype="Cell-3"))).receive(rob(8)).send.startswith(b'<Sen Type="Cell-3">')
    silent = Script(daq.feedback.host(rsi(onlysend=True)))
    silent.receive(rob(8))
    assert silent.sent == b"" and len(silent.taken()) == 1


@pytest.mark.parametrize(
    ("text", "kind", "answered"),
    [
        (rob(8, "nan"), GARBLED, True),
        (rob(8, "1e400"), GARBLED, True),
        (rob(8, "1e9"), GARBLED, True),
        (rob(8, "9" * 30), GARBLED, True),
        (rob(8, "&lol;"), GARBLED, True),
        (rob(8, "\u0664"), GARBLED, True),
        (rob(8, ""), GARBLED, True),
        (rob(8).replace(b"A6", b"A5"), GARBLED, True),
        (rob(8).replace(b'A6="1"', b'A5="nan"'), GARBLED, True),
        (rob(8).replace(b"<AIPos", b'<AIPos A6="2"'), GARBLED, True),
        (rob(8).replace(b"<IPOC>", b"<AIPos/><IPOC>"), GARBLED, True),
        (rob(8).replace(b"AIPos", b"ASPos"), MISSING, True),
        (rob(8)[:-6], GARBLED, True),
        (rob(8).replace(b">8<", b">8.5<"), GARBLED, False),
        (rob(8).replace(b">8<", b"><"), GARBLED, False),
        (rob(8).replace(b">8<", b">" + b"9" * 19 + b"<"), GARBLED, False),
        (b'<!DOCTYPE r [<!ENTITY a "1"><!ENTITY b "&a;&a;&a;">]>' + rob(8), GARBLED, True),
        (b"<Rob", GARBLED, False),
        (b"\xff\xfe\x00", GARBLED, False),
        (b"x" * (LIMIT + 1), GARBLED, False),
    ],
)
def test_rsi_texts_that_are_none(text, kind, answered):
    script = Script(daq.feedback.host(rsi()))
    assert bool(script.receive(text).send) == answered
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is kind
    script.receive(rob(12))
    assert isinstance(script.taken()[-1], Sample)  # the next one is as good as ever


def test_rsi_reports_late_answers():
    script = Script(daq.feedback.host(rsi()))
    for ipoc, delay in ((4, 0), (8, 2), (12, 3), (16, 0)):
        script.receive(rob(ipoc).replace(b"<IPOC>", f'<Delay D="{delay}"/><IPOC>'.encode()), ipoc)
    late = [item for item in script.taken() if isinstance(item, Fault)]
    assert {fault.kind for fault in late} == {FaultKind.DEVICE_ERROR}
    assert sum(fault.count for fault in late) == 3 and "late" in late[0].detail


def test_rsi_controller_counts_the_answers_that_are_not_there():
    script = Script(daq.feedback.device(rsi(), lambda now_ns: [1.0] * 6))
    first = script.wake().send
    ipoc = first.partition(b"<IPOC>")[2].partition(b"<")[0]
    script.receive(b'<Sen Type="ImFree"><IPOC>' + ipoc + b"</IPOC></Sen>")
    assert b'<Delay D="0"/>' in script.wake().send
    script.receive(b'<Sen Type="ImFree"><IPOC>' + ipoc + b"</IPOC></Sen>")
    assert b'<Delay D="1"/>' in script.wake().send  # that was the answer to the one before


def test_egm_reads_the_measured_angles_and_the_clock_and_sends_nothing():
    script = Script(daq.feedback.host(egm()))
    script.receive(EGM, 5)
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.values[:6] == EGM_ANGLES
    assert replace(sample, values=()) == Sample((), NO_TIME, 5, 5, len(EGM), 1_700_000_000.5)
    script.receive(PACKED, 6)
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.values[:6] == EGM_ANGLES
    assert sample.device_time_s == 2.004  # the header's clock where the feedback has none
    assert script.sent == b""


@pytest.mark.parametrize(
    ("message", "kind"),
    [
        (egm_robot(1, math.nan), GARBLED),
        (egm_robot(1, math.inf), GARBLED),
        (egm_robot(1, 1e300), GARBLED),
        (egm_robot(1, mtype=3), GARBLED),
        (egm_robot(1, joints=5), MISSING),
        (EGM[:-1], GARBLED),
        (EGM[:20], GARBLED),
        (EGM.replace(_TIME, b"\x08" + b"\xff" * 9), GARBLED),
        (b"\x08" + b"\xff" * 30, GARBLED),
        (b"\x0b\x0c", GARBLED),
        (b"\x00\x00", GARBLED),
        (EGM + b"\x00\x00", GARBLED),
        (b"GET / HTTP/1.1\r\n\r\n", GARBLED),
    ],
)
def test_egm_messages_that_are_none(message, kind):
    script = Script(daq.feedback.host(egm()))
    script.receive(message)
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is kind
    script.receive(EGM)
    assert isinstance(script.taken()[-1], Sample)


def test_j519_asks_for_the_status_and_never_for_more():
    script = Script(daq.feedback.host(j519(version=1)))
    assert script.sent == bytes.fromhex("00000000 00000001")
    packet = status(41, -12.5, 86_400_002)
    assert len(packet) == 132
    script.receive(packet, 7)
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.values == pytest.approx([-12.5] * 6 + [math.nan, 1], nan_ok=True)
    assert replace(sample, values=()) == Sample((), NO_TIME, 7, 7, 132, 86400.002)
    assert len(script.sent) == 8
    script.wake()
    (silence,) = script.taken()
    assert isinstance(silence, Fault) and silence.kind is FaultKind.SILENT
    assert script.sent == bytes.fromhex("00000000 00000001") * 2 and not script.step.hang_up


@pytest.mark.parametrize(
    "packet",
    [
        status(1, math.nan),
        status(1, math.inf),
        status(1, 1e9),
        status(1)[:-4],
        status(1) + b"\0",
        status(1, kind=3),
        b"",
    ],
)
def test_j519_packets_that_are_none(packet):
    script = Script(daq.feedback.host(j519()))
    script.receive(packet)
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is GARBLED


def test_j519_controller_stops_when_it_is_asked_to():
    script = Script(daq.feedback.device(j519(version=1), lambda now_ns: [1.0] * 6))
    assert script.step.wake_ns is None
    script.receive(bytes(7) + b"\1")
    assert len(script.wake().send) == 132
    assert script.receive(bytes.fromhex("00000002 00000001")).wake_ns is None


ASKS = bytes.fromhex("00000007 00000003 00000001") + bytes(16)
START_1, START_3, START_4 = (
    bytes.fromhex(text) for text in ("0000000000000001", "000000c800000003", "000000c800000004")
)


def _capability(version: int, size: int = 28) -> bytes:
    """The answer on the version: type, version, number, ms, steps, version, and a last field of four bytes or one."""
    return struct.pack(">6I", 7, 3, 1, 2, 1, version) + bytes(size - 24)


def _status_of(version: int, number: int, angle_deg: float, stamp_ms: int) -> bytes:
    packet = bytearray(388 if version == 3 else 416)
    struct.pack_into(">III", packet, 0, 202 if version == 3 else 204, version, number)
    struct.pack_into(">I", packet, 16, stamp_ms)
    struct.pack_into(">9f", packet, 20 + 36, *[angle_deg] * 9)
    return bytes(packet)


@pytest.mark.parametrize(
    ("answer", "start"),
    [
        (_capability(1), START_1),
        (_capability(2, 25), bytes.fromhex("0000000000000002")),
        (_capability(3), START_3),
        (_capability(4), START_4),
        (_capability(5), START_4),
    ],
    ids=["1", "2 of 25 bytes", "3", "4", "newer"],
)
def test_j519_starts_the_version_that_the_controller_has(answer, start):
    script = Script(daq.feedback.host(j519()))
    assert script.sent == ASKS
    assert script.receive(answer).send == start and script.taken() == []
    assert script.wake().send == ASKS  # after a silence it is asked again


@pytest.mark.parametrize("version", [3, 4])
def test_j519_statuses_of_fanucs_own_driver(version):
    script = Script(daq.feedback.host(j519()))
    script.receive(_capability(version))
    packet = _status_of(version, 41, -12.5, 86_400_002)
    script.receive(packet, 7)
    assert script.taken() == [Sample((*[-12.5] * 6, 0.0, 0.0), NO_TIME, 7, 7, len(packet), 86400.002)]
    script.receive(_status_of(version, 44, 1.0, 86_400_010), 8)
    skipped, _ = script.taken()
    assert isinstance(skipped, Fault) and (skipped.kind, skipped.count) == (FaultKind.SKIPPED, 2)


def test_j519_controller_without_the_status_request_is_started():
    script = Script(daq.feedback.host(j519()))
    assert [script.wake().send for _ in range(3)] == [START_1, ASKS, START_1]
    script.receive(status(1, 2.0))
    assert isinstance(script.taken()[-1], Sample)


@pytest.mark.parametrize("packet", [_capability(3)[:-1], _capability(3) + b"\0", b"\0\0\0\7"])
def test_j519_answers_on_the_version_that_are_none(packet):
    script = Script(daq.feedback.host(j519()))
    assert script.receive(packet).send == b""
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is GARBLED


@pytest.mark.parametrize(("version", "size"), [(1, 132), (2, 132), (3, 388), (4, 416)])
def test_j519_the_emulated_controller_of_each_version(version, size):
    script = Script(daq.feedback.device(j519(version=version), lambda now_ns: [1.0] * 6))
    assert len(script.receive(ASKS).send) == (0 if version == 1 else 25 if version == 2 else 28)
    for other in {START_1, START_3, START_4} - {struct.pack(">II", 200 if version > 2 else 0, version)}:
        assert script.receive(other).wake_ns is None
    script.receive(struct.pack(">II", 200 if version > 2 else 0, version))
    assert len(script.wake().send) == size


PACKETS = {"rsi": (rsi(), rob, 4), "egm": (egm(), egm_robot, 1), "j519": (j519(), status, 1)}


def _heard(feedback: Feedback, packets: Sequence[bytes]) -> list[tuple[str, int]]:
    script = Script(daq.feedback.host(feedback))
    for at_ns, packet in enumerate(packets):
        script.receive(packet, at_ns)
    return [_word(item) for item in script.taken()]


def _word(item: Item) -> tuple[str, int]:
    return (item.kind, item.count) if isinstance(item, Fault) else ("sample", 1)


@pytest.mark.parametrize("name", PACKETS)
def test_lost_doubled_and_reordered_datagrams_are_reported(name):
    feedback, packet, step = PACKETS[name]
    start = 1000 * step
    heard = _heard(feedback, [packet(start + step * n) for n in (0, 1, 4, 2, 4, 5)])
    sample = ("sample", 1)
    assert heard == [sample, sample, (SKIPPED, 2), sample, (LATE, 1), (LATE, 1), sample]


@pytest.mark.parametrize("name", ["egm", "j519"])
def test_numbers_of_32_bits_wrap_without_a_fault(name):
    feedback, packet, _ = PACKETS[name]
    assert _heard(feedback, [packet(n % 2**32) for n in range(2**32 - 2, 2**32 + 2)]) == [("sample", 1)] * 4


@pytest.mark.parametrize("name", PACKETS)
def test_restarted_counter_is_reported_without_loss(name):
    feedback, packet, step = PACKETS[name]
    heard = _heard(feedback, [packet(5_000_000 * step), packet(step), packet(2 * step)])
    assert heard == [("sample", 1), (SKIPPED, 1), ("sample", 1), ("sample", 1)]


@pytest.mark.parametrize("name", PACKETS)
def test_count_restarts_after_a_silence(name):
    feedback, packet, step = PACKETS[name]
    script = Script(daq.feedback.host(feedback))
    script.receive(packet(step), 0)
    script.wake()
    assert script.now_ns == feedback.timeout_s * S
    script.receive(packet(500 * step))
    assert [_word(item) for item in script.taken()] == [("sample", 1), (FaultKind.SILENT, 1), ("sample", 1)]


@pytest.mark.parametrize(("feedback", "sent"), [(egm(), 1), (rsi(), 1), (lines(), 11)])
def test_late_tick_sends_one_datagram_or_all_missed_ones(feedback, sent):
    device = daq.feedback.device(feedback, lambda _: [0.0] * 6)
    assert device.connected(5 * S).wake_ns == 5 * S
    wake_ns = device.tick(5 * S + S // 10).wake_ns
    assert device.sent == sent
    assert wake_ns is not None and (wake_ns <= 5 * S + S // 10) is (sent == 1)  # the next at once, or in its time


def test_faster_rsi_controller_loses_nothing():
    assert _heard(rsi(cycle_ms=12), [rob(4 * n) for n in range(1, 5)]) == [("sample", 1)] * 4

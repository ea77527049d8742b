from __future__ import annotations

import struct

import pytest
from pymodbus.framer import FramerRTU

import daq.gauges
from daq.apps.gauge_drivers.heidenhain_nd287 import STATUS_EVERY
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample
from daq.protocol.polled import PAUSE_NS
from tests.support.drivers import SERIAL, gauge
from tests.support.replies import POLLED
from tests.support.simulated_conversation import S, Script, asked

CASES = [(name, reply, expected) for name, of in POLLED.items() for reply, expected in of.replies.items()]


@pytest.mark.parametrize(("name", "reply", "expected"), CASES, ids=[f"{name} {reply!r}" for name, reply, _ in CASES])
def test_each_reply_becomes_its_reading_or_a_fault_with_a_remedy(name, reply, expected):
    case = POLLED[name]
    script = case.begun()
    requested_ns = script.now_ns
    step = script.receive(reply, S)
    (item,) = script.taken()
    if isinstance(item, Fault):
        assert (item.kind, step.send) == (expected, b"") and "; " in item.detail
        assert script.wake().send == case.request
        return
    assert isinstance(item, Sample) and item.values == pytest.approx([float(v) for v in expected.split()], abs=1e-9)
    assert (item.requested_ns, item.last_byte_ns, item.size) == (requested_ns, S, len(reply))
    assert step.send == case.request


def test_one_feature_deactivated_leaves_the_other():
    script = asked(daq.gauges.host([gauge("mahr_c1202", channel=1), gauge("mahr_c1202", channel=2)]))
    script.receive(b"1 +012.34 mm;2 ERR6;3 ERR6\r")
    sample, fault = script.taken()
    assert isinstance(sample, Sample) and sample.values[0] == 12.34 and sample.values[1] != sample.values[1]
    assert isinstance(fault, Fault) and "feature 2" in fault.detail


def test_a_refusal_counts_once_however_many_gauges_share_it():
    script = asked(daq.gauges.host([gauge("magnescale_lt", channel=1), gauge("magnescale_lt", channel=2)]))
    for _ in range(3):
        script.receive(b"?\r\n")
        script.wake()
    script.receive(b"A+12.3456 B+12.3456\r\n")
    assert sum(item.count for item in script.taken() if isinstance(item, Fault)) == 3


@pytest.mark.parametrize(("protocol", "word"), [("optorsd", "menu"), ("m1240", "master")])
def test_c1208_in_its_menu_is_reported_silent(protocol, word):
    script = asked(daq.gauges.host([gauge("mahr_c1208", protocol=protocol)]))
    script.wake()
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is FaultKind.SILENT and word in fault.detail


# name, what the device is asked, what it answers while its head shows -1.5 mm, and what in error
DEVICES = [
    ("tesa_tt", b"?\r", b"-0001.50\r\n", b"ERR23\r\n"),
    ("tesa_tt", b"XX\r", b"ERR1\r\n", b"ERR1\r\n"),
    ("mahr_c1202", b"M1?\r", b"1 -001.5000 mm\r", b"1 ERR6\r"),
    ("mahr_c1202", b"?\r", b"1 -001.5000 mm;2 ERR6;3 ERR6\r", b"1 ERR6;2 ERR6;3 ERR6\r"),
    ("mahr_c1208", b"?\r", b"-001.5000mm\r\n", b""),
    ("heidenhain_nd281b", b"\x02", b"-    1.5000    \r\n", b"+    0.0000 ?  \r\n"),
    ("heidenhain_nd281b", b"\x05", b"NO ERROR     \r\n", b"NO ERROR     \r\n"),
    ("heidenhain_nd287", b"\x1bA0100\r", b"\x02-    1.5000\r\n", b"\x02SIGNAL ERROR \r\n"),
    ("heidenhain_nd287", b"\x1bA0200\r", b"\x02-000015000\r\n", b"\x02SIGNAL ERROR \r\n"),
    ("heidenhain_nd287", b"\x1bA0800\r", b"\x0200000011\r\n", b"\x0200000011\r\n"),
    ("heidenhain_nd287", b"\x1bA0999\r", b"\x15", b"\x15"),
    ("magnescale_lt", b"R\r\n", b"A-01.5000\r\n", b"AE\r\n"),
    ("magnescale_mg80", b"D\r\n", b"01NMG-01.5000\r\n", b"01NME  Error \r\n"),
    ("mitutoyo_usb", b"1\r", b"01A-0001.500\r", b"911\r"),
    ("mitutoyo_qm_height", b"1\r", b"01A-0001.500\r", b"911\r"),
    ("cdi_iq", b"R\r", b"-  1.5000, MM\r\n", b"OUT OF BOUNDS\r\n"),
    ("cdi_iq", b"X\r", b"NOT FOUND\r\n", b"NOT FOUND\r\n"),
]


@pytest.mark.parametrize(("interface", "command", "good", "bad"), DEVICES)
def test_emulated_gauge_answers(interface, command, good, bad):
    script = Script(daq.gauges.device([gauge(interface)], lambda now_ns: [-1.5 if now_ns < S else float("nan")]))
    assert script.receive(command, 1).send == good
    assert script.receive(command, S).send == bad


@pytest.mark.parametrize(
    ("reply", "value_mm"),
    [
        (b"\0\0\x02-    1.5000\r\n", -1.5),
        (b"\x02-    1.50\x000\r\n", None),
        (b"\x02-    1.500\0\r\n", None),
        (b"\0    1.5000\r\n", None),
    ],
    ids=["before message", "in number", "last digit", "first character"],
)
def test_nd287_ignores_nuls_only_before_a_message(reply, value_mm):
    """A NUL in a message is a character of wrong parity: without it the number would be another."""
    script = POLLED["nd287"].begun()
    script.receive(reply)
    (item,) = script.taken()
    assert (item.values[0] if isinstance(item, Sample) else None) == value_mm


@pytest.mark.parametrize(
    ("status", "units", "words"),
    [
        (b"\x0200000111\r\n", "mm", "inch"),
        (b"\x02 0 0 0 0 0 0 1 1\r\n", "inch", "mm"),
        (b"\x0200000211\r\n", "mm", "an angle"),
        (b"\x0210000011\r\n", "mm", "to go"),
    ],
)
def test_nd287_whose_display_shows_something_else_is_not_read(status, units, words):
    script = asked(daq.gauges.host([gauge("heidenhain_nd287", units=units)]))
    for _ in range(2):
        script.receive(status)
        assert script.wake().send == b"\x1bA0800\r"  # it is asked again until it can be read
    faults = script.taken()
    assert {type(item) for item in faults} == {Fault} and words in str(faults)
    assert script.receive(b"\x0200000%d11\r\n" % (units == "inch")).send == b"\x1bA0100\r"


@pytest.mark.parametrize("status", [b"\x15", b"\x020000\r\n", b"\x02-    1.5000\r\n"])
def test_nd287_with_another_status_bar_is_read_all_the_same(status):
    script = asked(daq.gauges.host([gauge("heidenhain_nd287")]))
    assert script.receive(status).send == b"\x1bA0100\r"
    assert script.taken() == []


def test_nd287_switched_to_inch_while_it_is_read_is_noticed():
    script = POLLED["nd287"].begun()
    asked_next, readings = b"\x1bA0100\r", 0
    while asked_next == b"\x1bA0100\r":
        step, readings = script.receive(b"\x02-    1.5000\r\n"), readings + 1
        asked_next = step.send or script.wake().send
    assert (asked_next, readings) == (b"\x1bA0800\r", STATUS_EVERY - 1)
    script.receive(b"\x1bA0800\r\x0200000111\r\n")
    *samples, fault = script.taken()
    assert len(samples) == readings and isinstance(fault, Fault) and "inch" in fault.detail


# --- Micro-Epsilon: a stream of tagged bytes ---


def value(x: int, further: bool = False) -> bytes:
    return bytes([x & 0x3F, 0x40 | x >> 6 & 0x3F, (0xC0 if further else 0x80) | x >> 12])


def _listening(**changes: object) -> Script:
    script = Script(daq.gauges.host([gauge("micro_epsilon_ild1420", **changes)]))
    assert script.sent == b"OUTPUT RS422\n"
    script.receive(b"OUTPUT RS422\r\n->" + value(32000)[1:])  # joined amid the answer and a value
    assert script.taken() == []
    return script


@pytest.mark.parametrize(("x", "mm"), [(643, 0.0), (32760, 5.0), (64877, 10.0)])
def test_ild1420_distances(x, mm):
    script = _listening()
    script.receive(value(x)[:1], 3)
    script.receive(value(x)[1:], 5)
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.values == pytest.approx((mm,), abs=2e-4)
    assert (sample.requested_ns, sample.first_byte_ns, sample.last_byte_ns, sample.size) == (NO_TIME, 3, 5, 3)


def test_ild1420_counts_from_its_zero():
    script = _listening(zero_mm=5)
    script.receive(value(32760))
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.values == pytest.approx((0,), abs=1e-9)


@pytest.mark.parametrize(
    ("x", "word"),
    [(0, "before"), (642, "before"), (64878, "behind"), (262074, "behind"), (262075, "262075"), (262143, "262143")],
)
def test_ild1420_errors(x, word):
    script = _listening()
    script.receive(value(x))
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is FaultKind.DEVICE_ERROR and word in fault.detail


@pytest.mark.parametrize("position", range(3))
@pytest.mark.parametrize("damage", ["lost", "twice", "text", "block"])
def test_ild1420_finds_its_place_again(damage, position):
    """Whatever is lost or comes between, no value is made of pieces of two."""
    true = [10_000 + 4_321 * k for k in range(8)]
    stream = b"".join(map(value, true))
    at = 9 + position
    between = {"lost": b"", "twice": stream[at : at + 1] * 2, "text": b"E05 no\r\n->0a", "block": b"\xc1"}[damage]
    script = _listening()
    script.receive(stream[:at] + between + stream[at + (damage in ("lost", "twice")) :])
    items = script.taken()
    samples = [item for item in items if isinstance(item, Sample)]
    distances = [(102 / 65520 * x - 1) / 10 for x in true]
    kept = [min(range(8), key=lambda k: abs(distances[k] - sample.values[0])) for sample in samples]
    assert [distances[k] for k in kept] == pytest.approx([sample.values[0] for sample in samples])
    assert kept[:3] == [0, 1, 2] and kept[-2:] == [6, 7] and len(kept) >= 6
    assert FaultKind.GARBLED in {item.kind for item in items if isinstance(item, Fault)}


def test_ild1420_takes_none_of_several_values():
    script = _listening()
    for k in range(1000):
        script.receive(value(30_000, further=True) + value(2000), k * S // 1000)
    faults = script.taken()
    assert all(isinstance(item, Fault) and "distance" in item.detail for item in faults)
    assert len(faults) < 5


def test_ild1420_is_asked_again_after_a_silence():
    script = _listening()
    assert script.wake().send == b"OUTPUT RS422\n"
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is FaultKind.SILENT


# --- Solartron: a reading, and then its status ---


def _rtu(*content: int) -> bytes:
    frame = bytes(content)
    return frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big")


def _float(number: float) -> bytes:
    return _rtu(1, 3, 4, *struct.pack(">f", number))


READ, STATUS = _rtu(1, 3, 0x1F, 0x42, 0, 2), _rtu(1, 3, 0x1F, 0x43, 0, 2)


def _orbit() -> Script:
    script = Script(daq.gauges.host([gauge("solartron_orbit", parameter=2, status_parameter=3)]))
    assert script.wake().send == READ
    return script


def test_orbit_reading_and_status():
    script = _orbit()
    requested_ns = script.now_ns
    assert script.receive(_float(1.25), S).send == STATUS
    assert script.taken() == []
    assert script.receive(_float(0), S + 5).send == READ
    assert script.taken() == [Sample((1.25,), requested_ns, S, S, 9)]


@pytest.mark.parametrize(
    ("code", "word"),
    [(18, "under range"), (19, "over range"), (246, "incompatible"), (247, "no probe"), (7, "manual")],
)
def test_orbit_status_words(code, word):
    script = _orbit()
    script.receive(_float(1.25))
    step = script.receive(_float(code))
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is FaultKind.DEVICE_ERROR and word in fault.detail
    assert step.wake_ns == script.now_ns + PAUSE_NS and script.wake().send == READ


def test_orbit_without_its_status_is_no_reading():
    script = _orbit()
    script.receive(_float(1.25))
    script.wake()
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is FaultKind.SILENT
    assert script.wake().send == _rtu(1, 3, 0x1F, 0x42, 0, 1)  # a probe: the answer is told by the length
    assert script.receive(_rtu(1, 3, 2, 0, 0)).send == READ
    assert script.receive(_float(2.5)).send == STATUS
    script.receive(_float(0))
    (sample,) = script.taken()
    assert isinstance(sample, Sample) and sample.values == (2.5,)


def test_modbus_ascii_on_the_wire():
    script = Script(daq.gauges.host([gauge("solartron_orbit", framing="ascii", port=SERIAL)]))
    assert script.wake().send == b":01031F42000299\r\n"
    assert script.receive(b":0103043FA0000019\r\n").send == b":01031F43000298\r\n"
    script.receive(b":0103040000000000\r\n")  # its checksum broken
    (fault,) = script.taken()
    assert isinstance(fault, Fault) and fault.kind is FaultKind.GARBLED and "checksum" in fault.detail

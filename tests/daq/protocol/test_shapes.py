from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

import daq.gauges
from daq.protocol.conversation import Fault, FaultKind, Sample
from daq.protocol.numerals import hand_on
from daq.protocol.polled import echoed_part
from tests.support.drivers import gauge, modbus, sylvac
from tests.support.simulated_conversation import S, Script, asked

TEXT_GAUGES: dict[str, dict[str, Any]] = {
    "sylvac": {"interface": "sylvac_opto_rs"},
    "keyence": {"interface": "keyence_dl_rs1a"},
    "mitutoyo usb": {"interface": "mitutoyo_usb"},
    "tesa": {"interface": "tesa_tt"},
    "c1202": {"interface": "mahr_c1202"},
    "c1208 optorsd": {"interface": "mahr_c1208"},
    "c1208 m1240": {"interface": "mahr_c1208", "protocol": "m1240"},
    "nd287": {"interface": "heidenhain_nd287"},
    "nd281b": {"interface": "heidenhain_nd281b"},
    "cdi": {"interface": "cdi_iq"},
    "qm-height": {"interface": "mitutoyo_qm_height"},
    "magnescale lt": {"interface": "magnescale_lt"},
    "magnescale mg80": {"interface": "magnescale_mg80"},
}
ROUNDING_MM = 0.0051
"""Half of the coarsest last digit, TESA's."""
Damage = Callable[[random.Random, bytes], bytes]


def _lost_or_doubled(rng: random.Random, reply: bytes) -> bytes:
    k = rng.randrange(len(reply))
    return reply[:k] + reply[k + 1 :] if rng.random() < 0.5 else reply[: k + 1] + reply[k:]


def _wave(t_s: float) -> float:
    """A gauge that crosses zero and 10 mm, at up to 0.4 mm/s."""
    return 1.2 + 0.9 * math.sin(t_s / 7) + 12 * math.sin(t_s / 50)


@dataclass
class Outcome:
    damaged: int = 0
    right: int = 0
    false_mm: list[float] = field(default_factory=list)
    kinds: Counter[FaultKind] = field(default_factory=Counter)


def _recorded(name: str, damage: Damage, one_in: float, seed: int, replies: int = 2000) -> Outcome:
    """Ask a gauge ten times a second, on a line that damages one answer in so many."""
    keys = dict(TEXT_GAUGES[name])
    one = gauge(keys.pop("interface"), **keys)
    rng, outcome, now_ns = random.Random(seed), Outcome(), 0
    device = daq.gauges.device([one], lambda at_ns: [_wave(at_ns / S)])
    script = Script(daq.gauges.host([one]))
    for _ in range(replies):
        request, script.sent = script.sent, b""
        if not request:
            script.wake()
            continue
        now_ns = max(now_ns, script.now_ns) + S // 10
        sent = device.received(request, now_ns).send
        came = damage(rng, sent) if rng.random() * one_in < 1 else sent
        outcome.damaged += came != sent
        script.receive(came, now_ns)
        for item in script.taken():
            if isinstance(item, Fault):
                outcome.kinds[item.kind] += item.count
                continue
            assert isinstance(item, Sample)
            off_mm = abs(item.values[0] - _wave(now_ns / S))
            if off_mm > ROUNDING_MM:
                outcome.false_mm.append(off_mm)
            else:
                outcome.right += 1
    return outcome


@pytest.mark.parametrize("name", TEXT_GAUGES)
def test_damaged_answers_give_no_false_reading(name):
    outcomes = [_recorded(name, _lost_or_doubled, 200, seed) for seed in range(3)]
    assert sum(one.damaged for one in outcomes) >= 15
    assert [one.false_mm for one in outcomes] == [[], [], []]
    assert sum(one.right for one in outcomes) > 0.97 * sum(one.right + sum(one.kinds.values()) for one in outcomes)


@pytest.mark.parametrize("name", TEXT_GAUGES)
def test_a_sound_line_has_no_faults(name):
    outcome = _recorded(name, _lost_or_doubled, math.inf, 0)
    assert outcome.kinds == Counter() and outcome.right > 1900


def _answers(script: Script, *replies: bytes) -> list[Any]:
    items = list[Any]()
    for reply in replies:
        while not getattr(script.conversation, "asking", True):
            script.wake()
        script.receive(reply, script.now_ns + S // 10)
        items += script.taken()
    return items


def test_changed_unit_of_a_gauge_without_unit_is_a_fault():
    script = asked(daq.gauges.host([sylvac()]))
    before = _answers(script, *[b"-0.55%02d\r" % k for k in range(20)])
    assert all(isinstance(item, Sample) for item in before)
    after = _answers(script, *[b"-0.0217%d\r" % (k % 10) for k in range(30)])
    assert not any(isinstance(item, Sample) for item in after)
    changed = next(item for item in after if item.kind is FaultKind.UNIT_CHANGED)
    assert "in/mm" in changed.detail
    (back,) = [item for item in _answers(script, b"-0.5512\r") if isinstance(item, Sample)]
    assert back.values == (-0.5512,)


def test_pulled_plug_does_not_hide_a_changed_unit():
    first, second = (daq.gauges.host([sylvac()]) for _ in range(2))
    _answers(asked(first), *[b"-0.5509\r"] * 20)
    hand_on(first, second)
    after = _answers(asked(second), *[b"-0.02169\r"] * 5)
    assert {item.kind for item in after} == {FaultKind.MISSHAPEN, FaultKind.UNIT_CHANGED}


def test_a_continuous_gauge_is_held_to_its_shape_as_well():
    script = Script(daq.gauges.host([sylvac(mode="continuous")]))
    for k in range(30):
        script.receive(b"+1.2%03d\r" % k, S + k)
    script.receive(b"+1.229\r+11.2030\r+1.2031\r", 2 * S)
    items = script.taken()
    assert [item.values[0] for item in items if isinstance(item, Sample)][-2:] == [1.2029, 1.2031]
    assert sum(item.count for item in items if isinstance(item, Fault) and item.kind is FaultKind.MISSHAPEN) >= 1


@pytest.mark.parametrize(
    ("replies", "readings_mm"),
    [
        ([b"+9.9%d0\r" % k for k in range(10)] + [b"+10.000\r", b"+10.010\r", b"+9.990\r"], 13),
        ([b"+0.001\r", b"-0.001\r"] * 10, 20),
        ([b"+0.50%d\r" % (k % 10) for k in range(20)] + [b"-12.250\r", b"-12.251\r", b"-12.252\r"], 22),
        ([b"+1.50%d\r" % (k % 10) for k in range(20)] + [b"+11.502\r", b"+11.503\r", b"+11.504\r"], 22),
        ([b"+0.5\r", b"+0.501\r", b"+0.502\r", b"+0.503\r"], 3),
    ],
    ids=[
        "through 10",
        "around zero",
        "a jump, confirmed",
        "one that a doubled 1 would make, confirmed",
        "first damaged",
    ],
)
def test_numbers_of_another_length_are_believed_where_the_gauge_moved_there(replies, readings_mm):
    items = _answers(asked(daq.gauges.host([sylvac()])), *replies)
    assert sum(isinstance(item, Sample) for item in items) == readings_mm


def test_damaged_readings_before_the_shape_is_known_are_reported():
    items = _answers(asked(daq.gauges.host([sylvac()])), b"+1.485\r", b"+1.2485\r", b"+1.2486\r")
    doubts = [item for item in items if isinstance(item, Fault) and item.kind is FaultKind.DOUBTFUL]
    assert [doubt.count for doubt in doubts] == [1]


def test_a_doubled_comma_shifts_no_head_to_the_place_of_another():
    one = gauge("keyence_dl_rs1a", channel=2)
    items = _answers(asked(daq.gauges.host([one])), *[b"M0,+01.000,+02.000\r\n"] * 20, b"M0,,+01.000,+02.000\r\n")
    assert {item.values for item in items if isinstance(item, Sample)} == {(2.0,)}
    assert isinstance(items[-1], Fault) and items[-1].kind is FaultKind.MISSHAPEN


def test_a_gauge_that_ends_its_lines_with_cr_lf_is_read():
    script = Script(daq.gauges.host([sylvac(mode="continuous")]))
    for data in (b"+1.2001\r\n+1.2002\r", b"\n", b"+1.2003\r\n"):
        script.receive(data, S)
    assert [item.values for item in script.taken() if isinstance(item, Sample)] == [(1.2001,), (1.2002,), (1.2003,)]
    items = _answers(asked(daq.gauges.host([sylvac()])), *[b"+1.2001\r\n"] * 5)
    assert [type(item) for item in items] == [Sample] * 5


@pytest.mark.parametrize("heard", [b"A0100\r\n", b"0100\r\n", b"\x1bA01 12.3\r\n"])
def test_part_of_a_request_is_reported_as_echo(heard):
    """An RS-485 adapter that turns round late misses the first characters of its own echo."""
    script = asked(daq.gauges.host([gauge("heidenhain_nd287")]))
    script.receive(b"\x0200010012\r\n")
    (fault,) = _answers(script, heard)
    assert isinstance(fault, Fault) and "echo" in fault.detail


def test_part_of_a_modbus_request_is_reported_as_echo():
    script = Script(daq.gauges.host([modbus()]))
    script.wake()
    request, script.sent = script.sent, b""
    script.receive(request[1:], S)
    while not (items := script.taken()):
        script.wake()
    assert isinstance(items[0], Fault) and "echo" in items[0].detail


def test_other_bytes_are_no_echo():
    assert echoed_part(b"?\r", b"?\r") == 0
    assert echoed_part(b"\x1bA0100\r", b"\x02-    1.5") == 0


@pytest.mark.parametrize("sigma_mm", [0.0002, 0.001, 0.02])
@pytest.mark.parametrize("name", ["sylvac", "c1208 optorsd", "keyence"])
def test_a_gauge_that_scatters_around_zero_is_not_doubted(name, sigma_mm):
    keys = dict(TEXT_GAUGES[name])
    one = gauge(keys.pop("interface"), **keys)
    rng, now_ns = random.Random(5), 0
    device = daq.gauges.device([one], lambda at_ns: [rng.gauss(0.0, sigma_mm)])
    script = Script(daq.gauges.host([one]))
    for _ in range(10_000):
        request, script.sent = script.sent, b""
        if request:
            now_ns = max(now_ns, script.now_ns) + S // 100
            script.receive(device.received(request, now_ns).send, now_ns)
        else:
            script.wake()
    assert [item for item in script.taken() if isinstance(item, Fault)] == []

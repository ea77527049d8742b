import math
import random
from collections import Counter
from typing import Any

import numpy as np
import pytest

import daq.gauges
from daq.acquisition.stream_buffer import faults_of, samples_of
from daq.protocol.conversation import FaultKind
from daq.protocol.numerals import keep_formats
from tests.support.damaged_lines import LOSSES, PRINTING, recorded
from tests.support.drivers import gauge, sylvac
from tests.support.simulated_conversation import S, Script, asked

IN_MM = [name for name in PRINTING if not name.endswith(("um", "inch"))]


@pytest.mark.parametrize("gauge", IN_MM)
def test_lost_or_added_characters_give_no_wrong_reading_without_a_fault(gauge):
    sessions = [recorded(gauge, damage, 0, answers=40, one_in=8) for damage in LOSSES]
    assert sum(one.damaged for one in sessions) >= 15
    assert [one.wrong + one.last for one in sessions] == [[]] * len(LOSSES)
    assert sum(one.right for one in sessions) > 0.95 * sum(one.sent - one.damaged for one in sessions)


@pytest.mark.nightly
@pytest.mark.parametrize("gauge", PRINTING)
def test_5000_answers_with_lost_or_added_characters_give_no_wrong_reading_without_a_fault(gauge):
    sessions = [recorded(gauge, damage, seed) for seed in range(3) for damage in LOSSES]
    assert sum(one.damaged for one in sessions) > 5000 / len(PRINTING)
    assert [one.wrong + one.last for one in sessions] == [[]] * len(sessions)


def test_answer_of_several_features_without_its_number_is_not_the_reading_of_another_feature():
    gauges, _ = PRINTING["mahr c1202 two"]
    script = asked(daq.gauges.host(gauges))
    script.receive(b"-001.8236 mm\r", script.now_ns + S // 10)
    assert [fault.kind for fault in faults_of(script.items)] == [FaultKind.GARBLED]
    assert not len(samples_of(script.items))


@pytest.mark.parametrize("gauge", IN_MM)
def test_a_sound_line_has_no_faults(gauge):
    sessions = [recorded(gauge, "doubled", seed, answers=150, one_in=math.inf) for seed in range(6)]
    assert [(one.wrong, one.faults) for one in sessions] == [([], Counter())] * 6


@pytest.mark.parametrize("wrong", [b"+01.2945\r", b"-01.2346\r", b"+01.9346\r"])
@pytest.mark.parametrize("place", [0, 4, 20])
def test_wrong_digit_or_sign_is_doubted_when_its_neighbours_are_known(wrong, place):
    script = asked(daq.gauges.host([sylvac()]))
    for k in range(25):
        good = b"+01.234%d\r" % (5 + k % 2)
        script.receive(wrong if k == place else good, script.now_ns + S // 10)
        while not script.sent:
            script.wake()
        script.sent = b""
    items = script.taken()
    assert [(fault.kind, fault.count) for fault in faults_of(items)] == [(FaultKind.DOUBTFUL, 1)]
    assert len(samples_of(items)) == 25


@pytest.mark.parametrize("start", [0.1, 1.0])
def test_onset_of_fast_motion_is_not_doubted(start):
    script = asked(daq.gauges.host([sylvac()]))
    for k in range(60):
        mm = 1.2345 + start * max(0, k - 20) + (k == 50) * start
        script.receive(b"%+08.4f\r" % mm, script.now_ns + S // 10)
        while not script.sent:
            script.wake()
        script.sent = b""
    assert [fault for fault in faults_of(script.taken()) if fault.kind is FaultKind.DOUBTFUL] == []


def test_pulled_plug_does_not_hide_a_changed_unit():
    first, second = (daq.gauges.host([sylvac()]) for _ in range(2))
    script = asked(first)
    for _ in range(20):
        script.receive(b"-0.5509\r")
    keep_formats(first, second)
    script = asked(second)
    for _ in range(5):
        while not second.asking:
            script.wake()
        script.receive(b"-0.02169\r", script.now_ns + S // 10)
    faults = [item.kind for item in faults_of(script.taken())]
    assert set(faults) == {FaultKind.MISSHAPEN, FaultKind.UNIT_CHANGED}


def _scattering(name: str, sigma_mm: float, replies: int = 10_000) -> tuple[int, list[Any]]:
    """Number of readings that a gauge sent while it scattered around zero, and the items of the host."""
    (one,), _ = PRINTING[name]
    rng, now_ns = random.Random(5), 0
    device = daq.gauges.device([one], lambda at_ns: [rng.gauss(0.0, sigma_mm)])
    script = Script(daq.gauges.host([one]))
    for _ in range(replies):
        request, script.sent = script.sent, b""
        if request:
            now_ns = max(now_ns, script.now_ns) + S // 100
            script.receive(device.received(request, now_ns).send, now_ns)
        else:
            script.wake()
    return device.sent, script.taken()


@pytest.mark.parametrize("sigma_mm", [0.0002, 0.001, 0.02])
@pytest.mark.parametrize("name", ["sylvac mm", "keyence one of three"])
def test_a_gauge_that_scatters_around_zero_is_not_doubted(name, sigma_mm):
    _, items = _scattering(name, sigma_mm)
    assert faults_of(items) == []


@pytest.mark.parametrize("sigma_mm", [0.0003, 0.001, 0.003])
@pytest.mark.parametrize("name", ["mahr c1208 mm", "mahr c1208 m1240"])
def test_a_gauge_that_omits_the_plus_loses_one_in_a_thousand_around_zero_and_counts_it(name, sigma_mm):
    sent, items = _scattering(name, sigma_mm)
    samples, faults = samples_of(items), faults_of(items)
    counted = sum(fault.count for fault in faults)
    assert 0 <= sent - len(samples) <= counted + 1 <= sent / 1000  # the last one may still wait for the next reading
    assert np.all(np.diff(samples.last_byte_ns) > 0) and np.all(samples.requested_ns < samples.first_byte_ns)
    assert abs(samples.values.mean()) < 3 * sigma_mm / math.sqrt(sent)


def _c1208_readings(*sent_mm: str, pause_s: float = 0.1) -> tuple[list[float], list[FaultKind]]:
    script = Script(daq.gauges.host([gauge("mahr_c1208", timeout_s=2.0)]))
    for text in sent_mm:
        while not script.sent:
            script.wake()
        script.sent = b""
        script.receive(text.encode() + b"mm\r\n", script.now_ns + round(pause_s * S))
    items = script.taken()
    return [sample.values[0] for sample in samples_of(items)], [fault.kind for fault in faults_of(items)]


def test_first_positive_number_is_recorded_when_the_next_one_confirms_it():
    assert _c1208_readings("-000.0120", "-000.0020", "000.0080", "000.0180") == ([-0.012, -0.002, 0.008, 0.018], [])


@pytest.mark.parametrize("after", ["-000.0008", "000.0010"])
def test_negative_number_that_loses_its_minus_is_left_out_and_counted(after):
    steps = ("-000.0110", "-000.0080", "-000.0050", "000.0020", after)
    assert _c1208_readings(*steps) == ([-0.011, -0.008, -0.005, float(after)], [FaultKind.MISSHAPEN])


def test_first_number_without_its_minus_does_not_make_a_second_one_credible():
    later = ("-000.0495", "-000.0497", "-000.0496", "-000.0495")
    values, faults = _c1208_readings("000.0494", "-000.0494", "-000.0494", "000.0498", *later)
    assert 0.0498 not in values and faults == [FaultKind.MISSHAPEN, FaultKind.DOUBTFUL]


def test_reading_held_back_over_a_pause_is_left_out_and_counted():
    values, faults = _c1208_readings("-000.0120", "-000.0020", "000.0080", "000.0180", pause_s=1.1)
    assert (values, faults) == ([-0.012, -0.002, 0.018], [FaultKind.MISSHAPEN])

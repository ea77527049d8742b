import math
import pkgutil
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

import daq.feedback
import daq.gauge_drivers
import daq.gauges
import daq.robot_drivers
from daq.acquisition.stream_buffer import faults_of, samples_of
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample
from daq.protocol.polled import STIR, STIR_EVERY_NS, STIR_NS
from rigs.schema.condition import POSE
from rigs.schema.feedback import columns_beside_joints
from tests.support.drivers import FEEDBACKS, GAUGES, rtde
from tests.support.simulated_conversation import S, simulate

CHARACTER_NS = 200_000
SILENT_IN_ERROR = {"mahr_c1208"}
"""Instruments without a known error reply."""

STATUS_SIZE = 11
"""Bytes of the status bar that is occasionally requested from an ND 287."""


def _samples(items: Sequence[object]) -> list[Sample]:
    assert faults_of(items) == []
    return samples_of(items)


@pytest.mark.parametrize(
    ("package", "tested"),
    [
        (daq.gauge_drivers, {gauges[0].interface for _, gauges, _ in GAUGES}),
        (daq.robot_drivers, {feedback.interface for _, feedback in FEEDBACKS} - {"opc_ua_robotics"}),
    ],
)
def test_every_driver_is_held_to_the_contract(package, tested):
    assert {module.name for module in pkgutil.iter_modules(package.__path__)} == tested


@pytest.mark.parametrize(("name", "gauges", "resolution_mm"), GAUGES, ids=[case[0] for case in GAUGES])
def test_gauge_gives_the_planted_values(name, gauges, resolution_mm):
    planted: list[list[float]] = []
    # A gauge that omits the plus loses a reading where it passes zero, and a display in µm ends at 999.
    lowest_mm = -9.2345 if "c1208" in name else -1.2345
    lowest_mm, step_mm = (lowest_mm / 2, 0.0054) if gauges[0].units == "um" else (lowest_mm, 0.0137)

    def read(now_ns: int) -> list[float]:
        planted.append([(lowest_mm + step_mm * (len(planted) % 250)) * (1 + 0.5 * k) for k in range(len(gauges))])
        return planted[-1]

    device = daq.gauges.device(gauges, read)
    samples = _samples(simulate(daq.gauges.host(gauges), device, 5 * S, character_ns=CHARACTER_NS))
    # A stream is joined midway; an orbit needs a good status before the reading and after it.
    missed_while_joining, reads = int("ild1420" in name or "orbit" in name), 1 + ("orbit" in name)
    assert 50 < len(samples) <= device.sent - missed_while_joining <= len(samples) + 1
    expected = planted[missed_while_joining * reads :: reads][: len(samples)]
    np.testing.assert_allclose([sample.values for sample in samples], expected, rtol=0, atol=resolution_mm)
    assert all(sample.status == 0 and sample.first_byte_ns <= sample.last_byte_ns for sample in samples)
    polled = "continuous" not in name
    assert all((sample.requested_ns != NO_TIME) == polled for sample in samples)
    if polled:
        for sample in samples:
            assert sample.last_byte_ns - sample.requested_ns == sample.size * CHARACTER_NS
        waits_ns = [b.requested_ns - a.last_byte_ns - (reads - 1) * a.size * CHARACTER_NS for a, b in pairwise(samples)]
        status_ns = STATUS_SIZE * CHARACTER_NS if "nd287" in name else 0
        stirs = [n for n, wait_ns in enumerate(waits_ns, start=1) if wait_ns not in {0, status_ns}]
        assert len(stirs) > 3 or len(samples) < 4 * STIR // reads
        assert all(0 < waits_ns[n - 1] <= STIR_NS + status_ns for n in stirs)
        for before, after in pairwise([0, *stirs]):
            joined = 0 if before else missed_while_joining * reads
            assert (after - before) * reads >= STIR - 1 - bool(status_ns) - joined
            assert samples[after].requested_ns - samples[before].requested_ns > 0.9 * STIR_EVERY_NS or not before


@pytest.mark.parametrize(("name", "gauges", "resolution_mm"), GAUGES, ids=[case[0] for case in GAUGES])
def test_gauge_reports_a_head_in_error(name, gauges, resolution_mm):
    def read(now_ns: int) -> list[float]:
        return [math.nan if 2 * S < now_ns < 3 * S else 1.0] * len(gauges)

    host, device = daq.gauges.host(gauges), daq.gauges.device(gauges, read)
    items = simulate(host, device, 5 * S, character_ns=CHARACTER_NS)
    faults = faults_of(items)
    samples = samples_of(items)
    if gauges[0].interface in SILENT_IN_ERROR:
        assert {fault.kind for fault in faults} == {FaultKind.SILENT}
    else:
        assert {fault.kind for fault in faults} == {FaultKind.DEVICE_ERROR}
        assert 2 <= len(faults) <= 3 * len(gauges)  # the first at once, the rest with a count
        assert sum(fault.count for fault in faults) >= 8
    assert all(sample.values == pytest.approx([1.0] * len(gauges), abs=resolution_mm) for sample in samples)
    assert samples[0].last_byte_ns < 2 * S and samples[-1].last_byte_ns > 4 * S


@pytest.mark.parametrize(("name", "feedback"), FEEDBACKS, ids=[case[0] for case in FEEDBACKS])
def test_feedback_gives_the_planted_angles(name, feedback):
    def read(now_ns: int) -> list[float]:
        changing = {
            "signal": now_ns // S % 4,
            "program_state": now_ns // S % 2,
            "safety_state": 2 * (now_ns // S % 3),
            "motors_on": now_ns // S % 2,
            "speed_percent": 50 + now_ns // S,
            "payload_kg": 0.5 * (now_ns // S),
        }
        warm = {f"temperature{axis}_c": 30 + axis + now_ns // S for axis in range(1, 7)}
        drawn = {f"current{axis}_a": 0.5 * axis - now_ns // S for axis in range(1, 7)}
        pose = {name: 10.0 * place - now_ns // S for place, name in enumerate(POSE)}
        beside = [float((changing | warm | drawn | pose)[name]) for name in columns_beside_joints(feedback)]
        return [*(axis * 10 - now_ns * 1e-9 for axis in range(1, 7)), *beside]

    device = daq.feedback.device(feedback, read)
    samples = _samples(simulate(daq.feedback.host(feedback), device, 4 * S))
    missed_while_joining, polled = "serial" in name, "polled" in name
    assert device.sent > 30 and len(samples) == device.sent - missed_while_joining
    expected = [_shown(read(sample.last_byte_ns), name) for sample in samples]
    np.testing.assert_allclose([sample.values for sample in samples], expected, rtol=1e-6, atol=2e-5)
    assert all(sample.requested_ns == (sample.last_byte_ns if polled else NO_TIME) for sample in samples)
    if polled:
        return
    clock = [sample.device_time_s - sample.last_byte_ns * 1e-9 for sample in samples]
    assert max(clock) - min(clock) < 1e-6


def _shown(values: list[float], name: str) -> list[float]:
    """Fields that a controller reports: Stream Motion has no safety state before version 3."""
    without_safety = name in {"j519 version 1", "j519 version 2"}
    return [*values[:6], math.nan, *values[7:]] if without_safety else values


def test_a_skipped_packet_is_counted():
    host, device = daq.feedback.host(rtde()), daq.feedback.device(rtde(), lambda now_ns: [0.0] * 6)
    device.connected(0)
    step = host.connected(0)
    while step.send:
        step = host.received(device.received(step.send, 0).send, 0)
    packets = [device.tick(k * 2_000_000).send for k in range(10)]
    kept = [packet for k, packet in enumerate(packets) if k not in {3, 4, 5, 8}]
    items = [item for packet in kept for item in host.received(packet, 0).items]
    assert Counter(type(item) for item in items) == {Sample: 6, Fault: 2}
    skipped = faults_of(items)
    assert [(fault.kind, fault.count) for fault in skipped] == [(FaultKind.SKIPPED, 3), (FaultKind.SKIPPED, 1)]


def test_a_late_tick_sends_every_period_missed():
    device = daq.feedback.device(rtde(), lambda now_ns: [0.0] * 6)
    host = daq.feedback.host(rtde())
    device.connected(0)
    step = host.connected(0)
    while step.send:
        step = host.received(device.received(step.send, 0).send, 0)
    items = host.received(device.tick(S).send, S).items
    assert len(_samples(items)) == device.sent == 501

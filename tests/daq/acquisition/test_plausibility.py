import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

import daq.gauges
from daq.acquisition.plausibility import IN_ERROR_S, STUCK_S, TIMES_IN_ERROR, PlausibilityCheck
from daq.acquisition.stream_buffer import StreamBuffer
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Item, Sample
from daq.recording.active_run import RunLabel
from daq.recording.machine import RecordingRequest
from daq.recording.recorder import Recorder
from daq.store import read_run
from tests.support.drivers import PLAIN, modbus
from tests.support.recorders import recorder_of
from tests.support.simulated_line import SimulatedLine

S = 1_000_000_000
G1, ROBOT = ("g1_mm",), tuple(f"q{axis}_deg" for axis in range(1, 7))


def _sample(values: Sequence[float], at_ns: int) -> Sample:
    return Sample(tuple(values), NO_TIME, at_ns, at_ns, 9)


def _seen(
    seconds: int, reads: Callable[[float], float], turns: Callable[[float], float], *, touching: bool = True
) -> list[Fault]:
    """Faults of a gauge at 10 Hz next to a robot, checked twice per second like the recorder."""
    plausibility, told = PlausibilityCheck(touching), list[Fault]()
    for half in range(2 * seconds):
        times_s = [(half + k / 5) / 2 for k in range(5)]
        told += plausibility.check("g1", G1, [_sample([reads(t_s)], round(t_s * S)) for t_s in times_s])
        told += plausibility.check(
            "robot", ROBOT, [_sample([0, turns(t_s), 0, 0, 0, 0], round(t_s * S)) for t_s in times_s]
        )
    return told


def _fine(t_s: float) -> float:
    return round(0.1 * math.sin(t_s), 4)


def test_stuck_gauge_is_reported_once_and_again_on_motion():
    stuck, freed = _seen(60, lambda t_s: 0.123 if 5 <= t_s < 40 else _fine(t_s), lambda t_s: 3 * t_s)
    assert stuck.kind is FaultKind.DOUBTFUL and stuck.count == 1
    told, asked = stuck.detail.split(": ")
    assert told.startswith("g1 ") and "0.1230 mm for 10 s " in told and told.endswith(" 30°") and "HOLD" in asked
    assert abs(stuck.at_ns - (5 + STUCK_S) * S) < S
    assert (freed.detail, freed.count, freed.at_ns) == ("g1 moves again", 0, 40 * S)


@pytest.mark.parametrize(
    ("reads", "turns", "touching"),
    [
        (_fine, lambda t_s: 3 * t_s, True),
        (lambda t_s: 0.123, lambda t_s: 0.02 * math.sin(50 * t_s), True),
        (lambda t_s: 0.123, lambda t_s: 3 * t_s, False),
        (lambda t_s: round(0.03 * math.sin(t_s / 9), 2), lambda t_s: 3 * t_s, True),
        (lambda t_s: math.nan, lambda t_s: 3 * t_s, True),
    ],
    ids=["measures", "robot stands", "not touching", "coarse", "head off"],
)
def test_no_false_alarm(reads, turns, touching):
    assert _seen(60, reads, turns, touching=touching) == []


def test_never_moving_gauge_is_reported_after_more_motion():
    (stuck,) = _seen(60, lambda t_s: 0.0, lambda t_s: 3 * t_s)
    assert " 9" in stuck.detail


def test_flickering_error_is_reported():
    items: list[Item] = []
    for k in range(2 * TIMES_IN_ERROR):
        items += [
            _sample([1.0], 2 * k * S),
            *[Fault(FaultKind.DEVICE_ERROR, (2 * k + 1) * S, "ERR3")] * 3,
        ]
    told = PlausibilityCheck(True).check("g1", G1, items)
    assert [fault.kind for fault in told] == [FaultKind.DOUBTFUL] * 2
    assert told[0].detail.startswith("g1 ")
    rarely = [
        item
        for k in range(9)
        for item in (_sample([1.0], 1), Fault(FaultKind.DEVICE_ERROR, k * round(IN_ERROR_S) * S, ""))
    ]
    assert PlausibilityCheck(True).check("g1", G1, rarely) == []
    assert (
        PlausibilityCheck(True).check("g1", G1, [Fault(FaultKind.DEVICE_ERROR, k * S, "ERR0") for k in range(50)]) == []
    )


def test_polled_gauges_end_only_their_own_errors():
    near = {"address": 200, "count": 2, "value": {"address": 200, "type": "float32"}, "range_mm": [-1, 1], **PLAIN}
    units = [modbus(unit=1, **near), modbus(unit=2, **near)]

    def told(reads: Callable[[float], float]) -> list[Fault]:
        device = daq.gauges.device(units, lambda now_ns: [0.5, reads(now_ns / S)])
        items = SimulatedLine(units[0].line.character_ns).run(daq.gauges.host(units), device, 20 * S)
        return PlausibilityCheck(True).check("g1_g2", ("g1_mm", "g2_mm"), items)

    first, *_ = told(lambda t_s: 1.5 * math.sin(2 * math.pi * t_s / 3))
    assert first.detail.startswith("g2 ")
    assert told(lambda t_s: 0.5 if t_s < 2 else 1.5) == []  # the readings of the other do not end it


def test_message_without_a_gauge_does_not_end_its_error():
    items: list[Item] = []
    for k in range(2 * TIMES_IN_ERROR):
        items += [Fault(FaultKind.DEVICE_ERROR, k * S, "ERR"), _sample([1.0, math.nan], k * S)]
    check = PlausibilityCheck(True)
    assert check.check("g1_g2", ("g1_mm", "g2_mm"), items) == []
    whole = [item for k in range(TIMES_IN_ERROR) for item in (_sample([1.0, 2.0], k), items[0])]
    (told,) = check.check("g1_g2", ("g1_mm", "g2_mm"), whole)
    assert told.detail.startswith("g1_g2 ")


def _in_error(folder: Path) -> tuple[Recorder, StreamBuffer]:
    """A recorder with a run in which gauge g1 reports errors, and the buffer of the gauge."""
    buffers = {"g1": StreamBuffer("g1", G1), "robot": StreamBuffer("robot", ROBOT)}
    recorder = recorder_of(folder, buffers)
    now_ns = time.monotonic_ns()
    buffers["g1"].deliver([_sample([0.1], now_ns)])
    buffers["robot"].deliver([_sample([0.0] * 6, now_ns)])
    recorder.start_run(RecordingRequest(RunLabel(name="x", test="radial"))).result()
    for _ in range(TIMES_IN_ERROR):
        buffers["g1"].deliver([_sample([0.1], now_ns), Fault(FaultKind.DEVICE_ERROR, now_ns, "ERR3")])
    return recorder, buffers["g1"]


def test_doubt_about_the_last_readings_is_in_their_run(tmp_path):
    recorder, g1 = _in_error(tmp_path)
    ended = recorder.stop_run().result()
    recorder.start()
    recorder.shut_down("complete", "")
    assert ended.counters["g1"][FaultKind.DOUBTFUL] == 1
    assert [fault["stream"] for fault in read_run(ended.path).faults if fault["kind"] == "doubtful"] == ["g1"]
    assert g1.state().counters[FaultKind.DOUBTFUL] == 1 and g1.drain() == []


@pytest.mark.parametrize("factor", [1 / 25.4, 25.4])
def test_changed_unit_is_reported_once(factor):
    """Also one that sends registers, which have no decimals to show it."""

    def reads(t_s: float) -> float:
        return (0.9 + _fine(t_s / 10)) * (factor if t_s >= 30 else 1.0)

    (told,) = _seen(60, reads, lambda t_s: 3 * t_s)
    assert told.kind is FaultKind.UNIT_CHANGED and abs(told.at_ns - 30 * S) <= S // 10 and "in/mm" in told.detail


@pytest.mark.parametrize(
    "reads",
    [
        lambda t_s: 0.9 + _fine(t_s),
        lambda t_s: 1e-3 * round(math.sin(7 * t_s)),
        lambda t_s: 0.0001 * (-1) ** round(10 * t_s),
        lambda t_s: 2.54 if t_s < 30 else 0.1 + t_s,
        lambda t_s: 5.08 / 25.4 if 30 <= t_s < 30.05 else 5.08 + _fine(t_s),
    ],
    ids=["moves", "coarse zero", "noisy zero", "off ball", "one reading"],
)
def test_moving_or_once_wrong_gauge_has_not_changed_its_unit(reads):
    assert [one for one in _seen(60, reads, lambda t_s: 3 * t_s) if one.kind is FaultKind.UNIT_CHANGED] == []


def test_frozen_gauge_is_reported_when_it_resumes():
    def reads(t_s: float) -> float:
        return _fine(21.5 if 21.5 <= t_s < 22.7 else t_s)

    (told,) = _seen(40, reads, lambda t_s: 6 * t_s)
    assert told.kind is FaultKind.DOUBTFUL and abs(told.at_ns - 22.7 * S) <= S // 10
    assert "for 1.1 s " in told.detail and "jumped by 0.1" in told.detail
    assert "HOLD" in told.detail


@pytest.mark.parametrize(
    ("reads", "turns"),
    [
        (lambda t_s: round(0.02 * math.sin(t_s / 5), 3), lambda t_s: 6 * t_s),
        (lambda t_s: _fine(20.0 if 20 <= t_s < 30 else t_s), lambda t_s: 6 * min(t_s, 20.0) + 6 * max(0.0, t_s - 30)),
    ],
    ids=["coarse turn", "robot stands"],
)
def test_a_gauge_that_only_rests_was_not_frozen(reads, turns):
    assert _seen(60, reads, turns) == []

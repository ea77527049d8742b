import math
from dataclasses import replace

import pytest

from daq.discovery.port_search import pushed_gauge
from daq.discovery.trial import Trial
from daq.protocol.conversation import Fault, FaultKind, Sample

GOOD = Sample((1.0,), -1, 0, 0, 8)


def fault(kind: FaultKind) -> Fault:
    return Fault(kind, 0, "")


@pytest.mark.parametrize(
    ("items", "enough"),
    [
        ([GOOD] * 3, True),
        ([GOOD] * 2, False),
        ([GOOD, fault(FaultKind.LATE)] * 20, False),
        ([GOOD, GOOD, fault(FaultKind.GARBLED)] * 20, False),
        ([fault(FaultKind.GARBLED), *[GOOD] * 3], True),
        ([GOOD, fault(FaultKind.MISSING)] * 3, True),
        ([GOOD, fault(FaultKind.DEVICE_ERROR)] * 3, True),
        ([fault(FaultKind.DEVICE_ERROR)] * 9, False),
        ([], False),
    ],
)
def test_readings_in_a_row(items, enough):
    assert Trial(items).evidence[0] is enough


def test_the_clean_protocol_ranks_first():
    faults = [fault(FaultKind.GARBLED), replace(fault(FaultKind.GARBLED), count=500)]
    doubtful, many = (Trial([*[GOOD] * 9, one]).evidence for one in faults)
    assert Trial([GOOD] * 5).evidence > doubtful > many > Trial([GOOD]).evidence


REST = {"a": [0.0, 0.001, 0.0, 0.001, 0.0], "b": [5.0, 5.001, 5.0, 5.0, 5.0]}


@pytest.mark.parametrize(
    ("now_mm", "moved"),
    [
        ({"a": 0.0, "b": 5.0}, None),
        ({"a": 0.1, "b": 5.0}, None),
        ({"a": 0.9, "b": 5.0}, "a"),
        ({"a": -0.9, "b": 5.1}, "a"),
        ({"a": 0.0, "b": 3.0}, "b"),
        ({"a": 0.9, "b": 5.9}, None),
        ({"a": 0.9}, "a"),
        ({}, None),
        ({"a": math.nan, "b": 5.0}, None),
    ],
)
def test_the_gauge_that_moved(now_mm, moved):
    assert pushed_gauge(REST, now_mm) == moved


def test_an_unrestful_gauge_has_to_move_further():
    rest = {"a": [0.0, 0.3, -0.3, 0.2, 0.0], "b": [0.0] * 5}
    assert pushed_gauge(rest, {"a": 0.5, "b": 0.0}) is None
    assert pushed_gauge(rest, {"a": 2.5, "b": 0.0}) == "a"

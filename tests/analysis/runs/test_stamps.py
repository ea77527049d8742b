import numpy as np
import pytest

from analysis.runs.clocks import gauge_instants
from tests.support.stamp_cells import CELLS, GAUGES, TIMED
from tests.support.stamped import gauge_run, serial

P99_MS = {"Sylvac polled": 4.5, "Sylvac continuous": 0.15, "Keyence": 4.0, "Baumer": 2.5, "RTDE": 0.3}
"""Of some seconds, twice what a minute gives; a millisecond and a half is the instrument's own time to answer."""


def seconds(name: str) -> float:
    """Enough for ten requests out of step at 16 ms."""
    return 9.0 if name.startswith(("Keyence", "Baumer", "RTDE")) else 18.0


@pytest.mark.parametrize("name", [name for name in CELLS if name not in TIMED])
def test_aligned_times_are_within_their_u(name):
    found = CELLS[name](seconds=seconds(name))
    aligned, arrival = (np.percentile(np.abs(errors), 99) for errors in (found.aligned, found.arrival))
    assert aligned < min(arrival, next(p99 for begin, p99 in P99_MS.items() if name.startswith(begin)))
    assert found.within_2u > 0.9


@pytest.mark.parametrize("name", TIMED)
def test_times_of_self_latching_gauges_are_within_their_u(name):
    found = TIMED[name].errors(seconds=15.0)
    aligned, arrival = (np.median(np.abs(errors)) for errors in (found.aligned, found.arrival))
    assert aligned < arrival and found.within_2u > 0.9


@pytest.mark.parametrize("name", [name for name in GAUGES if "continuous" not in name])
@pytest.mark.parametrize("latency_ms", [16.0, 0.0])
def test_buffering_adapter_is_reported(name, latency_ms):
    gauge = GAUGES[name]
    wire = serial(np.random.default_rng(2), gauge.line.character_ns, latency_ms)
    assert gauge_instants(gauge_run(gauge, wire, seconds(name)).columns, gauge).held == (latency_ms > 0)

from pathlib import Path

import numpy as np
import pytest

from analysis.runs import align
from analysis.runs.clocks import robot_instants
from analysis.runs.loading import measured_of
from daq.store import read_run
from tests.support.recorded_lap import WRONG, recorded
from tests.support.refusals import refused


def test_each_row_carries_its_own_uncertainty(tmp_path):
    run = read_run(recorded(tmp_path))
    measured = measured_of(run)
    data = align.align(run.path, run.streams, run.manifest.test, measured.rig)
    assert len(data.u_t_s) == len(data.t_s)
    assert any(doubt.startswith(f"robot: {len(WRONG)} stamps ") for doubt in measured.doubts)
    ignored = [doubt.split(" is ")[0].split(" are ")[0] for doubt in measured.doubts if "too uncertain" in doubt]
    assert ignored == ["g1: 1 row", "g2: 1 row", f"robot: {len(WRONG)} rows"]
    uncertain = np.flatnonzero(data.u_t_s > 1e-4)
    assert 1 <= len(uncertain) <= 3  # the slower answer, and those beside it
    assert data.u_t_s.max() == pytest.approx(3e-3 / np.sqrt(12), rel=0.1)
    assert np.median(data.u_t_s) < 1e-5


def test_a_gauge_is_not_bridged_over_a_hole_in_which_a_play_is_crossed_a_robot_is():
    at = np.arange(0.0, 200e6, 2.3e6)
    with_hole, rows = at[(at < 80e6) | (at > 98e6)], at[:-1] + 1e6
    inside = (rows > with_hole[with_hole < 80e6].max()) & (rows < with_hole[with_hole > 98e6].min())
    gaps_ns = align.gaps_ns(rows, with_hole, align.JUMPS_NS)
    assert np.array_equal(gaps_ns > 0, inside) and gaps_ns.max() == pytest.approx(20.7e6)
    assert not align.gaps_ns(rows, with_hole, align.MOVES_NS).any()
    assert not align.gaps_ns(with_hole, with_hole, align.JUMPS_NS).any()  # read in one answer, before and after it


def test_waiting_caused_by_rigd_is_no_doubt():
    rows = 20 * 217
    waits = np.repeat(2.3e6 + 17e6 * np.linspace(0, 1, 20), 4)
    assert not align.are_many(len(waits), waits.max(), rows) and not align.are_many(0, 0.0, rows)
    assert align.are_many(len(waits) + 1, 26e6, rows) and align.are_many(3 * len(waits), waits.max(), rows)


def test_robot_without_complete_joints_is_refused(tmp_path):
    run = read_run(recorded(tmp_path))
    robot = run.streams["robot"]
    for axis in range(1, 7):
        robot[f"q{axis}_deg"] = np.where(np.arange(len(robot["size"])) % 6 == axis - 1, np.nan, robot[f"q{axis}_deg"])
    with refused("readings.too_few", "contains fewer than two readings of"):
        measured_of(run)


@pytest.mark.parametrize(("shortest_ms", "longest_ms"), [(6, 18), (8, 12), (15, 25)])
def test_of_messages_that_a_network_bundles_the_newest_counts_and_the_others_are_counted(shortest_ms, longest_ms):
    """Lines without a time, which the sender's network holds back for 40 ms (Nagle, delayed acknowledgement)."""
    sent_ns = 1e6 * np.cumsum(np.random.default_rng(2).uniform(shortest_ms, longest_ms, 3000))
    arrived_ns = 40e6 * np.ceil(sent_ns / 40e6) + 1e5
    unknown = {"requested_ns": np.full(3000, -1.0), "device_time_s": np.full(3000, np.nan)}
    found = robot_instants({**unknown, "first_byte_ns": arrived_ns})
    # private: what becomes of rows before gauges and robot are put together
    track = align._track(Path("run"), "robot", found, sent_ns[:, None], np.ones(3000, dtype=bool))
    late_s = 1e-9 * float(np.mean(track.ns - track.values[:, 0]))
    assert 0.5 * found.u_s < late_s < 2 * found.u_s
    (doubt,) = track.doubts
    assert doubt.startswith(f"robot: {3000 - len(track.ns)} rows ")
    assert set(track.values[:, 0]) == {sent_ns[arrived_ns == at].max() for at in np.unique(arrived_ns)}


def test_polled_robot_was_there_between_request_and_answer():
    asked_ns = np.arange(500) * 10_000_000
    took_ns = np.where(np.arange(500) % 10, 1_000_000, 9_000_000)
    stream = {"requested_ns": asked_ns, "first_byte_ns": asked_ns + took_ns, "device_time_s": np.full(500, np.nan)}
    found = robot_instants(stream)
    np.testing.assert_allclose(found.ns, asked_ns + took_ns / 2)
    assert found.u_s == pytest.approx(1e-3 / np.sqrt(12), rel=0.01)
    assert found.own_u_s[0] == pytest.approx(np.sqrt(80 / 12) * 1e-3, rel=0.01) and found.own_u_s[1] == 0

import numpy as np
import pytest

from analysis.apps.live.live_rows import NO_ROWS, NO_TRACKS, Joiner, LiveRows, LiveTrack


def track(t_s: list[float], *values: float, columns: int = 1) -> LiveTrack:
    slopes = values or (1.0,) * columns
    return LiveTrack(np.array(t_s), np.outer(t_s, slopes))


def fed(joiner: Joiner, **new: LiveTrack) -> tuple[Joiner, LiveRows]:
    return joiner.joined(new)


JOINTS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


def test_the_rows_are_at_the_instants_of_gauge_1():
    _, rows = fed(
        NO_TRACKS,
        g1=track([0.1, 0.2, 0.3], 10.0),
        g2=track([0.05, 0.15, 0.25, 0.35], -1.0),
        robot=track([0.0, 0.4], *JOINTS),
    )
    assert rows.t_s == pytest.approx([0.1, 0.2, 0.3])
    assert rows.g_mm == pytest.approx(np.array([[1, -0.1], [2, -0.2], [3, -0.3]]))
    assert rows.q[1] == pytest.approx(0.2 * np.array(JOINTS))


def test_a_row_waits_for_the_latest_instrument_and_comes_once():
    joiner, first = fed(NO_TRACKS, g1=track([0.1, 0.2]), g2=track([0.1, 0.2]), robot=track([0.0, 0.15], *JOINTS))
    joiner, none = fed(joiner)
    joiner, second = fed(joiner, robot=track([0.25], *JOINTS))
    assert first.t_s.tolist() == [0.1] and len(none) == 0 and second.t_s.tolist() == [0.2]


def test_an_instrument_that_is_silent_is_not_waited_for():
    joiner, _ = fed(NO_TRACKS, g1=track([0.1]), g2=track([0.1]), robot=track([0.1], *JOINTS))
    times = [2.0, 2.1]
    _, rows = fed(joiner, g1=track(times), robot=track(times, *JOINTS))
    assert rows.t_s.tolist() == times
    assert np.isnan(rows.g_mm[:, 1]).all() and np.isfinite(rows.q).all()


def test_without_gauges_the_rows_are_the_robots():
    _, rows = fed(NO_TRACKS, robot=track([0.0, 0.1], *JOINTS))
    assert len(rows) == 2 and np.isnan(rows.g_mm).all()


def test_no_value_is_drawn_across_a_gap():
    _, rows = fed(NO_TRACKS, g1=track([0.0, 0.4, 0.8, 1.2, 1.6]), g2=track([0.0, 0.2, 1.4, 1.6]))
    assert np.isnan(rows.g_mm[:, 1]).tolist() == [False, True, True, True, False]


def test_nothing_comes_of_nothing_and_old_rows_go():
    assert len(fed(NO_TRACKS)[1]) == 0
    some = LiveRows(np.arange(5.0), np.zeros((5, 2)), np.zeros((5, 6)))
    kept = some.followed_by(some.select_rows(slice(0, 2)), 4)
    assert kept.t_s.tolist() == [3, 4, 0, 1] and len(NO_ROWS.followed_by(NO_ROWS, 3)) == 0


def test_a_joiner_keeps_no_more_than_it_needs():
    joiner = NO_TRACKS
    for k in range(200):
        times = (k + np.arange(10) / 10).tolist()
        joiner, _ = fed(joiner, g1=track(times), robot=track(times, *JOINTS))
    assert all(len(one.t_s) < 50 for one in joiner.tracks.values())

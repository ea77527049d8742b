import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from analysis import evaluate, load_run
from analysis.apps.live.figures import angle_deg, figures, phi_deg, plain_line, shown_curves
from analysis.apps.live.live_rows import LiveRows, cell_of
from analysis.apps.live.played_run import played_run
from analysis.apps.live.screen import LiveScreen
from analysis.apps.live.view import GaugeReading, LiveEvent, LiveView, Update
from analysis.procedures.shared.joint_reversals import turns
from analysis.runs.laps import laps_of
from rigs.load import load
from tests.support.live_terminal import lines_of
from tests.support.simulated_laps import lap_run, watched, watched_lap


@pytest.fixture(scope="module")
def acw(tmp_path_factory):
    return lap_run(tmp_path_factory.mktemp("acw"))


@pytest.fixture(scope="module")
def whole(acw):
    return watched_lap(acw)


def test_band_and_shape_are_those_of_the_analysis(acw, whole):
    (curve, other), found = shown_curves(whole), evaluate(load_run(acw))
    assert curve.is_full_lap and not len(other.phi)
    # A circle angle holds the last reading of either lap there; without noise that is the curve.
    assert curve.band == pytest.approx(found.figures["band_deg"].value, rel=0.02)
    assert np.abs(curve.error - found.curve.error_deg).max() < 0.1 * np.ptp(found.curve.error_deg)


def test_the_reversals_are_those_of_the_analysis(acw, whole):
    measured = load_run(acw)
    expected = {(turn.axis, round(np.degrees(turn.phi))) for turn in turns(laps_of(measured.table, measured.rig, "x"))}
    seen = [(one.axis, np.degrees(one.phi_rad)) for one in whole.reversals]
    for axis, phi in expected:
        # The wrist that turns all the way round turns back only where the program does.
        assert any(axis == other and abs((phi - at + 180) % 360 - 180) < 3 for other, at in seen), (axis, phi)


def test_a_way_back_is_no_measurement(acw):
    unlabelled = watched(played_run(acw, 1.0), view=LiveView(played_run(acw, 1.0).cell))
    for view in (unlabelled, watched_lap(acw)):
        assert len(view.acw.curve().phi) and not len(view.cw.curve().phi)


def test_before_half_a_lap_the_mean_alone_is_taken_off(acw):
    early, _ = shown_curves(watched_lap(acw, 5.0))
    assert len(early.phi) and not early.less_sine and not early.is_full_lap
    later, _ = shown_curves(watched_lap(acw, 14.0))
    assert later.less_sine and not later.is_full_lap and later.band < early.band


def test_extremes_and_trend_are_of_the_readings(whole, acw):
    rows = played_run(acw, 1.0).rows
    assert whole.extremes_mm[:, 0] == pytest.approx(rows.g_mm.min(axis=0))
    assert whole.extremes_mm[:, 1] == pytest.approx(rows.g_mm.max(axis=0))
    rising = LiveView().after(Update(rows=ramp(0.25)))
    assert rising.trends_mm_s == pytest.approx([0.25, -0.25])


def ramp(slope_mm_s: float) -> LiveRows:
    t_s = np.arange(0.0, 3.0, 0.1)
    return LiveRows(t_s, np.outer(t_s, [slope_mm_s, -slope_mm_s]), np.full((len(t_s), 6), np.nan))


def test_restarting_forgets_curves_and_extremes(whole):
    fresh = whole.restarted()
    assert fresh.extremes_mm is None and not fresh.reversals and not len(fresh.acw.curve().phi)
    assert len(fresh.rows) == len(whole.rows)


def test_the_next_recording_of_a_direction_replaces_its_curve_alone(whole):
    other = whole.labelled("b", "yaw", "cw")
    assert len(other.acw.curve().phi)
    assert not len(whole.labelled("c", "yaw", "acw").acw.curve().phi)
    assert not len(other.labelled("d", "roll", "cw").acw.curve().phi)
    assert len(whole.labelled(None, None, None).acw.curve().phi)


def state(**faults: int) -> dict[str, Any]:
    stream = {"connected": True, "rate_hz": 1.0, "counters": faults, "last": {}, "age_s": {}, "last_fault": "no answer"}
    return {"rig": "cell", "recording": None, "streams": {"g1": stream}, "automatic": None, "last_end": ""}


def test_new_faults_become_events_and_old_ones_do_not():
    view = LiveView().after(Update(state=state(silent=3)))
    assert not view.events
    view = view.after(Update(state=state(silent=5, garbled=1)))
    assert [event.words for event in view.events] == ["g1: 2 silent, 1 garbled: no answer"]
    lost = state(silent=5, garbled=1)
    lost["streams"]["g1"]["connected"] = False
    assert view.after(Update(state=lost)).events[-1].words == "g1: connection lost"


def recording(name: str, run: str) -> dict[str, Any]:
    return {**state(), "recording": name, "run": run, "test": "yaw", "direction": "acw", "seconds": 1.0}


def words_after(*updates: Update) -> list[str]:
    view = LiveView().after(Update(state=state(), readings={}))
    for update in updates:
        view = view.after(update)
    return [event.words for event in view.events]


def test_a_recording_that_was_cut_is_an_event():
    begun = Update(state=recording("lap", "runs/1_lap"), readings={})
    lost, back = Update(lost="waiting"), Update(readings={})
    words = words_after(begun, lost, lost, lost, back, Update(state=state(), readings={}))
    begin, lost, again, cut = words
    assert "lap" in begin and begin.endswith("runs/1_lap") and "lap" in lost
    assert "answers again" in again and "interrupted" in cut


def test_interrupted_recording_is_shown_until_the_next():
    begun, ended = (Update(state=one, readings={}) for one in (recording("lap", "runs/1_lap"), state()))
    view = LiveView().after(begun).after(Update(lost="waiting")).after(ended).after(ended)
    assert "interrupted" in figures(view)["cut"]
    assert "interrupted" in plain_line(view)
    assert "interrupted" in lines_of(LiveScreen(view), 80, 24)[0]
    assert figures(view.after(begun))["cut"] is None


def test_a_recording_that_ended_is_no_cut():
    begun = Update(state=recording("lap", "runs/1_lap"), readings={})
    ended = Update(state={**state(), "last_end": "complete: asked"}, readings={})
    (ended_as,) = words_after(begun, begun, ended, ended)[1:]
    assert ended_as.endswith("lap ended: complete: asked")
    another = Update(state=recording("lap", "runs/2_lap"), readings={})
    one, other = words_after(begun, another)[1:]
    assert one.endswith("lap ended") and other.endswith("lap began: runs/2_lap")


def test_a_notice_is_an_event_and_does_not_end_a_loss():
    view = LiveView(lost="waiting").after(Update(notice="no circle"))
    assert view.lost and view.events[-1].words == "no circle" and not view.after(Update(readings={})).lost


def test_reversals_are_counted_beyond_the_events_that_are_kept():
    q = np.zeros((1201, 6))
    q[:, 2] = np.radians(np.arange(1201) % 2 * 5.0)
    view = LiveView(cell_of(load("ur10e-cell")[0])).after(
        Update(rows=LiveRows(np.arange(1201.0), np.zeros((1201, 2)), q))
    )
    noisy = view.after(Update(state=state(silent=0)))
    for count in range(1, 300):
        noisy = noisy.after(Update(state=state(silent=count)))
    assert noisy.reversal_counts == (0, 0, 1199, 0, 0, 0) and noisy.last_reversals[3].t_s == 1199.0
    found = json.loads(json.dumps(figures(noisy)))
    assert found["reversals"] == 1199 and found["joints_reversals"] == [0, 0, 1199, 0, 0, 0]
    assert "1199 reversals" in plain_line(noisy)
    fresh = noisy.restarted()
    assert fresh.reversal_counts == (0,) * 6 and not fresh.last_reversals


def test_another_rig_file_begins_curves_and_reversals_again(whole):
    other = replace(whole, events=(*whole.events, LiveEvent(0.0, "g1: lost"))).after(Update(cell=whole.cell))
    assert not other.reversals and sum(other.reversal_counts) == 0 and other.events == (LiveEvent(0.0, "g1: lost"),)


def test_figures_are_plain_types_with_missing_ones_marked(whole):
    found = figures(whole)
    assert found["direction"] == "acw" and set(found["gauges"]) == {"g1", "g2"}
    assert len(found["joints_deg"]) == 6
    nothing = figures(LiveView())
    assert nothing["angle_deg"] is None and nothing["phi_deg"] is None and nothing["gauges"] == {}
    assert plain_line(LiveView(lost="gone")) == "gone"
    assert "0.1000 mm" in plain_line(LiveView(readings={"g1": GaugeReading(0.1, 0.0)}))
    zeroed = plain_line(LiveView(readings={"g1": GaugeReading(0.1, 0.0), "g2": GaugeReading(0.3, 0.0)}), (0.02, 0.0))
    assert "g1 0.0800 mm less 0.0200; g2 0.3000 mm;" in zeroed
    assert "5 s old" in plain_line(LiveView(readings={"g1": GaugeReading(0.1, 5.0)}))


def test_the_angle_follows_the_zero_of_the_view(whole):
    zeros = (whole.readings["g1"].mm, whole.readings["g2"].mm)
    assert angle_deg(whole) != pytest.approx(0.0, abs=1e-3)
    assert angle_deg(whole, zeros) == pytest.approx(0.0, abs=1e-12)
    assert phi_deg(whole) is not None

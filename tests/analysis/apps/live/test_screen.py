from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.cells import cell_len

from analysis.apps.live.screen import LiveScreen, sparkline
from analysis.apps.live.view import GaugeReading, LiveView, Played
from tests.support.live_terminal import lines_of, screen_of
from tests.support.simulated_laps import lap_run, watched_lap

EVIL = "a\x1b]0;title\x07\x1b[31m\nforged\r\u202e机机"
SIZES = [(1, 1), (2, 50), (300, 1), (20, 5), (59, 17), (60, 18), (80, 24), (81, 25), (100, 30), (120, 40), (160, 50)]
SIZES += [(169, 41), (170, 41), (250, 70), (60, 200), (400, 18)]


def evil_state() -> dict[str, object]:
    stream = {
        "connected": False,
        "rate_hz": 1.0,
        "counters": {EVIL: 3, "samples": 1},
        "last": {"g1_mm": 1.0},
        "age_s": {"g1_mm": 100.0},
        "last_fault": EVIL,
    }
    clock = {"late_s": 0.1, "drift_ppm": None, "offset_s": 0.0}
    return {
        "rig": EVIL,
        "recording": EVIL,
        "test": EVIL,
        "direction": None,
        "seconds": 1.0,
        "automatic": {"waits_for": [EVIL], "why_not": EVIL},
        "last_end": EVIL,
        "streams": dict.fromkeys([EVIL, *(f"s{k}" for k in range(9))], stream),
        "clocks": {EVIL: clock},
        "host": {EVIL: 1},
        "disk": {"free_bytes": 1, "size_bytes": 100},
        "samples": {},
        "synced": {EVIL: 1},
    }


@pytest.fixture(scope="module")
def views(tmp_path_factory):
    whole = watched_lap(lap_run(tmp_path_factory.mktemp("lap")))
    one_gauge = watched_lap(lap_run(tmp_path_factory.mktemp("paper"), "paper-fanuc"), 6.0)
    return [
        LiveView(),
        LiveView(lost=EVIL),
        LiveView(state=evil_state(), name=EVIL, test=EVIL, readings={"g1": GaugeReading(-1e9, 100.0)}),
        whole,
        one_gauge,
        LiveView(played=Played(EVIL, 1.0, 2.0, 64.0)),
    ]


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_a_screen_is_not_larger_than_the_terminal(views, width, height):
    for view in views:
        lines = lines_of(LiveScreen(view, (0.5, -0.5)), width, height)
        assert len(lines) <= height
        assert max(cell_len(line) for line in lines) <= width
        assert all(line.isprintable() for line in lines)


@settings(max_examples=40)
@given(width=st.integers(1, 260), height=st.integers(1, 80))
def test_no_size_breaks_it(width, height):
    lines = lines_of(LiveScreen(LiveView(readings={"g1": GaugeReading(0.1, 0.0)})), width, height)
    assert max(cell_len(line) for line in lines) <= width and len(lines) <= height


@pytest.mark.parametrize(("width", "height"), [(80, 24), (120, 40), (250, 70)])
def test_a_lap_is_shown_whole(views, width, height):
    text = "\n".join(lines_of(LiveScreen(views[3]), width, height))
    for words in ("g1 mm", "g2 mm", "yaw", "φ", "acw", "min", "max", "1 base", "reversals", "turned back"):
        assert words in text, (words, text)
    assert sum(character in "▁▂▃▄▅▆▇█" for character in text) > 60
    assert "┏━" in text  # large digits


def test_missing_values_are_announced():
    text = "\n".join(lines_of(LiveScreen(LiveView()), 80, 24))
    assert text.count(" yet") >= 3


def test_a_loss_of_the_daemon_is_on_every_size():
    for width, height in ((30, 5), (80, 24), (250, 70)):
        assert "gone" in "\n".join(lines_of(LiveScreen(LiveView(lost="gone")), width, height))


def connected_state() -> dict[str, object]:
    stream = {"connected": True, "rate_hz": 95.2, "counters": {}, "last": {}, "age_s": {}, "last_fault": ""}
    return {"rig": "ur10e", "recording": None, "streams": {"g1": stream}, "automatic": None, "last_end": ""}


def test_disturbed_robot_shows_its_condition():
    state = connected_state()
    last = {"safety_state": 2.0, "program_state": 1.0, "speed_percent": 40.0, "temperature1_c": 30.0}
    ages_s = {**dict.fromkeys(last, 0.1), "temperature1_c": 100.0}
    robot = {**state["streams"]["g1"], "last": last, "age_s": ages_s}
    view = LiveView(state={**state, "streams": {"robot": robot}})
    text = "\n".join(lines_of(LiveScreen(view), 120, 40))
    assert "protective stop · speed 40 %" in text and "silent" not in text
    ages_s["safety_state"] = 100.0
    text = "\n".join(lines_of(LiveScreen(view), 120, 40))
    assert "protective stop" not in text and "speed 40 %" in text  # what is no longer shown


def test_figures_are_marked_while_the_daemon_is_lost(views):
    view = replace(views[3], played=None, state=connected_state())
    assert "connected" in "\n".join(lines_of(LiveScreen(view), 80, 24))
    lines = screen_of(LiveScreen(replace(view, lost="gone")), 80, 24)
    text = "\n".join("".join(segment.text for segment in row) for row in lines)
    assert "last known" in text and "connected" not in text and "95.2" in text
    assert all(segment.style.dim for row in lines for segment in row if "┏" in segment.text)
    assert "bold red" in {str(segment.style) for segment in lines[0]}


def test_sparkline_ends_with_the_newest_value_and_keeps_noise_flat():
    t_s = np.arange(0.0, 20.0, 0.1)
    assert sparkline(t_s, t_s, 10) == "▁▂▂▃▄▅▅▆▇█" or sparkline(t_s, t_s, 10)[-1] == "█"
    assert set(sparkline(t_s, 1e-5 * (t_s % 0.2), 10)) == {"▁"}
    assert sparkline(t_s, np.full(len(t_s), np.nan), 10) == ""
    assert sparkline(t_s[-50:], t_s[-50:], 10).startswith(" ")

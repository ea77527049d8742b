"""On a narrow screen nothing is cut off."""

import io

from rich.console import Console

from analysis.cli.daemon_screen import screen

STREAM = {"connected": True, "rate_hz": 53.5, "last": {}, "age_s": {}, "counters": {"samples": 1333}, "last_fault": ""}
STATE = {
    "rig": "cell",
    "recording": None,
    "last_end": "",
    "automatic": None,
    "baseline_mm": 50.0,
    "streams": {"g1": STREAM, "robot": STREAM | {"rate_hz": 100.0}},
}


def shown(what: object, width: int) -> str:
    console = Console(width=width, file=io.StringIO())
    with console.capture() as text:
        console.print(what)
    return text.get()


def test_50_columns_hold_the_links_of_a_daemon_a_line_each():
    text = shown(screen(STATE), 50)
    assert [line.split() for line in text.splitlines() if "connected" in line] == [
        ["g1", "connected", "53.5", "Hz", "1333", "none"],
        ["robot", "connected", "100.0", "Hz", "1333", "none"],
    ]


def test_the_condition_of_the_robot_is_a_row_of_the_status():
    last = {
        "safety_state": 2.0,
        "program_state": 2.0,
        "speed_percent": 40.0,
        "temperature1_c": 31.0,
        "temperature2_c": 36.4,
    }
    robot = STREAM | {"last": last, "age_s": dict.fromkeys(last, 0.1)}
    text = shown(screen(STATE | {"streams": {"robot": robot}}), 120)
    assert "protective stop · program paused · speed 40 % · joints 31 to 36 °C" in text
    old = STREAM | {"last": last, "age_s": dict.fromkeys(last, 9.0)}
    assert "9 s old" in shown(screen(STATE | {"streams": {"robot": old}}), 120)
    assert "protective" not in shown(screen(STATE), 120)

import signal

import pytest

from tests.support.bench import BIN
from tests.support.live_terminal import Terminal
from tests.support.simulated_laps import lap_run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return lap_run(tmp_path_factory.mktemp("lap"))


@pytest.fixture
def playing(run):
    command = [BIN / "rig", "live", "--run", run, "--speed", "64"]
    with Terminal(command, 120, 40, {"COLUMNS": "80", "LINES": "24"}) as terminal:
        terminal.until(lambda text: "ended" in text and "yaw" in text)
        yield terminal


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_the_terminal_as_it_was(playing, end):
    playing.process.send_signal(end)
    assert playing.ended() == 0 and playing.is_as_before()
    assert b"\x1b[?1049l" in playing.received


def test_a_resized_terminal_shows_no_old_fragments(playing):
    for width, height in [(80, 24), (40, 8), (200, 50), (100, 30)]:
        playing.resize(width, height)
        playing.until(lambda text, h=height: is_fresh(text, h), f"{width} x {height}")


def is_fresh(text: str, height: int) -> bool:
    """True if both gauges are shown once."""
    lines = text.split("\n")
    return "reversals" in text and len(lines) == height and text.count("g1 ") == 1 and text.count("g2 ") == 1

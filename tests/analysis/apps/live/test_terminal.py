import io
import signal

import pyte
import pytest
from rich.console import Console

from analysis.apps.live.controls import LiveControls
from analysis.apps.live.loop import ChangingPicture
from analysis.apps.live.screen import LiveScreen
from analysis.apps.live.view import LiveView
from tests.support.bench import BIN
from tests.support.live_terminal import Terminal, lines_of
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


def test_only_changed_rows_are_sent():
    out, terminal = io.StringIO(), pyte.Screen(80, 24)
    console, stream = Console(file=out, width=80, height=24, force_terminal=True), pyte.Stream(terminal)
    shown = ChangingPicture(console)

    def sent(width: int, height: int, message: str = "") -> int:
        """Characters sent for a picture, which the terminal must then show."""
        picture = LiveScreen(LiveView(), LiveControls(message=message))
        out.seek(out.truncate(0))
        shown.show(picture)
        stream.feed(out.getvalue())
        expected = [line.rstrip() for line in lines_of(picture, width, height)]
        assert [line.rstrip() for line in terminal.display] == expected
        return len(out.getvalue())

    with console.screen():
        whole = sent(80, 24, "recorded")
        assert sent(80, 24, "recorded") == 0 and 0 < sent(80, 24, "stopped") < whole / 10
        shown.redraw()
        assert sent(80, 24, "recorded") == whole
        for width, height in [(30, 6), (200, 60), (61, 18)]:
            terminal.resize(height, width)
            console.size = width, height
            assert sent(width, height) > 0


def test_keys_of_a_person_reach_the_view(playing):
    playing.type("u")
    playing.until(lambda text: "g1 µm" in text, "units")
    playing.type("z")
    playing.until(lambda text: "are unchanged" in text and "less " in text, "zero")
    playing.type("?")
    playing.until(lambda text: "─ keys ─" in text, "help")
    playing.type("\x1b[A")  # an arrow key is none of ours
    playing.type("s")
    playing.until(lambda text: "label (name" in text, "prompt")
    playing.type("lap yaw acw\r")
    playing.until(lambda text: "be recorded" in text, "start")
    playing.type("q")
    assert playing.ended() == 0 and playing.is_as_before()
    assert playing.process.stderr.read() == b""
    assert playing.received.endswith(b"\x1b[?1049l\x1b[?25h")


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_the_terminal_as_it_was(playing, end):
    playing.process.send_signal(end)
    assert playing.ended() == 0 and playing.is_as_before()
    assert b"\x1b[?1049l" in playing.received


def test_a_resized_terminal_shows_no_old_fragments(playing):
    for width, height in [(80, 24), (40, 8), (200, 50), (100, 30)]:
        playing.resize(width, height)
        marker = "q quit" if width >= 80 else "reversals"
        text = playing.until(lambda text, w=width, m=marker: is_fresh(text, w, m), f"{width} x {height}")
        assert text.count("g1 ") == 1 and text.count("g2 ") == 1
        assert text.count("q quit") <= 1 and text.count("trace") == (width >= 80)


def is_fresh(text: str, width: int, marker: str) -> bool:
    """Whether the picture is that of this width and whole: both gauges are there, the keys stand in the last row, and
    nothing beyond the edge."""
    lines = text.split("\n")
    if "g1 " not in text or "g2 " not in text:  # half of it is drawn
        return False
    if width < 60:
        return marker in text and "trace" not in text
    return marker in lines[-1] and len(lines[-1]) == width and text.count("min ") == 2

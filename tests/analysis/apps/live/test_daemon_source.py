import json
import socket
import threading
import time
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.apps.live.daemon_source import DaemonSource, tracks_of
from analysis.apps.live.figures import figures, plain_line
from analysis.apps.live.view import LiveView
from rigs.errors import CellError
from rigs.load import find
from tests.support.live_terminal import PATIENCE_S

STATUS = {
    "ok": True,
    "rig": "ur10e",
    "baseline_mm": 50.0,
    "streams": {},
    "automatic": None,
    "recording": None,
    "last_end": "",
}


class FakeDaemon:
    def __init__(self, path: Path, rig_text: str | None = None) -> None:
        self.asked = []
        self.rig_text = find("ur10e-cell").read_text() if rig_text is None else rig_text
        self.answers = self.usual
        self._path = path
        path.parent.mkdir(mode=0o700, exist_ok=True)
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(path))
        path.chmod(0o660)
        self._listener.listen()
        self._open = []
        threading.Thread(target=self._serve, daemon=True).start()

    def usual(self, request: dict[str, Any]) -> dict[str, Any]:
        if request["command"] == "status":
            return STATUS
        now_ns = time.monotonic_ns()
        number = request["after"].get("g1", 0) + 2
        rows = [[now_ns - 50_000_000, 0.1 * number], [now_ns, 0.1 * number]]
        stream = {"newest": number, "columns": ["g1_mm"], "rows": rows}
        lines = self.rig_text.splitlines() if request["rig"] else []
        return {"ok": True, "now_ns": now_ns, "streams": {"g1": stream}, "rig_lines": lines}

    def close(self) -> None:
        for sock in [self._listener, *self._open]:
            with suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)
            sock.close()
        self._path.unlink(missing_ok=True)

    def _serve(self) -> None:
        with suppress(OSError):
            while True:
                sock, _ = self._listener.accept()
                self._open.append(sock)
                threading.Thread(target=self._answer, args=(sock,), daemon=True).start()

    def _answer(self, sock: socket.socket) -> None:
        with suppress(OSError), sock.makefile("rb") as lines:
            for line in lines:
                self.asked.append(json.loads(line))
                sock.sendall(json.dumps(self.answers(self.asked[-1])).encode() + b"\n")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "rigd" / "ur10e.sock"


@pytest.fixture
def watched(path):
    """A daemon, and a source that watches it."""
    with closing(FakeDaemon(path)) as daemon, DaemonSource(path) as source:
        yield daemon, source


def watched_until(source: DaemonSource, view: LiveView, shown: Callable[[LiveView], object]) -> LiveView:
    end_s = time.monotonic() + PATIENCE_S
    while not shown(view):
        assert time.monotonic() < end_s, view
        for update in source.updates():
            view = view.after(update)
        time.sleep(0.02)
    return view


def test_samples_become_rows_and_each_is_asked_for_once(watched):
    daemon, source = watched
    view = watched_until(source, LiveView(), lambda view: len(view.rows) > 6 and view.state)
    assert view.cell.name == "ur10e"
    assert view.readings["g1"].age_s < 5 and (np.diff(view.rows.t_s) > 0).all()
    asked = [request for request in list(daemon.asked) if request["command"] == "samples"]
    assert [request["rig"] for request in asked][:3] == [True, False, False]
    assert [request["after"] for request in asked][:3] == [{}, {"g1": 2}, {"g1": 4}]
    # Its whole state, which is dear, is asked for less often.
    assert sum(request["command"] == "status" for request in list(daemon.asked)) < len(asked)


def test_a_further_gauge_is_shown_and_no_row_waits_for_it(watched):
    daemon, source = watched

    def once(request: dict[str, Any]) -> dict[str, Any]:
        answer = daemon.usual(request)
        if request["command"] == "samples" and "g3_g4" not in request["after"]:
            rows = [[answer["now_ns"] - 10**10, 0.25, None], [answer["now_ns"] - 10**10 + 1, None, None]]
            answer["streams"]["g3_g4"] = {"newest": 2, "columns": ["g3_mm", "g4_mm"], "rows": rows}
        elif request["command"] == "samples":
            answer["streams"]["g3_g4"] = {"newest": 2, "columns": ["g3_mm", "g4_mm"], "rows": []}
        return answer

    daemon.answers = once
    view = watched_until(source, LiveView(), lambda view: len(view.rows) > 6 and "g3" in view.readings)
    assert view.readings["g3"].mm == 0.25 and 10 <= view.readings["g3"].age_s < 20 and "g4" not in view.readings
    assert figures(view)["gauges"]["g3"]["mm"] == 0.25
    assert "g3 0.2500 mm" in plain_line(view)


def test_lost_daemon_is_awaited_and_its_values_stay(watched, path):
    daemon, source = watched
    view = watched_until(source, LiveView(), lambda view: view.cell and len(view.rows) > 3)
    daemon.close()
    view = watched_until(source, view, lambda view: view.lost)
    assert "waiting" in view.lost
    before, cell = len(view.rows), view.cell
    with closing(FakeDaemon(path)):
        view = watched_until(source, view, lambda view: not view.lost and len(view.rows) > before)
    assert view.cell is cell  # the same rig file is not read again


def test_an_older_rigd_is_named(watched):
    refusal = {"ok": False, "where": "rigd", "what": "unknown command 'samples'", "remedy": "x", "exit_code": 4}
    daemon, source = watched
    daemon.answers = lambda request: STATUS if request["command"] == "status" else refusal
    watched_until(source, LiveView(), lambda view: "older" in view.lost)


def test_foreign_answer_is_reported_and_asked_again(watched):
    daemon, source = watched
    daemon.answers = lambda request: {"ok": True, "streams": {}}
    watched_until(source, LiveView(), lambda view: "than rigd" in view.lost)
    daemon.answers = daemon.usual
    watched_until(source, LiveView(), lambda view: len(view.rows))


def test_a_rig_file_that_cannot_be_read_leaves_the_readings(path):
    with closing(FakeDaemon(path, "name: [")), DaemonSource(path) as source:
        view = watched_until(source, LiveView(), lambda view: len(view.rows) > 2)
        assert view.cell is None and "g1" in view.readings


def test_without_a_daemon_it_does_not_begin(path):
    with pytest.raises(CellError), DaemonSource(path):
        pass


def test_values_that_are_not_there_are_left_out():
    streams = {
        "g1_g2": {"newest": 2, "columns": ["g1_mm", "g2_mm"], "rows": [[1e9, 0.1, None], [2e9, 0.2, 0.3]]},
        "robot": {"newest": 0, "columns": [f"q{axis}_deg" for axis in range(1, 7)], "rows": []},
    }
    tracks = tracks_of(streams)
    assert tracks["g1"].t_s.tolist() == [1, 2] and tracks["g2"].values.tolist() == [[0.3]] and "robot" not in tracks


def test_readings_of_a_gauge_that_counts_towards_are_turned():
    streams = {"g1_g2": {"newest": 1, "columns": ["g1_mm", "g2_mm"], "rows": [[1e9, 0.1, 0.2]]}}
    tracks = tracks_of(streams, (1, -1))
    assert tracks["g1"].values.tolist() == [[0.1]] and tracks["g2"].values.tolist() == [[-0.2]]

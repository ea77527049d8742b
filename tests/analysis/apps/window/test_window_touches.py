import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis import load_run
from analysis.apps.report.texts import texts_of
from analysis.apps.window.watcher import Watcher
from analysis.apps.window.window_check import WindowCheck
from daq.store.marks import load_marks
from rigs.errors import UseError
from tests.support.moved_cell import moved_cell, touch_near, write_touches
from tests.support.refusals import refused
from tests.support.windows import Served, no_daemon, served


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("moved")
    yield moved_cell(folder, "zero 3"), folder


def _post(window: Served, step: str, **fields: str) -> dict[str, Any]:
    form = "&".join(f"{name}={value}" for name, value in fields.items())
    answer = window.post(f"/control/moved-{step}", f"secret={window.window.gate.secret}&{form}")
    return json.loads(answer.text)


def _targets(page: str) -> list[float]:
    return [float(deg) for deg in re.findall(r'data-target="([^"]+)"', page)]


def test_moved_zero_is_found_by_touches_and_stored(case):
    drawn, folder = case
    with served(folder, control=True, session=folder / "session") as window:
        assert "before: " in window.ask("/moved").text
        assert 'id="offer"' in window.ask("/session").text  # the session offers the check first
        assert _post(window, "begin", run="nothing")["ok"] is False
        assert _post(window, "begin", run="before")["ok"]
        page = window.ask("/moved").text
        assert len(_targets(page)) == 6
        answers = []
        for _ in range(6):
            q = touch_near(drawn, _targets(page))
            assert _post(window, "touch", joints="+".join(f"{deg:.4f}" for deg in q))["ok"]
            page = window.ask("/moved").text
            answers.append(page.split('id="answer">')[1].split("<")[0])
            if not _targets(page):
                break
        assert "axis 3" in answers[-1], answers
        assert "Achse 3" in window.ask("/moved", accept_language="de").text
        run = Path(_post(window, "save")["said"])
        assert len(load_run(run).table.q) == len(answers)
        moved = load_marks(run).moved
        assert (moved.what, moved.axis, moved.reference) == ("zero", 3, ("before",))
        assert 'value="before"' in window.ask("/moved").text  # the next check can begin


def test_a_wrong_touch_is_refused_or_removed(case):
    drawn, folder = case
    with served(folder, control=True) as window:
        assert _post(window, "touch", joints="1+2+3+4+5+6")["code"] == "session.missing"
        _post(window, "begin", run="before")
        assert _post(window, "touch", joints="1+2+3")["code"] == "request.invalid"
        assert not _post(window, "touch", joints="10+20+30+40+50+60")["ok"]
        assert not _post(window, "touch")["ok"]  # there is no daemon
        q = "%2C+".join(f"{deg:.4f}" for deg in np.degrees(drawn.before[0]))
        assert _post(window, "touch", joints=q)["ok"] and "1 touches" in window.ask("/moved").text
        assert _post(window, "undo")["ok"] and "0 touches" in window.ask("/moved").text
        assert not _post(window, "save")["ok"]
        assert _post(window, "cancel")["ok"] and _post(window, "undo")["code"] == "session.missing"


def test_recorded_runs_are_compared_in_the_list(case):
    drawn, folder = case
    write_touches(folder, "zz-after", *drawn.touch_again(6))
    with served(folder) as window:
        assert window.ask("/moved/runs?run=before").status == 400
        page = window.until("/moved/runs?run=before&run=zz-after", lambda answer: answer.status != 202)
        assert page.status == 303
        assert "axis 3" in window.ask(page.headers["location"]).text


class _Daemon(Watcher):
    def __init__(self, rows: list[list[float | None]]) -> None:
        super().__init__(no_daemon, None)
        self._robot = {"rows": rows, "columns": [f"q{k}_deg" for k in range(1, 7)], "newest": len(rows)}

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        return {"streams": {"robot": self._robot}}


def _rows(q_deg: np.ndarray, drift_deg: float) -> list[list[float | None]]:
    return [[int(1e8 * k), *(q_deg + drift_deg * k)] for k in range(20)]


def test_touch_of_a_moving_robot_is_refused(case):
    drawn, folder = case
    q = np.degrees(drawn.before[1])
    check = WindowCheck(_Daemon(_rows(q, 0.0)), folder / "runs")
    check.do("begin", {"run": "before"})
    check.do("touch", {})
    np.testing.assert_allclose(np.degrees(check.check.touches[0][1]), q)
    incomplete = [[0, None, *q[1:].tolist()]]
    for rows, code in (
        (_rows(q, 0.1), "robot.moving"),
        ([], "robot.silent"),
        (incomplete, "robot.silent"),
    ):
        moving = WindowCheck(_Daemon(rows), folder / "runs")
        moving.do("begin", {"run": "before"})
        with refused(code):
            moving.do("touch", {})
    with pytest.raises(UseError):
        check.do("begin", {"run": "../before"})


def test_the_action_of_each_cause_has_its_sentence_in_each_language():
    alone = ("nothing", "instrument", "target", "tool", "other", "zero", "socket")
    kinds = (*alone, "base_or_plate", "base_or_instrument")
    for language in ("en", "de", "ko"):
        texts = texts_of(language)
        assert len({texts(f"check_act_{kind}", axis=3, name="A") for kind in kinds}) == len(kinds)

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis import load_run
from analysis.apps.commission import guided_touches
from analysis.apps.commission.cell_references import references_of
from analysis.apps.commission.guided_touches import GuidedCheck, follow_touches, mark_of
from analysis.apps.commission.touched_ball import REST_S
from analysis.apps.session.run_session import offer_lines
from analysis.movement.inference import FEWEST_OF_REFERENCE
from daq.store import mark_moved
from daq.store.marks import load_marks
from tests.support.command_line import errors_of, json_of, succeeded
from tests.support.moved_cell import Case, moved_cell, touch_near, write_touches
from tests.support.refusals import refused
from tests.support.simulated_laps import lap_run

EVERY_S = 0.1


class Person:
    """A daemon whose robot is led to each posture that was proposed, at most 15, and what was said."""

    def __init__(self, case: Case, first: np.ndarray | None = None) -> None:
        self._case, self.said = case, list[str]()
        self._at = np.degrees(case.before[0]) + 5.0
        self._sent, self._first = 0, first
        self.rests_first = None

    def say(self, line: str) -> None:
        self.said.append(line)

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        if sum("J1 " in line for line in self.said) > 15:
            raise KeyboardInterrupt
        proposed = [float(deg) for deg in re.findall(r"J\d (-?[\d.]+)", _last_proposal(self.said))]
        goal = touch_near(self._case, proposed)
        if self._first is not None:
            goal, self._first = self._first, None
        lifted = self._at + 10.0  # a proposal may be the posture of the touch before
        way = lifted + np.linspace(0, 1, 20)[:, None] * (goal - lifted)
        rest = round((REST_S + 0.5) / EVERY_S)
        rows = [*way, *[goal] * rest]
        if self.rests_first is not None:
            rows, self.rests_first = [*[self.rests_first] * rest, *rows], None
        self._at = goal
        begin, self._sent = self._sent, self._sent + len(rows)
        samples = [[int(1e9 * EVERY_S * (begin + k)), *row] for k, row in enumerate(rows)]
        return {
            "streams": {"robot": {"rows": samples, "columns": [f"q{k}_deg" for k in range(1, 7)], "newest": self._sent}}
        }


def _last_proposal(said: list[str]) -> str:
    return next(line for line in reversed(said) if "J1 " in line)


def before(folder: Path) -> GuidedCheck:
    return GuidedCheck.of_runs([load_run(folder / "runs" / "before")])


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch):
    monkeypatch.setattr("analysis.apps.commission.joint_samples._POLL_S", 0.0)  # private: no waiting


def test_a_person_is_led_to_the_cause_and_the_touches_are_kept(tmp_path):
    case = moved_cell(tmp_path, "zero 2", seed=4)
    check = before(tmp_path)
    person = Person(case, first=np.degrees(case.before[0]) + 40.0)
    check = follow_touches(person, check, person.say)
    assert check.is_decided and check.result.named is not None
    assert (check.result.named.what, check.result.named.cause.axis) == ("zero", 2)
    assert len(check.touches) <= 4 and "seat " in "".join(person.said)
    run = check.save(tmp_path / "runs" / "after", "ada")
    assert len(load_run(run).table.q) == len(check.touches)
    with refused("readings.too_few", "no touch was taken"):
        before(tmp_path).save(tmp_path / "empty", "")


def test_unmoved_is_concluded_only_after_enough_touches(tmp_path):
    case = moved_cell(tmp_path, "nothing", seed=5)
    person, check = Person(case), before(tmp_path)
    check = follow_touches(person, check, person.say)
    assert check.result.named.what == "nothing"
    assert len(check.touches) >= 4
    answers = [line for line in person.said if "touch " in line and "agree" in line]
    assert all("nothing moved" in line for line in answers[:3])
    assert sum("Next: touch" in line for line in person.said) == len(check.touches)  # each touch is proposed


def test_the_posture_at_the_start_is_no_touch(tmp_path):
    case = moved_cell(tmp_path, "zero 2", seed=4)
    check = before(tmp_path)
    person = Person(case)
    person.rests_first = np.degrees(case.before[3])
    check = follow_touches(person, check, person.say)
    assert check.result.named.what == "zero"
    assert all(np.abs(q - case.before[3]).max() > 1e-9 for _, q in check.touches)


def test_the_command_follows_the_daemon_and_history_marks_the_day(tmp_path, monkeypatch):
    case = moved_cell(tmp_path, "tool", seed=3)
    person = Person(case)
    follow = guided_touches.follow_touches
    monkeypatch.setattr("daq.service.client.find_socket", lambda name: tmp_path / name)
    monkeypatch.setattr("daq.service.client.Client", _Client)
    monkeypatch.setattr(guided_touches, "follow_touches", lambda _, check, say: follow(person, check, person.say))
    runs = tmp_path / "runs"
    words = ["moved", runs / "before", "--live", "--save", runs / "after"]
    done = succeeded(*words)
    assert done.stdout.startswith("The tool ")
    marked = load_marks(runs / "after").moved
    assert (marked.what, marked.reference) == ("tool", ("before",))
    errors_of(*words)  # an existing run is not overwritten
    page = tmp_path / "history.html"
    (movement,) = json_of(f"history moved --runs {runs} -o {page}")["movements"]
    assert (movement["run"], movement["what"], movement["reference"]) == ("after", "tool", ["before"])
    assert "The tool" in page.read_text()
    for wrong in (["--live", "--plan"], ["--save", "x"]):
        errors_of("moved", runs, *wrong, exit_code=2)


class _Client:
    def __init__(self, socket: Path) -> None:
        assert socket.name == "moved"

    def __enter__(self) -> _Client:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def test_an_answer_is_stored_with_new_runs_only_if_asked(tmp_path):
    case = moved_cell(tmp_path, "base", seed=2)
    write_touches(tmp_path, "after", *case.touch_again(6))
    words = ["moved", tmp_path / "runs" / "before", "--new", tmp_path / "runs" / "after"]
    succeeded(*words)
    assert load_marks(tmp_path / "runs" / "after").moved is None
    succeeded(*words, "--mark")
    marked = load_marks(tmp_path / "runs" / "after").moved
    assert marked.what == "base"
    assert marked.answer.startswith("The base ")
    table = [*words[:-1], tmp_path / "after.csv", "--rig", tmp_path / "cell.yaml", "--mark"]
    errors_of(*table, exit_code=2)


def test_references_are_enough_touches_or_circles_of_both_directions_and_no_check(tmp_path):
    case = moved_cell(tmp_path, "nothing")
    runs = tmp_path / "runs"
    write_touches(tmp_path, "few", case.sockets[: FEWEST_OF_REFERENCE - 1], case.before[: FEWEST_OF_REFERENCE - 1])
    checked = write_touches(tmp_path, "checked", case.sockets, case.before + 1e-4)
    check = GuidedCheck.of_runs([load_run(runs / "before")]).with_touch(case.before[0])
    mark_moved(checked, mark_of(check.result, ["before"]))
    assert [[run.name for run in one.runs] for one in references_of([runs, tmp_path / "missing"], "moved")] == [
        ["before"]
    ]
    lap_run(runs, direction="acw", seed=1)
    assert len(references_of([runs])) == 1  # one direction is no reference
    lap_run(runs, direction="cw", seed=1)
    touches, circles = references_of([runs])
    assert touches.can_be_touched and not circles.can_be_touched and len(circles.runs) == 2
    assert references_of([runs], "other") == []
    first, second = offer_lines("moved", [runs])
    assert f"{len(case.sockets)} readings" in first and second == f"  rig moved {runs / 'before'} --live"
    assert list(offer_lines("other", [runs])) == []

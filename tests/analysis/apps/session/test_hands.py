"""An emulated cell of a session: the lines typed at its events, and errors that end the session."""

import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from analysis.apps.emulate.served_cell import CellEvent, Keyboard
from analysis.apps.session.answer import Inference
from analysis.apps.session.cell import Machine, ServedCell
from analysis.apps.session.session_state import Emulated, Session, Stage
from rigs.errors import CellError
from rigs.load import find
from tests.support.refusals import refused
from tests.support.session_cell import Screen, asked_for, begun

PROGRAM = SimpleNamespace(name="p01-yaw-acw")


class Cell(ServedCell):
    """An emulated cell with scripted responses: `answers` to each typed line."""

    runs = True

    def __init__(self, session: Session, directory: Path, answers: dict[str, tuple[CellEvent, ...]]) -> None:
        session = session.model_copy(update={"emulated": Emulated()})
        super().__init__(session, directory, Screen(), asked_for(session))
        self.answers = answers
        self.typed = []
        self.hear = print
        self.seeds = []

    def switch_on(self, rig_file: Path, programs: Path, seed: int, hear: Callable[[CellEvent], None]) -> Machine:
        self.hear = hear
        self.seeds.append(seed)
        hear(CellEvent("ready", "cell/rig.yaml", "ready"))
        return self

    def type_line(self, line: str) -> None:
        self.typed.append(line)
        for event in self.answers.get(line.partition(" ")[0], ()):
            self.hear(event)

    def ended(self) -> CellError:
        return CellError("rig emulate", "exited unexpectedly", "repeat", code="process.failed")

    def stop(self) -> None:
        pass


@pytest.fixture
def session(tmp_path):
    return begun(find("paper-fanuc"), tmp_path / "begun", 11)


def cell_at(session: Session, directory: Path, **answers: tuple[CellEvent, ...]) -> Cell:
    cell = Cell(session, directory, answers)
    cell.mount(Stage(name="yaw", words="the ball"), Path("yaml"))
    return cell


def test_waiting_program_continues_once_it_is_recorded(session, tmp_path):
    cell = cell_at(session, tmp_path, run=(CellEvent("waits", "p01", "in another language"),))
    cell.start_program(PROGRAM)
    cell.check()
    assert cell.typed == ["run p01-yaw-acw"]
    cell.go_on(PROGRAM)
    cell.check()
    cell.check()
    assert cell.typed == ["run p01-yaw-acw", "go on"]


def test_next_program_is_not_preceded_by_a_stop_if_the_last_is_done(session, tmp_path):
    cell = cell_at(session, tmp_path, run=(CellEvent("driving", "p01", ""), CellEvent("done", "p01", "")))
    for _ in range(2):
        cell.start_program(PROGRAM)
        cell.check()
    assert cell.typed == ["run p01-yaw-acw"] * 2


def test_refusal_ends_the_session_except_of_a_late_stop(session, tmp_path):
    cell = cell_at(session, tmp_path, stop=(CellEvent("refused", "stop", "error: stop: no program drives"),))
    cell.type_line("stop")
    cell.check()
    cell.answers = {"enter": (CellEvent("refused", "enter x", "error: x: is for a controller of abb"),)}
    with refused("robot.refused", "is for a controller of abb"):
        cell.enter(Path("x"))
    assert not cell.entered


def test_entered_values_are_entered_again_at_each_stage(session, tmp_path):
    cell = Cell(session, tmp_path, {"enter": (CellEvent("entered", "corrections.yaml", ""),)})
    assert cell.enter(Path("corrections.yaml")) and not cell.typed
    cell.mount(Stage(name="yaw", words="the ball"), Path("yaml"))
    assert cell.typed == ["enter corrections.yaml"]


def test_resumed_session_has_new_noise(session, tmp_path):
    first = cell_at(session, tmp_path)
    (tmp_path / "runs" / "20260101T000000Z_p01-yaw-acw").mkdir(parents=True)
    assert first.seeds != cell_at(session, tmp_path).seeds


def test_cell_that_has_ended_ends_the_session(session, tmp_path):
    cell = cell_at(session, tmp_path)
    cell.runs = False
    with refused("process.failed", "exited unexpectedly"):
        cell.check()


def test_inference_that_fails_or_is_killed_says_so(tmp_path):
    for kill, code in ((False, "run.missing"), (True, "process.failed")):
        inference = Inference([tmp_path / "none"], [], Path("paper-fanuc"), tmp_path / "found")
        if kill:
            inference._process.kill()  # private: as the system does if there is no memory left
        while not inference.is_done:
            time.sleep(0.05)
        with refused(code):
            inference.result()


def test_event_is_a_line_of_json_and_other_lines_are_ignored():
    events = []
    robot = SimpleNamespace(stop=lambda: False, pause=None, go_on=None, show=lambda column, value: None)
    keyboard = Keyboard(robot, None, print, events.append)
    keyboard.take("stop")
    keyboard.take("show speed_percent 40")
    assert [(event.event, event.name) for event in events] == [("refused", "stop"), ("shows", "speed_percent")]
    assert [CellEvent.of_line(event.as_line) for event in events] == events
    for line in ("Traceback (most recent call last):", "[1]", '{"event": "done"}', "12"):
        assert CellEvent.of_line(line) is None

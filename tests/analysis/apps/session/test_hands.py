"""The hands of an emulated cell: what is typed at which of its events, and what ends the session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import pytest

from analysis.apps.emulate.served_cell import CellEvent, Keyboard
from analysis.apps.session.daemon_cell import EmulatedHands, Hear
from analysis.apps.session.session_state import Emulated, Stage
from rigs.errors import CellError

PROGRAM = SimpleNamespace(name="p01-yaw-acw")


@dataclass
class Cell:
    """An emulated cell with scripted responses: `answers` to each typed line."""

    answers: dict[str, tuple[CellEvent, ...]] = field(default_factory=dict)
    typed: list[str] = field(default_factory=list)
    name: str = "rig emulate"
    log: Path = Path("emulated.log")
    runs: bool = True
    hear: Hear = print
    seeds: list[str] = field(default_factory=list)

    def start(self, arguments: Sequence[str | Path], _: Path, hear: Hear) -> Cell:
        self.hear = hear
        self.seeds.append(str(arguments[-1]))
        hear(CellEvent("ready", "cell/rig.yaml", "ready"))
        return self

    def type_line(self, line: str) -> None:
        self.typed.append(line)
        for event in self.answers.get(line.partition(" ")[0], ()):
            self.hear(event)

    def ended(self) -> CellError:
        return CellError(self.name, "ended by itself", "the same command goes on")

    def stop(self) -> None:
        self.runs = False


def hands_at(cell: Cell, *entered: Path, directory: Path = Path("session")) -> EmulatedHands:
    hands = EmulatedHands(directory, "kuka", Emulated(), entered, cell.start)
    hands.set_up(Stage(name="yaw", words="the ball"), Path("yaml"))
    return hands


def test_a_program_that_waits_goes_on_once_it_is_recorded() -> None:
    cell = Cell({"run": (CellEvent("waits", "p01", "another language says it otherwise"),)})
    hands = hands_at(cell)
    hands.start(PROGRAM)  # type: ignore[arg-type]
    hands.look()
    assert cell.typed == ["run p01-yaw-acw"]
    hands.go_on(PROGRAM)  # type: ignore[arg-type]
    hands.look()
    hands.look()
    assert cell.typed == ["run p01-yaw-acw", "go on"]


def test_the_next_program_is_not_stopped_where_the_one_before_is_done() -> None:
    cell = Cell({"run": (CellEvent("driving", "p01", ""), CellEvent("done", "p01", ""))})
    hands = hands_at(cell)
    for _ in range(2):
        hands.start(PROGRAM)  # type: ignore[arg-type]
        hands.look()
    assert cell.typed == ["run p01-yaw-acw"] * 2


def test_what_the_cell_refuses_is_said_at_once_but_a_stop_that_came_late() -> None:
    cell = Cell({"stop": (CellEvent("refused", "stop", "error: stop: no program drives"),)})
    hands = hands_at(cell)
    cell.type_line("stop")
    hands.look()
    cell.answers = {"enter": (CellEvent("refused", "enter x", "error: x: is for a controller of abb"),)}
    with pytest.raises(CellError, match="the emulated cell: x: is for a controller of abb"):
        hands.enter(Path("x"))


def test_values_that_were_entered_before_are_entered_at_each_stage() -> None:
    cell = Cell({"enter": (CellEvent("entered", "corrections.yaml", ""),)})
    hands_at(cell, Path("corrections.yaml"))
    assert cell.typed == ["enter corrections.yaml"]


def test_a_cell_that_goes_on_after_a_cut_does_not_repeat_its_noise(tmp_path: Path) -> None:
    cell = Cell()
    hands_at(cell, directory=tmp_path)
    (tmp_path / "runs" / "20260101T000000Z_p01-yaw-acw").mkdir(parents=True)
    hands_at(cell, directory=tmp_path)
    assert len({*cell.seeds}) == 2


def test_a_cell_that_has_ended_ends_the_session() -> None:
    cell = Cell()
    hands = hands_at(cell)
    cell.runs = False
    with pytest.raises(CellError, match="ended by itself"):
        hands.look()


def test_an_event_is_a_line_of_json_and_no_other_line_is_one() -> None:
    events: list[CellEvent] = []
    robot = SimpleNamespace(stop=lambda: False, pause=None, go_on=None, show=lambda column, value: None)
    keyboard = Keyboard(robot, None, print, events.append)  # type: ignore[arg-type]
    keyboard.take("stop")
    keyboard.take("show speed_percent 40")
    assert [(event.event, event.name) for event in events] == [("refused", "stop"), ("shows", "speed_percent")]
    assert [CellEvent.of_line(event.as_line) for event in events] == events
    for line in ("Traceback (most recent call last):", "[1]", '{"event": "done"}', "12"):
        assert CellEvent.of_line(line) is None

"""The ports that rig init opens: those that a person names, and no other."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

import pytest

from analysis.apps.commission import gauge_questions
from analysis.apps.commission.gauge_questions import ask_gauges
from analysis.apps.commission.init_answers import Answers, Options
from analysis.cli.dialogue import Dialogue, DialogueEnded
from daq.apps.commission.attempts import PortReport
from daq.apps.commission.port_search import SearchOptions
from rigs.errors import UseError

HERE = {"/dev/ttyUSB0": "FT232R", "/dev/ttyUSB1": "", "/dev/ttyS0": "CNC"}


def options(*ports: str) -> Options:
    nothing: dict[str, dict[str, object]] = {"g1": {}, "g2": {}, "feedback": {}}
    unasked = [None] * 6
    return Options(Path("cell.yaml"), "cell", "gauges", None, ports, (), nothing, *unasked, 70.0, 0.3, (1,))


def asked(monkeypatch: pytest.MonkeyPatch, typed: str, *ports: str, terminal: bool = True) -> tuple[list[str], str]:
    """The ports that are searched when this is typed, and what is said."""
    searched, said, screen = list[str](), list[str](), io.StringIO()

    def search(wanted: SearchOptions, progress: object) -> Sequence[PortReport]:
        searched.extend(wanted.ports)
        return [PortReport(port, problem="silent", remedy="switch it on") for port in wanted.ports]

    monkeypatch.setattr(gauge_questions, "search", search)
    monkeypatch.setattr(gauge_questions, "ports_here", lambda: HERE)
    master, slave = os.openpty()
    os.write(master, f"{typed}\x04".encode())  # Ctrl-D at the next question
    try:
        with os.fdopen(slave) as keyboard, pytest.raises(DialogueEnded if terminal else UseError) as ended:
            dialogue = Dialogue(said.append, lambda doing: nullcontext(lambda doing: None), terminal, keyboard, screen)
            ask_gauges(Answers(), options(*ports), dialogue)
    finally:
        os.close(master)
    return searched, "\n".join([*said, screen.getvalue(), str(ended.value)])


def test_a_port_is_chosen_before_it_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    searched, said = asked(monkeypatch, "")
    assert not searched
    assert "1 /dev/ttyUSB0 (FT232R)" in said and "3 /dev/ttyS0 (CNC)" in said and "Do not choose ports" in said


@pytest.mark.parametrize(
    ("typed", "chosen"), [("1", [0]), ("2, 1", [1, 0]), ("1 1", [0]), ("all", [0, 1, 2]), ("ALL", [0, 1, 2])]
)
def test_the_chosen_ports_are_searched(monkeypatch: pytest.MonkeyPatch, typed: str, chosen: list[int]) -> None:
    assert asked(monkeypatch, f"{typed}\n")[0] == [list(HERE)[place] for place in chosen]


@pytest.mark.parametrize("typed", ["0", "4", "x", "1-2", "-1", ","])
def test_what_is_not_a_choice_is_asked_again(monkeypatch: pytest.MonkeyPatch, typed: str) -> None:
    searched, said = asked(monkeypatch, f"{typed}\n2\n")
    assert searched == ["/dev/ttyUSB1"] and "is not a list of numbers from 1 to 3" in said


def test_named_ports_are_not_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    assert asked(monkeypatch, "", "/dev/ttyUSB0")[0] == ["/dev/ttyUSB0"]


def test_without_a_terminal_no_port_is_opened_that_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    searched, said = asked(monkeypatch, "", terminal=False)
    assert not searched and "--port" in said


def test_a_question_of_several_lines_is_said_line_by_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Line feeds in a question are printed as line breaks and not escaped."""
    given = list[str]()
    master, slave = os.openpty()
    os.write(master, b"\x04")
    monkeypatch.setattr(gauge_questions, "ports_here", lambda: HERE)
    try:
        with os.fdopen(slave) as keyboard, pytest.raises(DialogueEnded):
            dialogue = Dialogue(
                given.append, lambda doing: nullcontext(lambda doing: None), True, keyboard, io.StringIO()
            )
            ask_gauges(Answers(), options(), dialogue)
    finally:
        os.close(master)
    assert "of other machines: a machine may execute the request as a command." in given
    assert [line for line in given if "\n" in line] == []

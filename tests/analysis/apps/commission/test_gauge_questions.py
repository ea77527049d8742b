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
from daq.discovery.attempts import PortReport
from daq.discovery.port_search import SearchOptions
from rigs.errors import UseError

HERE = {"/dev/ttyUSB0": "FT232R", "/dev/ttyUSB1": "", "/dev/ttyS0": "CNC"}


def options(*ports: str) -> Options:
    nothing = {"g1": {}, "g2": {}, "feedback": {}}
    return Options(Path("cell.yaml"), "cell", "gauges", None, ports, (), nothing, {}, None, 70.0, 0.3, (1,))


def asked(monkeypatch: pytest.MonkeyPatch, typed: str, *ports: str, terminal: bool = True) -> tuple[list[str], str]:
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
    assert not any("\n" in line for line in said)  # line feeds in a question are printed as line breaks
    return searched, "\n".join([*said, screen.getvalue(), str(ended.value)])


def test_ports_are_listed_and_chosen_before_they_are_opened(monkeypatch):
    searched, said = asked(monkeypatch, "")
    assert not searched
    assert all(f"{number} {port}" in said for number, port in enumerate(HERE, 1)) and "FT232R" in said


@pytest.mark.parametrize(
    ("typed", "chosen"), [("1", [0]), ("2, 1", [1, 0]), ("1 1", [0]), ("all", [0, 1, 2]), ("ALL", [0, 1, 2])]
)
def test_the_chosen_ports_are_searched(monkeypatch, typed, chosen):
    assert asked(monkeypatch, f"{typed}\n")[0] == [list(HERE)[place] for place in chosen]


@pytest.mark.parametrize("typed", ["0", "4", "x", "1-2", "-1", ","])
def test_invalid_choice_is_asked_again(monkeypatch, typed):
    searched, said = asked(monkeypatch, f"{typed}\n2\n")
    assert searched == ["/dev/ttyUSB1"] and f"error: {typed!r}" in said


def test_ports_named_by_options_are_not_asked_for(monkeypatch):
    assert asked(monkeypatch, "", "/dev/ttyUSB0")[0] == ["/dev/ttyUSB0"]


def test_no_unnamed_port_is_opened_without_a_terminal(monkeypatch):
    searched, said = asked(monkeypatch, "", terminal=False)
    assert not searched and "--port" in said

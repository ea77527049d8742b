from typing import Any, Self

import pytest

from analysis.procedures.results import fitness
from daq.service import client
from tests.support.command_line import succeeded
from tests.support.recorded_lap import recorded

CUT = "the robot was still moving when the recording ended"


@pytest.mark.parametrize(
    ("label", "part", "stands_s", "said", "unsaid"),
    [
        ("acw", 1.0, 3.0, [], [CUT, "analysed"]),
        ("acw", 0.3, 0.0, [CUT, "analysed", "3 s"], ["relabel"]),
        ("acw", 0.6, 0.0, [CUT], ["analysed", "relabel"]),  # it unwinds: its lap is whole
        ("cw", 0.35, 3.0, ["rig relabel {run} --direction acw"], [CUT]),
        ("cw", 0.35, 0.0, [CUT, "rig relabel {run} --direction acw"], []),
    ],
)
def test_the_remedy_is_the_one_that_mends_the_run(tmp_path, monkeypatch, label, part, stands_s, said, unsaid):
    run = recorded(tmp_path, label=label, part=part, stands_s=stands_s)

    class Daemon:
        def __init__(self, *_: object) -> None:
            pass

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def ask(self, command: str, **_: object) -> dict[str, Any]:
            return {"run": str(run), "counters": {"robot": {"samples": 100}}} if command == "record_stop" else {}

    monkeypatch.setattr(client, "Client", Daemon)
    monkeypatch.setattr(client, "find_socket", lambda rig: tmp_path)
    done = succeeded("record stop")
    assert done.stdout == f"{run}\n"
    for words in said:
        assert words.format(run=run) in done.stderr
    for words in unsaid:
        assert words not in done.stderr
    if label == "cw":
        succeeded(f"relabel {run} --direction acw")
        assert fitness(run).drove is None

"""Several runs in one answer: no number broken by a narrow screen, and no doubt of which run a figure is."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from analysis.reading.simulated_runs import write_simulated
from analysis.reporting.report import as_object, as_tables
from analysis.reporting.results import Result, analyse_run, analyse_runs
from analysis.reporting.truth import compare
from rigs.errors import FileError
from rigs.load import load, load_hidden

RIG, TEXT = load("ur10e")
RIG = load_hidden("ur10e").within(RIG)


@pytest.fixture(scope="module")
def laps(tmp_path_factory: pytest.TempPathFactory) -> list[Result]:
    folder = tmp_path_factory.mktemp("laps")
    runs = write_simulated(RIG, TEXT, "yaw", ("acw", "cw"), [1, 2], None, folder, csv=False)
    return analyse_runs(list(runs))


@pytest.mark.parametrize(("width", "abreast"), [(80, 2), (200, 4)])
def test_as_many_runs_abreast_as_the_screen_holds_whole(laps: list[Result], width: int, abreast: int) -> None:
    console = Console(width=width, file=io.StringIO())
    with console.capture() as shown:
        console.print(as_tables(laps))
    for result in laps:
        assert all(str(figure) in shown.get() for figure in result.figures.values())
    assert max(line.count("yaw acw") + line.count("yaw cw") for line in shown.get().splitlines()) == abreast


def test_the_two_runs_held_against_each_other_are_named_where_there_are_more(laps: list[Result]) -> None:
    words = [str(part) for part in as_tables(laps).renderables]  # type: ignore[attr-defined]
    assert any(line.startswith("acw against cw (yaw-acw-001, yaw-cw-001): ") for line in words)
    words = [str(part) for part in as_tables(laps[:2]).renderables]  # type: ignore[attr-defined]
    assert any(line.startswith("acw against cw: ") for line in words)
    (both,) = as_object(laps)["acw_against_cw"]
    assert [Path(run).name for run in both["runs"]] == ["yaw-acw-001", "yaw-cw-001"]


def test_a_truth_that_tells_nothing_of_a_test_is_told(laps: list[Result], tmp_path: Path) -> None:
    truth = tmp_path / "truth.json"
    truth.write_text(json.dumps({"rig": "ur10e", "yaw": {"acw": {"band_deg": 0.1}, "cw": {"band_deg": 0.1}}}))
    (radial,) = write_simulated(RIG, TEXT, "radial", (None,), [1], None, tmp_path, csv=False)
    with pytest.raises(FileError, match="tells nothing of the radial test"):
        compare([analyse_run(radial)], truth)
    assert [list(one) for one in compare([*laps[:1], analyse_run(radial)], truth)] == [["band_deg"], []]

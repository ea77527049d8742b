from __future__ import annotations

import json
import multiprocessing
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from analysis.cli import app
from analysis.cli.several import over_runs
from tests.support.child_processes import Deadly, die
from tests.support.plant_runs import robot_of, write_visits


def ran(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    plant = tmp_path_factory.mktemp("plant")
    for seed, directory in enumerate(("a", "c")):
        assert list(write_visits(plant / directory, robot_of(1, 0, 365.0), [0.0, 30.0], ["yaw acw"], seed))
    (plant / "b").mkdir()
    (plant / "b" / "manifest.json").write_text("{}")
    return plant


@pytest.mark.parametrize("command", [["verify"], ["analyse"], ["analyse", "--json"], ["analyse", "--lines"]])
def test_output_does_not_depend_on_processes(command, plant):
    one, two = (ran(*command, plant, "--jobs", jobs) for jobs in (1, 2))
    assert one.exit_code == 3 and one.stdout
    (error,) = (line for line in one.stderr.splitlines() if "note" not in line)
    assert str(plant / "b") in error
    assert (two.exit_code, two.stdout, two.stderr) == (one.exit_code, one.stdout, one.stderr)


def test_lines_are_the_runs_of_the_object(plant):
    lines = [json.loads(line) for line in ran("analyse", plant, "--lines").stdout.splitlines()]
    assert lines == json.loads(ran("analyse", plant, "--json").stdout)["runs"]
    assert [line["run"] for line in lines] == sorted(map(str, plant.glob("[ac]/*")))


def test_a_page_names_the_run_that_it_lacks(plant, tmp_path):
    page = tmp_path / "page.html"
    done = ran("report", plant, "--no-diagnosis", "-o", page, "--jobs", 2)
    assert done.exit_code == 3
    assert f"ignored: {plant / 'b'}" in page.read_text()


def test_the_history_has_runs_of_directories_below(plant):
    one, two = (
        json.loads(ran("history", "robot-001", "--runs", plant, "--json", "--jobs", jobs).stdout) for jobs in (1, 2)
    )
    assert one == two and set(one["without_figures"]) == {"b"}
    named = {point["run"] for series in one["series"] for point in series["points"]}
    assert named == {str(run.relative_to(plant)) for run in plant.glob("[ac]/*")}


def test_a_link_to_a_run_below_hides_it_from_no_history(plant, tmp_path):
    data = shutil.copytree(plant, tmp_path / "data")
    (data / "0-latest").symlink_to(next((data / "a").iterdir()))
    found = json.loads(ran("history", "robot-001", "--runs", data, "--json", "--jobs", 1).stdout)
    named = {point["run"] for series in found["series"] for point in series["points"]}
    assert {(data / name).resolve() for name in named} == set(data.glob("[ac]/*"))


@pytest.mark.parametrize("jobs", ["some", "-1", "1.5", ""])
def test_a_wrong_number_of_processes_is_refused(jobs, plant):
    assert ran("verify", plant, "--jobs", jobs).exit_code == 2


def test_a_process_that_was_killed_is_reported(tmp_path, capsys):
    seen: list[int] = []
    items = [Deadly(tmp_path, number, times) for number, times in enumerate((0, 1, 0, 2))]
    (error,) = over_runs(die, items, seen.append, doing="dying", jobs=2)
    assert seen == [0, 1, 2] and "signal 9, 2 times" in error.what
    note, last = capsys.readouterr().err.splitlines()
    assert note.startswith("note: item 1: ") and last == f"error: {error}"


def stops(item: int) -> int:
    if item == 2:
        raise KeyboardInterrupt
    return item


def test_ctrl_c_reports_progress(capsys):
    seen: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        over_runs(stops, [0, 1, 2, 3], seen.append, doing="counting")
    assert seen == [0, 1]
    assert capsys.readouterr().err.startswith("interrupted after 2 of 4 runs: ")


def test_ctrl_c_ends_processes_too_while_a_run_is_shown(capsys):
    def show(item: int) -> None:
        stops(item + 1)

    with pytest.raises(KeyboardInterrupt):
        over_runs(abs, [0, 1, 3], show, doing="counting", jobs=2)
    assert capsys.readouterr().err.startswith("interrupted after 1 of 3 runs: ")
    assert not multiprocessing.active_children()

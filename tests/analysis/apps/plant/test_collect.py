import shutil
from pathlib import Path

import pytest

from analysis.apps.plant import collect as module
from analysis.apps.plant.collect import Collected, Workers
from analysis.apps.plant.store import FILE, entries
from analysis.runs.copies import USED, refuse_repeated
from analysis.runs.loading import load_measured
from rigs.errors import FileError
from tests.support.command_line import succeeded
from tests.support.dated_runs import dated_run
from tests.support.plant_runs import known_robot, write_visits
from tests.support.refusals import refused
from tests.support.written_files import contents


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    directory = tmp_path_factory.mktemp("runs")
    for day in range(3):
        dated_run(directory, day, 0.01)
    return directory


@pytest.fixture
def runs(simulated, tmp_path):
    return shutil.copytree(simulated, tmp_path / "runs")


def collect(runs: Path, robot: str) -> Collected:
    return module.collect(runs, robot, Workers(1), lambda doing, done, total: None)


def test_without_a_usable_file_the_cache_of_the_user_has_the_figures(runs, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(runs.parent / "cache"))
    whole = collect(runs, "ur10e")
    (runs / FILE).unlink()
    (runs / FILE).mkdir()
    found = collect(runs, "ur10e")
    assert found.runs == whole.runs and len(found.notes) == 1


def test_runs_of_other_robots_are_not_evaluated(runs):
    list(write_visits(runs, known_robot(1, 2, 0.0), [0]))
    mine = ["000-acw", "001-acw", "002-acw"]
    assert [run.name for run in collect(runs, "ur10e").runs] == mine
    assert sorted(entries(runs / FILE)) == mine


def test_a_table_that_was_imported_twice_counts_once(runs):
    lap = runs.parent / "lap.csv"
    succeeded(f"export {runs}/000-acw --to csv -o {lap}")
    for name in ("one", "two"):
        words = ["import", str(lap), "--rig", "ur10e-cell", "--test", "yaw", "-o", str(runs / name)]
        succeeded(*words)
    found = collect(runs, "ur10e")
    assert len(found.runs) == 3
    assert {"000-acw", "one"} & {run.name for run in found.runs} == set()  # the newest import is kept
    assert len(found.notes) == 2
    one, two = (load_measured(runs / name) for name in ("one", "two"))
    with pytest.raises(FileError):
        refuse_repeated({USED: (one, two)})


def test_robot_has_the_name_of_its_rig_file_or_robot(runs):
    manifest = contents(runs / "000-acw" / "manifest.json")
    name = next(line for line in manifest["rig_text"].splitlines() if line.strip().startswith("name:"))
    own = name.split(":", 1)[1].strip().strip("\"'")
    assert collect(runs, own).runs == collect(runs, "ur10e").runs
    for directory, robot, code in (
        (runs, "other", "run.missing"),
        (runs / "nowhere", "ur10e", "file.missing"),
        (runs / "000-acw", "ur10e", "run.missing"),
    ):
        with refused(code):
            collect(directory, robot)

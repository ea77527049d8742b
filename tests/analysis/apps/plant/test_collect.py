import json
import shutil
from pathlib import Path

import pytest

from analysis.apps.plant import collect as module
from analysis.apps.plant.collect import Collected, Workers
from analysis.apps.plant.records import RunRecord, record_of
from analysis.apps.plant.store import FILE, entries
from analysis.runs.loading import load_measured, refuse_copies
from daq.store import Manifest, relabel
from rigs.errors import FileError
from tests.support.command_line import ran
from tests.support.dated_runs import dated_run
from tests.support.plant_runs import known_robot, write_visits
from tests.support.refusals import refused


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    directory = tmp_path_factory.mktemp("runs")
    for day in range(3):
        dated_run(directory, day, 0.01)
    return directory


@pytest.fixture
def runs(simulated, tmp_path):
    return shutil.copytree(simulated, tmp_path / "runs")


@pytest.fixture
def evaluated(monkeypatch):
    names: list[str] = []

    def noted(path: Path, manifest: Manifest, fingerprint: str) -> RunRecord:
        names.append(path.name)
        return record_of(path, manifest, fingerprint)

    monkeypatch.setattr(module, "record_of", noted)
    return names


def collect(runs: Path, robot: str) -> Collected:
    return module.collect(runs, robot, Workers(1), lambda doing, done, total: None)


def test_a_run_is_evaluated_once_until_it_changes(runs, evaluated):
    first = collect(runs, "ur10e")
    assert [run.name for run in first.runs] == ["000-acw", "001-acw", "002-acw"] and not first.notes
    assert len(evaluated) == 3
    again = collect(runs, "ur10e")
    assert again == first and len(evaluated) == 3
    dated_run(runs, 5, 0.01)
    shutil.rmtree(runs / "001-acw")
    third = collect(runs, "ur10e")
    assert evaluated[3:] == ["005-acw"]
    assert [run.name for run in third.runs] == ["000-acw", "002-acw", "005-acw"]


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


def test_broken_runs_are_named_and_not_fatal(runs):
    (runs / "000-acw" / "manifest.json").write_text("{")
    chunk = next((runs / "001-acw").glob("*.parquet"))
    chunk.write_bytes(chunk.read_bytes()[:-100])
    found = collect(runs, "ur10e")
    assert [run.name for run in found.runs] == ["002-acw"]
    assert [run.name for run in found.broken] == ["000-acw", "001-acw"]
    assert all(run.problem for run in found.broken)


def test_a_run_that_lost_its_manifest_is_named(runs):
    (runs / "000-acw" / "manifest.json").unlink()
    (runs / "deeper").mkdir()
    shutil.move(runs / "001-acw", runs / "deeper")
    (runs / "deeper" / "001-acw" / "manifest.json").unlink()
    found = collect(runs, "ur10e")
    assert [run.name for run in found.broken] == ["000-acw", "deeper/001-acw"]
    assert all(run.problem for run in found.broken)


def test_a_copy_counts_once(runs):
    shutil.copytree(runs / "000-acw", runs / "copied")
    found = collect(runs, "ur10e")
    assert len(found.runs) == 3 and len(found.notes) == 1
    relabel(runs / "copied", operator="Ann")
    assert collect(runs, "ur10e").notes == found.notes


def test_a_table_that_was_imported_twice_counts_once(runs):
    lap = runs.parent / "lap.csv"
    assert ran("export", runs / "000-acw", "--to", "csv", "-o", lap).returncode == 0
    for name in ("one", "two"):
        words = ["import", str(lap), "--rig", "ur10e", "--test", "yaw", "-o", str(runs / name)]
        assert ran(*words).returncode == 0
    found = collect(runs, "ur10e")
    assert len(found.runs) == 3
    assert {"000-acw", "one"} & {run.name for run in found.runs} == set()  # the newest import is kept
    assert len(found.notes) == 2
    one, two = (load_measured(runs / name) for name in ("one", "two"))
    with pytest.raises(FileError):
        refuse_copies((run.path, run.run.readings_sha256) for run in (one, two))


def test_robot_has_the_name_of_its_rig_file_or_robot(runs):
    manifest = json.loads((runs / "000-acw" / "manifest.json").read_text())
    name = next(line for line in manifest["rig_text"].splitlines() if line.strip().startswith("name:"))
    own = name.split(":", 1)[1].strip().strip("\"'")
    assert collect(runs, own).runs == collect(runs, "ur10e").runs
    for directory, robot, code in (
        (runs, "other", "history.no_robot"),
        (runs / "nowhere", "ur10e", "file.missing"),
        (runs / "000-acw", "ur10e", "run.none"),
    ):
        with refused(code):
            collect(directory, robot)

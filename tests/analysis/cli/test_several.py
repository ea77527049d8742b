import shutil
from pathlib import Path

import pytest

from daq.store import read_run
from rigs.load import SHIPPED
from tests.support.command_line import errors_of, ran
from tests.support.store_cases import finished
from tests.support.table_cases import csv_text, plain


@pytest.fixture
def runs(tmp_path):
    whole = finished(tmp_path / "runs")
    return [whole, tmp_path / "nothing", Path(shutil.copytree(whole, tmp_path / "copy"))]


@pytest.mark.parametrize("command", ["recover", "keep", "relabel --operator ada"])
def test_a_path_that_is_no_run_costs_the_others_nothing(command, runs):
    done = ran(*command.split(), *runs)
    assert done.returncode == 3
    assert [line.partition(":")[0] for line in done.stdout.splitlines()] == [str(runs[0]), str(runs[2])]
    (error,) = done.stderr.splitlines()
    assert error.startswith(f"error: {runs[1]}")


def test_verify_goes_on_behind_a_damaged_run(runs):
    next(runs[0].glob("g1-*.parquet")).unlink()
    done = ran("verify", *runs)
    assert done.returncode == 3
    assert done.stdout.splitlines() == [*(f"{run}: not whole" for run in runs[:2]), f"{runs[2]}: whole"]
    assert "is given twice" in errors_of(f"verify {runs[2]} {runs[2]}")


def test_several_tables_become_runs_named_as_they_are(tmp_path):
    text = csv_text(plain("roll", "cw"))
    for name, content in (("a", text), ("b", text.replace('"cw"', '"ccw"')), ("c", text)):
        (tmp_path / f"{name}.csv").write_text(content)
    tables = [tmp_path / f"{name}.csv" for name in "abc"]
    options = ("--rig", SHIPPED / "ur10e-cell.yaml", "--test", "roll", "-o", tmp_path / "runs")
    done = ran("import", *tables, *options)
    assert done.returncode == 3 and "b.csv, line 2, direction" in done.stderr
    made = [tmp_path / "runs" / "a", tmp_path / "runs" / "c"]
    assert done.stdout.splitlines() == list(map(str, made)) and not (tmp_path / "runs" / "b").exists()
    assert all(read_run(path).manifest.test == "roll" for path in made)
    assert errors_of("import", *tables[::2], *options).count("exists already") == 2


def test_several_runs_are_exported_to_a_directory(runs, tmp_path):
    assert str(runs[1]) in errors_of("export", *runs, "--to", "mcap", "-o", tmp_path / "out")
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == sorted(
        f"{run.name}.mcap" for run in (runs[0], runs[2])
    )
    taken = errors_of("export", runs[0], runs[2], "--to", "mcap", "-o", next((tmp_path / "out").iterdir()))
    assert taken.count("choose a different --output") == 2

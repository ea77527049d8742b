from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from analysis import load_run, save_run, simulate
from analysis.runs.loading import Measured
from daq.store import write_table_run
from rigs.errors import FileError
from tests.support.command_line import ran


def edited(run: Measured, path: Path, column: str, row: int, value: float) -> Path:
    table = run.run.table
    place = table.column_names.index(column)
    values = table[column].to_numpy().copy()
    values[row] = value
    changed = table.set_column(place, column, pa.array(values, table.schema.field(column).type))
    write_table_run(replace(run.run, table=changed), path)
    return path


@pytest.fixture(scope="module")
def lap():
    return simulate("ur10e", "yaw", "acw", seed=1, effects="ur10e")


@pytest.mark.parametrize(
    ("test", "column", "value", "told"),
    [
        ("yaw", "t_s", np.nan, "row 6 has t_s = nan"),
        ("yaw", "t_s", 1e300, "row 6 has t_s = 1e+300"),
        ("yaw", "t_s", -5.0, "row 6: time"),
        ("yaw", "q3_deg", np.inf, "row 6 has q"),
        ("yaw", "g2_mm", np.nan, "row 6 has g_mm"),
        ("radial", "polar_deg", np.nan, "row 6 has polar"),
        ("radial", "target", 0, "row 6 has target = 0"),
        ("repeatability", "g1_mm", -1e300, "row 6 has g1_mm"),
        ("repeatability", "round", -1, "row 6 has round = -1"),
    ],
)
def test_row_refused_by_import_is_refused_in_a_run(tmp_path, test, column, value, told):
    run = simulate("ur10e", test, "acw" if test == "yaw" else None, seed=1, effects="ur10e")
    path = edited(run, tmp_path / "run", column, 5, value)
    with pytest.raises(FileError) as error:
        load_run(path)
    assert str(error.value).startswith(f"{path}: {told}")


@pytest.mark.parametrize(("jobs", "value"), [(1, np.nan), (2, 1e300)])
def test_one_such_run_costs_its_own_row(tmp_path, lap, value, jobs):
    paths = [tmp_path / name for name in ("a", "b", "c")]
    save_run(lap, paths[0])
    edited(lap, paths[1], "t_s", 9, value)
    save_run(replace(lap, run=replace(lap.run, table=lap.run.table)), paths[2])
    alone = ran(f"analyse --lines {paths[0]}").stdout.replace(str(paths[0]), "…")
    done = ran("analyse", "--lines", *paths, "--jobs", str(jobs))
    assert done.returncode == 3
    assert [line.replace(str(path), "…") for line, path in zip(done.stdout.splitlines(), paths[::2], strict=True)] == [
        alone.strip(),
        alone.strip().replace('"a"', '"c"'),
    ]
    (error,) = [line for line in done.stderr.splitlines() if line.startswith("error")]
    assert error.startswith(f"error: {paths[1]}: row 10 has t_s")

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from analysis import load_run, simulate
from analysis.runs.loading import Measured
from daq.store import write_table_run
from rigs.errors import FileError


def edited(run: Measured, path: Path, column: str, row: int, value: float) -> Path:
    table = run.run.table
    place = table.column_names.index(column)
    values = table[column].to_numpy().copy()
    values[row] = value
    changed = table.set_column(place, column, pa.array(values, table.schema.field(column).type))
    write_table_run(replace(run.run, table=changed), path)
    return path


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
    run = simulate("ur10e-cell", test, "acw" if test == "yaw" else None, seed=1, effects="ur10e-cell")
    path = edited(run, tmp_path / "run", column, 5, value)
    with pytest.raises(FileError) as error:
        load_run(path)
    assert str(error.value).startswith(f"{path}: {told}")

"""The UR10 measured by Fraunhofer IPA with a laser tracker (Landgraf et al., CASE 2021): real data for every test.

Writes the poses as CSV tables of docs/tables.md, which `rig import` takes.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from scipy.spatial.transform import Rotation

from analysis.runs.csv_tables import columns_of
from analysis.runs.tables import PoseTable
from analysis.runs.written_files import write_csv, write_new

JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
DATA = Path(__file__).parents[4] / "shared" / "data" / "ipa-ur10"
"""Where the measured data lie unless another folder is given; they are not part of the project."""


def read(path: Path) -> PoseTable:
    """A series as a pose table. The file turns about moving axes x, y, z; tables about fixed ones."""
    with path.open(encoding="utf-8") as file:
        rows = [
            {key: value.replace(",", ".") for key, value in row.items()} for row in csv.DictReader(file, delimiter=";")
        ]
    column = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name != "Timestamp"}
    turned = np.stack([column[f"measurement_r{axis}"] for axis in "xyz"], axis=1)
    rpy = Rotation.from_euler("XYZ", turned, degrees=True).as_euler("xyz")
    q = np.stack([column[name] for name in JOINTS], axis=1)
    return PoseTable(q, np.stack([column[f"measurement_{axis}"] for axis in "xyz"], axis=1), rpy)


def main(
    data: Annotated[Path, typer.Argument(help="The folder of series_b.csv and series_d.csv.")] = DATA,
    out: Annotated[Path, typer.Argument(help="Where the tables are written.")] = Path("ur10-tables"),
) -> None:
    """Write the tables."""
    for series in ("b", "d"):
        table = read(data / f"series_{series}.csv")
        out.mkdir(parents=True, exist_ok=True)
        path = out / f"ur10-{series}.csv"
        path.unlink(missing_ok=True)
        write_new(path, lambda file, table=table: write_csv(columns_of(table), file))
        print(f"series {series.upper()}: {len(table.q)} poses; wrote {path}")


if __name__ == "__main__":
    typer.run(main)

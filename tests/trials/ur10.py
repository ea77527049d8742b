"""The UR10 measured by Fraunhofer IPA with a laser tracker (Landgraf et al., CASE 2021): real data for every test.

Writes the poses as CSV tables of docs/tables.md, which `rig import` takes.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

from scipy.spatial.transform import Rotation

from analysis.runs.tables import PoseTable, columns_of
from analysis.runs.written_files import write_csv, write_new
from tests.support.measured_series import DATA, ur10, ur10_columns
from tests.support.trial import Trial, main


def read(path: Path) -> PoseTable:
    """A series as a pose table. The file turns about moving axes x, y, z; tables about fixed ones."""
    turned = ur10_columns(path, *(f"measurement_r{axis}" for axis in "xyz"))
    return PoseTable(*ur10(path), Rotation.from_euler("XYZ", turned, degrees=True).as_euler("xyz"))


def draw(given: Namespace) -> Iterator[tuple[str, Path, Path]]:
    yield from ((series, given.data / f"series_{series}.csv", given.out / f"ur10-{series}.csv") for series in "bd")


def written(case: tuple[str, Path, Path]) -> str:
    series, source, path = case
    table = read(source)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    write_new(path, lambda file: write_csv(columns_of(table), file))
    return f"series {series.upper()}: {len(table.q)} poses; wrote {path}"


TRIAL = Trial(
    draw,
    written,
    options={
        "DATA": (DATA / "ipa-ur10", "the folder of series_b.csv and series_d.csv"),
        "OUT": (Path("ur10-tables"), "directory for the tables"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis import read_table
from analysis.procedures.checks.columns import right_mm
from analysis.runs.tables import PoseTable, columns_of
from analysis.runs.written_files import write_csv
from tests.analysis.procedures.checks.test_lost_poses import table
from tests.analysis.runs.test_stands import read_thrice


def written(one: PoseTable, path: Path) -> Path:
    with path.open("wb") as file:
        write_csv(columns_of(one), file)
    return path


def doubts(one: PoseTable, path: Path) -> tuple[str, ...]:
    return read_table(written(one, path), "ur10", "pose").doubts


def test_lost_and_repeated_places_are_named_at_import(tmp_path):
    sound = table(40)
    xyz = sound.xyz_mm.copy()
    xyz[[4, 9]] = 0.0
    xyz[[20, 21]] = xyz[19]
    lost, wild, repeated = doubts(replace(sound, xyz_mm=xyz), tmp_path / "poses.csv")
    assert lost.startswith("rows 5 and 10 ")
    assert wild.startswith("2 of 40 poses ignored: rows 21 and 22 ")
    assert repeated.startswith("rows 20, 21 and 22 ")
    assert doubts(sound, tmp_path / "sound.csv") == ()


def test_a_revisit_with_the_same_rounded_place_is_no_doubt(tmp_path):
    sound = table(20)
    places = np.round(np.tile(sound.xyz_mm, (2, 1)), 1)
    assert doubts(PoseTable(np.tile(sound.q, (2, 1)), places, None), tmp_path / "poses.csv") == ()


def test_readings_of_a_stand_are_averaged_with_a_doubt(tmp_path):
    run = read_table(written(read_thrice(table(20)), tmp_path / "poses.csv"), "ur10", "pose")
    assert len(run.table.q) == 20 and "20 stands" in run.doubts[-1]


@pytest.mark.parametrize(("extent_mm", "expected_mm"), [(200, 4), (500, 10), (1000, 10), (2600, 26)])
def test_largest_error_of_nominal_constants_follows_the_arm(extent_mm, expected_mm):
    """A zero wrong by 0.15° moves the tool of an R-2000iC by 10 mm, which was the limit for arms of every reach."""
    assert right_mm(extent_mm) == pytest.approx(expected_mm)

"""Parameters that are further off than a search corrects: one name with its estimate, and nothing invented next to it.

The readings are of `tests.worlds.arms.independent_arm`, whose kinematics are not those of the product.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from analysis.apps.report.diagnosis_report import write
from analysis.correction.model_files import write_model
from analysis.diagnosis.judge.result import Diagnosis
from rigs.errors import FileError
from rigs.load import load
from tests.support.diagnosis_cells import found_in
from tests.support.handmade_diagnosis import diagnosis
from tests.support.pose_runs import pose_run
from tests.worlds.arms.independent_arm import Wrong, constants_of, flange, none

_POSES = 30
_TOOL_MM = np.array([40.0, 25.0, 130.0])


def _found(wrong: Wrong, seed: int) -> Diagnosis:
    rng = np.random.default_rng(seed)
    low, high = np.radians([(-85, -130, 50, -120, -110, -150), (85, -55, 120, -40, -50, 150)])
    q = rng.uniform(low, high, (_POSES, 6))
    small = replace(
        wrong, a=wrong.a + rng.normal(0, 0.04, 6), offset=wrong.offset + rng.normal(0, np.radians(0.004), 6)
    )
    R, p = flange(constants_of("ur10e"), small, q)
    places = p + R @ _TOOL_MM + [2100.0, -800.0, 600.0] + rng.normal(0, 0.03, (_POSES, 3))
    return found_in([pose_run("ur10e", q, places)], load("ur10e-cell")[0])


def test_large_difference_from_the_data_sheet_is_no_fault_and_is_checked_in_the_rig_file():
    found = _found(replace(none(), a=np.array([0, 0, -15.0, 0, 0, 0])), seed=5)
    assert found.condition == "uncalibrated" and found.calibrated is not None
    assert [act.kind for act in found.acts][:2] == ["check", "load"]  # a correction would hide a wrong rig file
    assert not found.standing and found.budget[0].rank == "difference"
    assert found.budget[0].name == "link_geometry 3.a"


def test_no_model_of_it_is_written(tmp_path):
    found = diagnosis("out_of_range")
    written = write(found, "name: cell\n", tmp_path / "found")
    assert [path.name for path in written] == ["diagnosis.json", "diagnosis.png"]
    answer = json.loads(written[0].read_text())
    assert answer["condition"] == "out_of_range" and answer["accuracy"]["calibrated_um"] is None
    with pytest.raises(FileError, match="joint_offset 5 "):
        write_model(found, "name: cell\n", tmp_path / "cell.yaml")

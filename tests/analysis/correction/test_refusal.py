from pathlib import Path

import numpy as np
import pytest

from analysis.apps.correct.correct_rig import correct_rig
from rigs.calibration import ModelAssessment, ground_of
from rigs.load import load
from tests.support.command_line import json_of, ran
from tests.support.handmade_calibration import calibrated_model, written

SOUND = ModelAssessment(
    condition="named", place="unseen", before_um=90, names_um=40, whole_um=30, handed_um=30, noise_um=5,
    unexplained_um=20,
)  # fmt: skip
NOTHING = [
    ({"handed_um": 95.0}, "95 of 90 µm rms remain in runs not used to fit it, no less than with the nominal arm"),
    (
        {"condition": "outside_library", "handed_um": 85.0},
        "20 µm have an unknown cause; 85 of 90 µm rms remain in runs not used to fit it",
    ),
    (
        {"condition": "outside_library", "place": "used"},
        "20 µm have an unknown cause; 30 of 90 µm rms remain in the runs used to fit it, without validation",
    ),
    (
        {"condition": "outside_library", "place": "used", "left_out_um": 85.0},
        "20 µm have an unknown cause; 30 of 90 µm rms remain in the runs used to fit it, without validation",
    ),
]


def _cell(directory: Path, **changed: object) -> Path:
    judged = ModelAssessment.model_validate(SOUND.model_dump() | changed)
    return written(directory, calibrated_model(judged=judged))[0]


@pytest.mark.parametrize(("changed", "why"), NOTHING)
def test_unproven_model_is_refused_with_the_reason(tmp_path, changed, why):
    cell, out = _cell(tmp_path, **changed), tmp_path / "out"
    done = ran(f"correct {cell} -o {out}")
    assert done.returncode == 3 and not out.exists()
    assert f"{cell}: " in done.stderr and why in done.stderr


def test_left_out_poses_prove_a_model_beside_an_unknown_cause():
    judged = {"condition": "outside_library", "place": "used", "left_out_um": 60.0}
    model = calibrated_model(judged=ModelAssessment.model_validate(SOUND.model_dump() | judged))
    assert ground_of(model) == "gains_elsewhere"


def test_u_of_each_target_includes_the_unexplained_error(tmp_path):
    path = tmp_path / "path.csv"
    path.write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,20,10,0,30,0\n10,25,0,20,-30,30\n")
    u_mm = []
    for unexplained_um in (0.0, 200.0):
        rig, _ = load(str(_cell(tmp_path / str(unexplained_um), unexplained_um=unexplained_um)))
        found = correct_rig(rig, path)
        u_mm.append(np.array([found.path[2].u_mm, found.path[2].u_frame_mm]))
        work = found.work.u_um, found.work.base.u_um
    np.testing.assert_allclose(u_mm[1] ** 2 - u_mm[0] ** 2, 3 * 0.2**2, rtol=1e-6)
    assert min(work) > 1e3 * 0.2


@pytest.mark.parametrize("asks", [False, True])
def test_correction_says_that_more_must_be_measured_first(tmp_path, asks):
    found = json_of(f"correct {_cell(tmp_path, measure_first=asks)} -o {tmp_path / 'out'}")
    assert bool(found["measure_first"]) is asks
    assert ("correct_measure_first" in {key for block in found["blocks"] for key in block.get("keys", ())}) is asks
    assert ("# The calibration asks for more readings" in (tmp_path / "out" / "corrections.yaml").read_text()) is asks

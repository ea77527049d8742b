"""Calibration files that were written anew with a hash of their own are held against the rig file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigs.calibration import CalibratedModel, packed_factor
from rigs.load import load
from tests.support.handmade_calibration import calibrated_model, written
from tests.support.refusals import refused

GOOD = calibrated_model()
COUNT = len(GOOD.parameters)


def _with_term(**changed: Any) -> dict[str, Any]:
    first, second, *rest = GOOD.terms
    return {"terms": (first, second.model_copy(update=changed), *rest)}


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"rig": "ur10e"}, "is the calibration of ur10e, but the rig file describes paper-fanuc"),
        (_with_term(times=1e30), "term 1 has a total offset_deg of 2e+28; the maximum for an arm is"),
        ({"factor": packed_factor(1e30 * np.eye(COUNT))}, "the uncertainty of width_deg of term 0 is 1e+30"),
        ({"factor": packed_factor(np.zeros((COUNT, COUNT)))}, "of term 0 is 0, which is implausible"),
        ({"widened": 1e30}, "contains implausibly large errors"),
        ({"joints_deg": ((-30.0, 30.0),) * 7}, "is for an arm of 7 axes, but the rig file has 6"),
        ({"joints_deg": ((30.0, -30.0),) * 6}, "joints_deg does not contain valid joint ranges"),
        ({"before_um": 1e12}, "contains implausibly large errors"),
        ({"calibrated_um": -3.0}, "contains implausibly large errors"),
    ],
)
def test_a_calibration_that_cannot_be_that_of_the_rig_is_refused(
    tmp_path: Path, changed: dict[str, Any], why: str
) -> None:
    model = CalibratedModel.model_construct(**dict(GOOD) | changed)
    rig_file, beside = written(tmp_path, model)
    with refused("calibration.contradicts_rig") as told:
        load(str(rig_file))
    assert str(told.value).startswith(f"{beside}: ")
    assert why in str(told.value)


def test_one_that_is_of_the_rig_is_taken(tmp_path: Path) -> None:
    assert load(str(written(tmp_path)[0]))[0].calibrated is not None

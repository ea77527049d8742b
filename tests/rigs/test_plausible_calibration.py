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
        ({"rig": "ur10e"}, "ur10e, but"),
        (_with_term(times=1e30), "offset_deg of 2e+28"),
        ({"factor": packed_factor(1e30 * np.eye(COUNT))}, "of term 0 is 1e+30"),
        ({"factor": packed_factor(np.zeros((COUNT, COUNT)))}, "of term 0 is 0"),
        ({"widened": 1e30}, "large errors"),
        ({"joints_deg": ((-30.0, 30.0),) * 7}, "7 axes"),
        ({"joints_deg": ((30.0, -30.0),) * 6}, "joints_deg"),
        ({"before_um": 1e12}, "large errors"),
        ({"calibrated_um": -3.0}, "large errors"),
    ],
)
def test_a_calibration_that_cannot_be_that_of_the_rig_is_refused(tmp_path, changed, why):
    model = CalibratedModel.model_construct(**dict(GOOD) | changed)
    rig_file, beside = written(tmp_path, model)
    with refused("calibration.contradicts_rig") as told:
        load(str(rig_file))
    assert str(told.value).startswith(f"{beside}: ")
    assert why in str(told.value)


def test_one_that_is_of_the_rig_is_taken(tmp_path):
    assert load(str(written(tmp_path)[0]))[0].calibrated is not None

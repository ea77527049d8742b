import numpy as np
import pytest

from analysis import calibrate
from analysis.correction.few_places import widened_for_few_places
from analysis.runs.tables import PoseTable
from tests.support.handmade_calibration import calibrated_model
from tests.support.pose_runs import pose_run
from tests.trials.moved_states import cell_with


@pytest.mark.parametrize(
    ("places", "visits", "widened", "expected"),
    [
        (10, 1, 1.0, 1.654),
        (20, 1, 1.0, 1.654),  # t of 3 degrees of freedom for 95.45 %: 3.307
        (25, 1, 1.0, 1.435),  # of 4: 2.869
        (25, 2, 1.0, 1.435),
        (35, 1, 1.2, 1.259),  # of 6: 2.517
        (35, 1, 1.5, 1.5),
        (120, 1, 1.0, 1.0),
    ],
)
def test_u_is_at_least_students_t_of_the_neighbourhoods(places, visits, widened, expected):
    q = np.tile(np.random.default_rng(3).uniform(-1.5, 1.5, (places, 6)), (visits, 1))
    run = pose_run("ur10e", q, np.zeros((len(q), 3)))
    before = calibrated_model(widened=widened)
    after = widened_for_few_places(before, [run])
    assert after.widened == pytest.approx(expected, abs=2e-3)
    bounds = np.linalg.norm(after.root, axis=1) / np.linalg.norm(before.root, axis=1)
    assert bounds == pytest.approx(after.widened / widened, rel=1e-3)


def test_a_calibration_by_few_poses_has_a_widened_u():
    run = cell_with("ur10e", [{}], np.random.default_rng(21)).runs[0]
    assert isinstance(run.table, PoseTable)
    few = pose_run("ur10e", run.table.q[:22], run.table.xyz_mm[:22])
    calibrated = calibrate([few]).calibrated
    assert calibrated is not None and calibrated.widened > 1.6

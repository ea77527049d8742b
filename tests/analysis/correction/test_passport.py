from dataclasses import replace

import numpy as np
import pytest

from analysis import Diagnosis, diagnose
from rigs.rig import Rig
from tests.support.pose_runs import pose_run
from tests.worlds.arms.independent_arm import cell, none, postures

A4_MM, ZERO_DEG = 0.6, 0.15


def _found(change: dict[str, object], *, zero_deg: float = 0.0) -> Diagnosis:
    """Diagnose an arm whose controller knows length a of axis 4, and whose zero of axis 3 left the factory state."""
    rng = np.random.default_rng(7)
    wrong = replace(none(), a=np.array([0, 0, 0, A4_MM, 0, 0]), offset=np.radians([0, 0, zero_deg, 0, 0, 0]))
    seen = replace(cell("ur10e", wrong, rng), noise_mm=0.015).seen(postures("ur10e", 30, rng), rng)
    run = pose_run("ur10e", seen.q, seen.xyz_mm)
    return diagnose(run, rig=run.rig.model_copy(update=change | {"robot": _robot(run.rig, change)}))


def _robot(rig: Rig, change: dict[str, object]) -> object:
    if change.get("effects"):
        return rig.robot
    axes = list(rig.robot.axes)
    axes[3] = axes[3].model_copy(update={"a_mm": axes[3].a_mm + A4_MM})
    return rig.robot.model_copy(update={"axes": tuple(axes), "controller": "constants"})


@pytest.mark.parametrize("zero_deg", [0.0, ZERO_DEG])
def test_passport_shows_changes_since_the_factory(zero_deg):
    found = _found({}, zero_deg=zero_deg)
    passport = found.to_dict()["passport"]
    assert passport["data_sheet_um"]["value"] > 5 * passport["data_sheet_um"]["u"]
    controller = passport["controller_um"]
    # The value is null where the arm follows the controller more closely than the readings tell.
    differs = controller["value"] is not None and controller["value"] > 2 * controller["u"]
    assert differs == (zero_deg != 0)
    assert passport["changed"] == (["joint_offset 3"] if zero_deg else [])
    assert passport["last_visit_um"] is None and not found.standing
    if zero_deg == 0:
        assert found.condition == "nothing_unusual"

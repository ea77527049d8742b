"""Share of a model that geometric constants can represent."""

import numpy as np
import pytest

from analysis.apps.interchange.exported_arm import geometric_share
from analysis.correction.work import tool_poses, work_angles
from analysis.robot.kinematics.arm import forward
from analysis.robot.predict import geometric_arm, model_of
from rigs.effects.compliance import Compliance
from rigs.effects.gauge_scale import GaugeScale
from rigs.effects.joint_offset import JointOffset
from rigs.effects.link_geometry import LinkGeometry
from rigs.load import load

RIG = load("ur10e-cell")[0]
GEOMETRY = [JointOffset(axis=2, offset_deg=0.05), LinkGeometry(axis=3, field="beta", delta=0.02)]
COMPLIANCE = Compliance(axis=2, deg_per_Nm=1e-4)


def rms_um(apart: np.ndarray) -> float:
    return 1000 * float(np.sqrt((apart[:, :3, 3] ** 2).sum(axis=1).mean()))


def test_geometry_goes_in_whole():
    q = work_angles(RIG)
    share = geometric_share(model_of(RIG, [*GEOMETRY, GaugeScale(gauge="g1", relative=0.01)]))
    moved = tool_poses(model_of(RIG, GEOMETRY), q) - tool_poses(model_of(RIG, ()), q)
    assert share.all_um == pytest.approx(rms_um(moved))
    assert share.left_um == 0
    assert share.left_out == ()


def test_the_rest_is_between_the_model_and_the_arm():
    q = work_angles(RIG)
    model = model_of(RIG, [*GEOMETRY, COMPLIANCE])
    share = geometric_share(model)
    assert share.left_um == pytest.approx(rms_um(tool_poses(model, q) - forward(geometric_arm(model), q)))
    assert share.left_um > 10
    assert share.left_out == (COMPLIANCE,)

import numpy as np
import pytest

from analysis.apps.report.act_words import ActWords
from analysis.procedures.shared.test_kind import path_of
from analysis.robot.kinematics.arm import Array
from analysis.robot.predict import model_of, moved
from rigs.effects import JointScale
from rigs.load import load
from rigs.schema.effect import name_of
from tests.support.diagnosis_cells import RIG, found_in, table_of
from tests.support.nightly import cases
from tests.support.pose_runs import pose_run
from tests.worlds.arms.independent_arm import cell, none, postures


def test_the_link_turns_a_share_of_the_angle_more():
    table = table_of("yaw", "cw", None)
    model = model_of(RIG, (JointScale(axis=3, relative=-0.03),))
    scene = moved(model, path_of(model, table))
    off: Array = scene.link_q[:, 2] - scene.q[:, 2]
    assert off == pytest.approx(-0.03 * scene.q[:, 2], abs=1e-12)
    assert scene.link_q[:, [0, 1, 3, 4, 5]] == pytest.approx(scene.q[:, [0, 1, 3, 4, 5]], abs=1e-12)


@pytest.mark.parametrize("axis", cases((1, 3, 5), {3}))
def test_wrong_gear_ratio_is_named_without_zero_or_gear(axis):
    rng = np.random.default_rng(axis)
    q = postures("ur10e", 30, rng)
    turned = q.copy()
    turned[:, axis - 1] *= 0.97
    seen = cell("ur10e", none(), rng).seen(turned, rng)
    found = found_in([pose_run("ur10e", q, seen.xyz_mm)], load("ur10e-cell")[0])
    assert [name_of(name.effect) for name in found.standing] == [f"joint_scale {axis}"]
    (named,) = found.standing
    assert isinstance(named.effect, JointScale)
    assert named.effect.relative == pytest.approx(-0.03, abs=max(3e-4, 3 * named.sd["relative"]))
    assert "% of the reported angle" in named.remedy and "encoder" in named.remedy
    assert found.acts[0].kind == "check"  # a correction would hide the parameter
    assert "gear ratio" in ActWords(found).what(found.acts[0])

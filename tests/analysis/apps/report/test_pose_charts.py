"""Pictures of poses: the arm with its error vectors, and the errors before and after calibration."""

import json

import numpy as np
import pytest

from analysis.apps.report.chart import ArmChart, live, still
from analysis.apps.report.pose_charts import PoseModel
from analysis.apps.report.run_charts import target_charts
from analysis.apps.report.texts import texts_of
from analysis.diagnosis.judge.comparison import compare
from analysis.procedures.results import result_of
from analysis.robot.kinematics.arm import arm_of, forward, without_setup
from rigs.effects import JointOffset
from tests.support.every import in_every_language
from tests.support.pose_runs import pose_run
from tests.worlds.arms.independent_arm import POSTURE_DEG

WRONG = JointOffset(axis=3, offset_deg=0.2)
HELD_OUT = (3, 30)
"""Rows from 1."""


@pytest.fixture(scope="module")
def measured():
    """40 poses of an arm with a wrong zero, measured without noise, in the base of its rig file."""
    rng, name = np.random.default_rng(4), "ur10e"
    q = np.radians(POSTURE_DEG[name]) + rng.uniform(-0.6, 0.6, (40, 6))
    run = pose_run(name, q, np.zeros((40, 3)))
    arm = arm_of(run.rig.robot)
    return pose_run(name, q, forward(arm, q + np.radians([0, 0, WRONG.offset_deg, 0, 0, 0]))[:, :3, 3])


def pictures(measured, *effects, language="en"):
    rig = measured.rig.model_copy(update={"effects": effects})
    poses = PoseModel(compare([measured], rig).poses, {measured.run.manifest.name: HELD_OUT})
    return target_charts(result_of(measured), texts_of(language), poses)


def arm_chart(measured, *effects):
    return next(picture for picture in pictures(measured, *effects) if isinstance(picture, ArmChart))


def test_links_end_at_the_tool_of_the_drawn_posture(measured):
    chart = arm_chart(measured)
    assert np.linalg.norm(chart.places - chart.links[-1], axis=1).min() < 1e-9
    lengths = np.linalg.norm(np.diff(chart.links[:-1], axis=0), axis=1)
    arm = without_setup(arm_of(measured.rig.robot))
    np.testing.assert_allclose(lengths, np.abs(np.column_stack([arm.a, arm.d])).ravel(), atol=1e-9)


def test_vectors_are_the_errors_in_the_base_before_and_after(measured):
    before, used, held_out = arm_chart(measured, WRONG).vectors
    np.testing.assert_array_equal(before.errors_mm, result_of(measured).curve.error_mm)
    assert before.sizes_mm.max() > 0.5
    assert np.flatnonzero(held_out.there).tolist() == [row - 1 for row in HELD_OUT]
    np.testing.assert_array_equal(used.there, ~held_out.there)
    assert np.nanmax(used.sizes_mm) < 1e-3 and np.nanmax(held_out.sizes_mm) < 1e-3


def test_errors_with_the_model_of_the_rig_file_are_those_of_the_run(measured):
    (poses,) = compare([measured], measured.rig).poses
    found = result_of(measured)
    np.testing.assert_allclose(
        poses.error_mm, found.curve.error_mm[np.argsort(found.found.rows)][poses.rows], atol=2e-3
    )


def test_caption_states_the_factor_by_which_the_largest_vector_is_drawn(measured):
    chart = arm_chart(measured)
    assert f"{chart.magnified:g} times" in chart.caption
    drawn = np.linalg.norm(chart.ends(chart.vectors[0]) - chart.places, axis=1)
    assert drawn.max() == pytest.approx(chart.magnified * chart.vectors[0].sizes_mm.max())


def test_page_gets_plain_values_and_paper_every_label(measured):
    chart = arm_chart(measured, WRONG)
    assert json.loads(json.dumps(live(chart), allow_nan=False))["names"][0].startswith("pose 1: ")
    shown = still(chart)
    assert all(
        words in shown for words in ("x / mm", "y / mm", "z / mm", chart.arm, *(one.name for one in chart.vectors))
    )


@in_every_language
def test_chart_by_pose_names_fitted_and_held_out_poses(measured, language):
    chart = next(picture for picture in pictures(measured, WRONG, language=language) if picture.frame == "targets")
    texts = texts_of(language)
    keys = ("poses_before", "poses_used", "poses_held_out")
    assert [line.name.partition(",")[0] for line in chart.lines] == [texts(key).partition(",")[0] for key in keys]
    assert chart.lines[2].x.tolist() == list(HELD_OUT)

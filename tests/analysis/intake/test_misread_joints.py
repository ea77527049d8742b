import numpy as np
import pytest

from analysis.diagnosis.fit.refine import size_limits
from analysis.intake.imports import propose_map
from analysis.intake.table_map import TableMap, map_text, parse_map
from analysis.procedures.checks.columns import MOST_ZERO_DEG, joint_findings
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.effects import JointOffset
from rigs.load import parse
from tests.support.drawn_tables import seen_by_tracker
from tests.support.misread_joints import Misread, draw_misread, outcome_of
from tests.support.nightly import cases


def misread(signs=(1, 1, 1, 1, 1, 1), zeros_deg=(0, 0, 0, 0, 0, 0), unit="deg", arm="ur10e"):
    poses = seen_by_tracker(arm, 40, np.random.default_rng(12))
    return Misread(arm, poses.q, poses.xyz_mm, np.array(signs, dtype=float), np.array(zeros_deg, dtype=float), unit)


@pytest.mark.cpu_limit(120)
@pytest.mark.parametrize(
    "table",
    [
        misread(zeros_deg=(0, 0, 0, 10, -8, 0)),
        misread(zeros_deg=(0, -90, 0, -90, 0, 0)),
        misread(signs=(1, -1, 1, 1, 1, 1), zeros_deg=(0, 0, 14.4, 0, 0, 0), unit="1/4096 turn"),
        misread(unit="gon"),
        misread(unit="turn"),
    ],
    ids=lambda table: table.words,
)
def test_table_with_other_zeros_directions_or_units_is_read_right(table, tmp_path):
    assert outcome_of(table, tmp_path)[0] == "right"


@pytest.mark.cpu_limit(300)
@pytest.mark.parametrize("seed", cases(range(8), []))
def test_drawn_table_is_never_read_wrong(seed, tmp_path):
    assert outcome_of(draw_misread(np.random.default_rng([97, seed])), tmp_path)[0] != "wrong"


@pytest.mark.cpu_limit(120)
def test_zero_of_the_arm_is_a_question_and_never_assumed(tmp_path):
    (tmp_path / "t.csv").write_text(misread(zeros_deg=(0, 0, 0, 10, -8, 0)).text)
    proposal = propose_map([tmp_path / "t.csv"], "ur10e")
    (question,) = proposal.questions
    assert question.key == "joints" and "re-master J4 by +10" in question.asks
    assumed = proposal.assumed().answered(question, question.readings[0]).table_map.joints
    assert assumed and not assumed.zeros_deg


@pytest.mark.cpu_limit(120)
@pytest.mark.parametrize(
    ("zeros_deg", "strength"), [((0, 0, 0, 10, -8, 0), "decisive"), ((0, 0, 4, 0, 0, 0), "likely")]
)
def test_zeros_in_a_table_of_rig_are_named_instead_of_another_arm(zeros_deg, strength):
    table, rig = misread(zeros_deg=zeros_deg), parse(f"name: arm\n{load_arm('ur10e').text}", "arm.yaml")
    poses = PoseTable(q=table.q - np.radians(zeros_deg), xyz_mm=table.xyz_mm, rpy=None)
    (finding,) = joint_findings(poses, rig)
    assert (finding.strength, finding.columns) == (strength, tuple(f"q{k + 1}_deg" for k in np.flatnonzero(zeros_deg)))
    assert "re-master" in finding.remedy


def test_largest_zero_of_a_diagnosis_is_that_of_the_effect():
    assert size_limits(JointOffset(axis=1, offset_deg=1.0))[1] == MOST_ZERO_DEG


def test_map_keeps_zeros_and_refuses_another_number_of_them(tmp_path):
    joints = {"columns": [f"J{k}" for k in range(1, 7)], "unit": "1/4096 turn", "zeros_deg": [0, 180, 0, 0, 0, 0]}
    given = TableMap.model_validate({"files": [{}], "joints": joints})
    assert parse_map(map_text(given), "map.yaml") == given
    with pytest.raises(ValueError, match="zeros_deg has 2 values"):
        TableMap.model_validate({"files": [{}], "joints": joints | {"zeros_deg": [0, 180]}})

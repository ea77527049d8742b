from collections.abc import Sequence

import pytest

from analysis.diagnosis.judge.budget_part import BudgetPart
from analysis.diagnosis.judge.result import Diagnosis
from rigs.effects import JointOffset
from rigs.schema.effect import label_of
from tests.support.diagnosis_cells import found_in, poses
from tests.support.made_once import made_once

BOTH = (JointOffset(axis=2, offset_deg=0.8), JointOffset(axis=3, offset_deg=0.2))


@made_once
def _of_poses(*off: JointOffset) -> Diagnosis:
    return found_in([poses(2, *off)])


def _line(found: Diagnosis, effect: str) -> BudgetPart:
    (one,) = (part for part in found.budget if part.index is not None and part.name == effect)
    return one


def _of_kind(parts: Sequence[BudgetPart], kind: str) -> list[BudgetPart]:
    return [one for one in parts if one.kind == kind]


def test_the_shares_are_the_whole_gap_the_largest_first():
    parts = _of_poses(*BOTH).budget
    assert sum(one.share for one in parts) == pytest.approx(1.0, abs=1e-9)
    assert all(0 <= one.share <= 1 for one in parts)
    assert [one.share for one in parts] == sorted((one.share for one in parts), reverse=True)
    assert len(_of_kind(parts, "scatter")) == len(_of_kind(parts, "unexplained")) == 1
    assert all(one.um >= 0 and one.u_um >= 0 for one in parts)
    joints = [one.axis for one in _of_kind(parts, "curve")]
    assert len(joints) == len(set(joints))  # each joint has one curve


def test_parts_that_cancel_share_a_line():
    """Two zeros of which the smaller one makes the larger one's error less: without it the gap would be wider."""
    found = _of_poses(*BOTH)
    line, (large, small) = _line(found, label_of(BOTH[0])), found.effects
    assert [label_of(one.effect) for one in (large, small)] == [label_of(one) for one in BOTH]
    assert line == found.budget[0] and line.cancelled == (label_of(BOTH[1]),)
    assert all(one.name != label_of(BOTH[1]) for one in found.budget)  # it is counted once
    assert small.alone_um > found.train.before_um  # its remedy alone makes the gap wider
    assert line.um == pytest.approx(found.train.before_um, rel=0.01)  # both together, not the larger one alone
    assert [one.label for one in line.together] == [label_of(one) for one in BOTH]
    # each alone
    assert [one.um for one in line.together] == pytest.approx([large.contribution_um, small.contribution_um], rel=0.01)
    assert large.gap_without_um > 1.1 * line.um and small.gap_without_um > 0.2 * line.um

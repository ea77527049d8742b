from collections.abc import Sequence
from types import SimpleNamespace

import pytest

from analysis.diagnosis.judge.budget import Budget
from analysis.diagnosis.judge.budget_part import BudgetPart, GroupMember
from analysis.diagnosis.judge.result import Diagnosis
from rigs.effects import JointOffset, LinkGeometry
from rigs.schema.effect import healthy, label_of, scaled
from rigs.schema.reference import Reference
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


_ZERO, _LENGTH = JointOffset(axis=2, offset_deg=1.0), LinkGeometry(axis=3, field="a", delta=1.0)


@pytest.mark.parametrize(
    ("effect", "times", "odds", "rank"),
    [
        (_ZERO, 4.0, 0.999, "usual"),
        (_ZERO, 6.0, 0.999, "undecided"),
        (_ZERO, 6.0, 0.6, "usual"),
        (_LENGTH, 6.0, 0.999, "difference"),
    ],
)
def test_group_is_usual_only_if_the_member_that_dominates_it_is(effect, times, odds, rank):
    reference = Reference("light", is_data_sheet=True)
    large = scaled(healthy(effect), times * effect.usual_times(reference))
    part = BudgetPart(
        "constants", 660.0, 30.0, 0.9, times_usual=0.4, rank="usual",
        members=(GroupMember(large, 600.0, odds, 20.0, share=0.9),),
    )  # fmt: skip
    of_group = Budget(SimpleNamespace(reference=reference), None)
    assert of_group._with_rank_of_member(part).rank == rank

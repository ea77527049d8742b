"""The budget: its lines add up to the gap, a fault is one line, what cancels stands on the line of what it cancels, and
the uncertainty is of what an effect does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from analysis.apps.report.act_words import ActWords
from analysis.apps.report.answer_words import AnswerWords
from analysis.apps.report.texts import keys_of
from analysis.diagnosis.judge.result import BudgetPart, Diagnosis
from rigs.effects import Backlash, Compliance, Effect, JointOffset
from rigs.schema.effect import label_of, name_of
from tests.support.diagnosis_cells import circles, found_in, poses
from tests.support.made_once import made_once

PLAY = Backlash(axis=1, width_deg=0.06, transit=0.2)
SOFT = Compliance(axis=3, deg_per_Nm=29 * 5e-5, payload_kg=5.0)
BOTH = (JointOffset(axis=2, offset_deg=0.8), JointOffset(axis=3, offset_deg=0.2))


@made_once
def _of_circles(*effects: Effect) -> Diagnosis:
    return found_in(circles(effects, seed=14))


@made_once
def _of_poses(*off: JointOffset) -> Diagnosis:
    return found_in([poses(2, *off)])


def _line(found: Diagnosis, effect: str) -> BudgetPart:
    (one,) = (part for part in found.budget if part.index is not None and part.name == effect)
    return one


def _of_kind(parts: Sequence[BudgetPart], kind: str) -> list[BudgetPart]:
    return [one for one in parts if one.kind == kind]


@pytest.mark.parametrize(
    "found", [lambda: _of_circles(PLAY), _of_circles, lambda: _of_poses(*BOTH)], ids=["play", "none", "poses"]
)
def test_the_shares_are_the_whole_gap_the_largest_first(found: object) -> None:
    parts = found().budget  # type: ignore[operator]
    assert sum(one.share for one in parts) == pytest.approx(1.0, abs=1e-9)
    assert all(0 <= one.share <= 1 for one in parts)
    assert [one.share for one in parts] == sorted((one.share for one in parts), reverse=True)
    assert len(_of_kind(parts, "scatter")) == len(_of_kind(parts, "unexplained")) == 1
    assert all(one.um >= 0 and one.u_um >= 0 for one in parts)
    joints = [one.axis for one in _of_kind(parts, "curve")]
    assert len(joints) == len(set(joints))  # each joint has one curve


def test_a_single_play_is_one_line_of_nearly_all() -> None:
    found = _of_circles(PLAY)
    line = _line(found, "backlash 1")
    assert line == found.budget[0] and line.share > 0.95 and line.rank == "unusual" and line.doubt is None
    assert line.times_usual == pytest.approx(6.0, abs=0.3) and line.odds and line.odds > 0.95
    assert line.sigma > 100 and found.effects[line.index or 0].u_um == line.u_um
    # With the set-up fitted the gap is the play's own, and the scatter's.
    rest = found.train.calibrated_um
    assert line.um == pytest.approx((found.train.before_um**2 - rest**2) ** 0.5, rel=0.01)
    assert all(one.rank != "unusual" for one in found.budget[1:])


def test_what_cancels_another_part_is_one_line_with_it() -> None:
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
    assert keys_of(AnswerWords(found).part_name(line))[0] == "with_cancelled"
    (act,) = (one for one in found.acts if one.effect == large.effect)
    assert "act_uncovers" in keys_of(ActWords(found).removes(replace(act, with_before_um=None)))
    assert large.gap_without_um > 1.1 * line.um and small.gap_without_um > 0.2 * line.um


@pytest.mark.nightly  # 7 s; this softness stands beside usual errors, with its u, in test_believed.py in each commit
def test_a_payload_that_is_stated_leaves_a_softness_as_certain_as_what_it_does() -> None:
    """A softer joint with less payload would do nearly the same, and the rig file says what the payload is."""
    found = _of_circles(SOFT)
    line = _line(found, name_of(SOFT))
    (one,) = found.standing
    assert line.rank == "unusual" and line.u_um < 0.02 * line.um
    assert one.sd["deg_per_Nm"] / getattr(one.effect, "deg_per_Nm", 0.0) == pytest.approx(line.u_um / line.um, rel=0.2)


def test_nothing_of_a_healthy_arm_is_unusual_and_scatter_is_what_there_is() -> None:
    found = _of_circles()
    assert all(one.rank != "unusual" for one in found.budget)
    assert found.budget[0].kind == "scatter"
    assert found.budget[0].um == pytest.approx(found.train.noise_floor_um, rel=0.5)

"""The staircase: its ends are the gap that is stated elsewhere, its parts together are the calibrated model, and each
step leaves what its model leaves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.apps.plant.comparison_report import save_pictures
from analysis.apps.report.stairs import residual_words, stairs_of, stairs_of_model
from analysis.diagnosis.evidence.observation import rms
from analysis.diagnosis.evidence.setups import fit_run_setups, with_effects
from analysis.diagnosis.judge.compare_runs import compare
from analysis.diagnosis.judge.residuals import ModelResidual
from analysis.diagnosis.judge.staircase import located, located_residual
from rigs.effects import Backlash, JointOffset
from tests.support.diagnosis_cells import DEMO, RIG, circles, demo, seen

PLAY = Backlash(axis=1, width_deg=0.03, transit=0.2)


def test_its_ends_are_the_gap_and_its_parts_the_calibrated_model() -> None:
    found = demo()
    stairs = found.staircase
    assert stairs and stairs.places == ("used", "unseen")
    first, last = stairs.steps[0], stairs.steps[-1]
    assert found.unseen and first.unseen and last.unseen
    assert (first.parts, first.used.um, last.used.um) == ((), found.train.before_um, found.train.calibrated_um)
    assert (first.unseen.um, last.unseen.um) == (found.unseen.before_um, found.unseen.calibrated_um)
    assert last.used.um < 0.1 * first.used.um  # the gap shrinks
    parts = [k for step in stairs.steps for k in step.parts]
    assert len(parts) == len(set(parts))  # no part is added twice
    unadded = [part for k, part in enumerate(found.budget) if k not in parts]
    assert sum(abs(part.share) for part in unadded if part.kind not in ("scatter", "unexplained")) < 0.025


def test_a_step_leaves_what_its_model_leaves() -> None:
    """The remaining error of the first step equals that of an independent simulation with the first part and all
    readings.
    """
    found = demo()
    assert found.staircase
    step = found.staircase.steps[1]
    (part,) = (found.budget[k] for k in step.parts)
    assert part.index is not None  # a fault is the largest part here
    _, left = fit_run_setups(with_effects(seen(circles(DEMO)), [found.effects[part.index].effect]))
    assert step.used.um == pytest.approx(1e3 * rms(left), rel=0.03)


def test_the_curves_are_those_of_the_steps() -> None:
    found = demo()
    assert found.staircase
    for curve, steps_um in zip(found.curves, found.staircase.curves, strict=True):
        assert steps_um.shape == (len(found.staircase.steps), *curve.before_um.shape)
        np.testing.assert_allclose(steps_um[0], curve.before_um, atol=1e-6)
    sizes = [float(np.mean([np.mean(one[k] ** 2) for one in found.staircase.curves]) ** 0.5) for k in range(2)]
    told = [step.used.um for step in found.staircase.steps[:2]]
    assert sizes[1] / sizes[0] == pytest.approx(told[1] / told[0], rel=0.1)


def test_the_steps_are_in_the_object_by_name_and_in_words() -> None:
    found = demo()
    told = found.to_dict()["staircase"]
    assert told[0]["parts"] == [] and told[-1]["left"]["used"]["um"] == found.train.calibrated_um
    assert told[0]["left"]["held_out"] is None
    stairs = stairs_of(found)
    assert stairs
    assert any("axis 3 (U)" in name for name in stairs.names[1:])


@pytest.mark.parametrize(
    ("left", "words"),
    [(ModelResidual(12.34, 0.5), "12.3 ± 0.5"), (ModelResidual(0.1, 0.9), "< 0.9"), (ModelResidual(3.0, 0.0), "3.0")],
)
def test_what_is_far_below_its_uncertainty_is_said_to_be_so(left: ModelResidual, words: str) -> None:
    assert residual_words(left) == words


def test_a_comparison_shows_where_with_the_joint_that_turns_back() -> None:
    runs = circles((PLAY,), seed=73, count=1)
    bare = located_residual(RIG, runs)
    assert bare.staircase is None and {place.joint for place in bare.where if "step" in place.why} == {1}
    compared = located(compare(runs, RIG), RIG, runs)
    assert any(place["joint"] == 1 for place in compared.to_dict()["where"])


def test_a_comparison_adds_the_effects_of_the_rig_file_the_largest_first(tmp_path: Path) -> None:
    small = JointOffset(axis=5, offset_deg=0.002)
    rig = RIG.model_copy(update={"effects": (small, PLAY)})
    runs = circles((PLAY, small), seed=74, count=1)
    compared = located(compare(runs, rig), rig, runs)
    own = compared.disagreement
    assert own and own.staircase
    assert [step.parts for step in own.staircase.steps] == [(), (1,), (0,)]
    um = [step.used.um for step in own.staircase.steps]
    assert um[0] > 10 * um[1] > 10 * um[2] * 0.9
    stairs = stairs_of_model(own)
    assert stairs and stairs.names[1].endswith("axis 1 (Theta)")
    assert tmp_path / "where.png" in save_pictures(compared, tmp_path)

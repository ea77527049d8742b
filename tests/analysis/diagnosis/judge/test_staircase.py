import pytest

from analysis.diagnosis.evidence.observation import rms
from analysis.diagnosis.evidence.setups import fit_run_setups, with_effects
from analysis.diagnosis.judge.comparison import compare
from analysis.diagnosis.judge.staircase import located
from rigs.effects import Backlash, JointOffset
from tests.support.diagnosis_cells import DEMO, RIG, circles, demo, seen

PLAY = Backlash(axis=1, width_deg=0.03, transit=0.2)


def test_its_ends_are_the_gap_and_its_parts_the_calibrated_model():
    found = demo()
    stairs = found.staircase
    assert stairs.places == ("used", "unseen")
    first, last = stairs.steps[0], stairs.steps[-1]
    assert found.unseen and first.unseen and last.unseen
    assert (first.parts, first.used.um, last.used.um) == ((), found.train.before_um, found.train.calibrated_um)
    assert (first.unseen.um, last.unseen.um) == (found.unseen.before_um, found.unseen.calibrated_um)
    assert last.used.um < 0.1 * first.used.um  # the gap shrinks
    parts = [k for step in stairs.steps for k in step.parts]
    assert len(parts) == len(set(parts))  # no part is added twice
    unadded = [part for k, part in enumerate(found.budget) if k not in parts]
    assert sum(abs(part.share) for part in unadded if part.kind not in ("scatter", "unexplained")) < 0.025


def test_step_has_the_remaining_error_of_its_model():
    found = demo()
    step = found.staircase.steps[1]
    (part,) = (found.budget[k] for k in step.parts)
    assert part.index is not None  # a fault is the largest part here
    _, left = fit_run_setups(with_effects(seen(circles(DEMO, count=1)), [found.effects[part.index].effect]))
    assert step.used.um == pytest.approx(1e3 * rms(left), rel=0.03)


def test_a_comparison_adds_the_effects_of_the_rig_file_the_largest_first():
    small = JointOffset(axis=5, offset_deg=0.002)
    rig = RIG.model_copy(update={"effects": (small, PLAY)})
    runs = circles((PLAY, small), seed=74, count=1)
    compared = located(compare(runs, rig), rig, runs)
    own = compared.disagreement
    assert own.staircase
    assert [step.parts for step in own.staircase.steps] == [(), (1,), (0,)]
    um = [step.used.um for step in own.staircase.steps]
    assert um[0] > 10 * um[1] > 10 * um[2] * 0.9

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.observation import rms
from analysis.diagnosis.evidence.setups import fit_run_setups, with_effects
from analysis.robot.geometry.circle import frame_of
from rigs.effects import Backlash, JointOffset, TransmissionError
from tests.support.diagnosis_cells import RIG, circles, planted, remounted_circles, seen

WAYS = {"up": [0, 0, 1], "askew": [-0.6, 0.6, -0.5]}


@pytest.mark.parametrize("way", WAYS)
def test_a_ball_and_zeros_that_are_off_are_found(way):
    runs = seen(circles(seed=4, count=1))
    start = replace(planted(), ball=planted().ball + 3.0 * np.array(WAYS[way]), zeros_mm=3.0 * np.array([0.5, -0.3]))
    found, left = fit_run_setups(runs, setups={"yaw": start})
    frame = frame_of(RIG.tests.circle)
    off = found["yaw"].ball - planted().ball
    # A simulated ball scatters by a micrometre; its height over the circle's plane shows next to nowhere.
    assert np.abs([off @ frame.u, off @ frame.v]).max() < 0.005
    assert abs(off @ frame.n) < 4.0
    assert abs(found["yaw"].zeros_mm[1] - found["yaw"].zeros_mm[0]) < 0.002
    assert rms(left) < 0.005


def test_effects_are_in_the_model_whose_set_up_is_fitted():
    effect = Backlash(axis=1, width_deg=0.05)
    runs = seen(circles((effect,), seed=4, count=1))
    without, within = (rms(fit_run_setups(with_effects(runs, effects))[1]) for effects in ((), (effect,)))
    assert within < 0.005
    assert without > 0.05


def test_ball_is_found_at_the_tool_of_a_wrong_arm():
    """Along the normal of its circle a ball hardly shows, so that whatever else is wrong would place it there."""
    offset = JointOffset(axis=2, offset_deg=1.5)
    measured, shift = remounted_circles(offset, TransmissionError(axis=1, order=30, amplitude_deg=0.02), seed=6)
    found, left = fit_run_setups(with_effects(seen(measured), (offset,)))
    assert np.linalg.norm(shift) > 10
    assert rms(left) > 0.02
    assert np.linalg.norm(found["yaw"].ball - planted().ball - shift) < 2.0

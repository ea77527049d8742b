from __future__ import annotations

import numpy as np
import pytest

from analysis.runs.stands import beyond_limits, turns_further, without_whole_turns
from analysis.runs.tables import PoseTable
from rigs.effects import TransmissionError
from rigs.load import load

RIG = load("ur10e")[0].model_copy(update={"effects": ()})
LIMITS = np.radians([-360.0, 360.0])
RNG = np.random.default_rng(8)


def table(counted: int) -> PoseTable:
    q = np.radians(RNG.uniform(-60, 60, (40, 6)))
    q[30:, 3] += counted * 2 * np.pi
    return PoseTable(q, RNG.normal(size=(40, 3)), None)


@pytest.mark.parametrize("counted", [-1, 1])
def test_rows_a_whole_turn_away_are_counted_back_and_named(counted):
    turned, doubts = without_whole_turns(table(counted), RIG)
    assert np.ptp(np.degrees(turned.q[:, 3])) < 120
    assert len(doubts) == 1 and "axis 4" in doubts[0] and "rows 31 to 40" in doubts[0]


def test_a_joint_that_turns_all_over_its_range_has_really_turned():
    assert not turns_further(np.radians(RNG.uniform(-350, 350, 60)), LIMITS).any()
    beyond = np.radians(np.append(RNG.uniform(-170, 170, 60), 190.0))
    assert turns_further(beyond, np.radians([-180.0, 180.0])).tolist() == [0] * 60 + [1]


def test_rows_one_turn_lower_are_corrected_together():
    """The angle of -354° is a turn too low, like those below -360°, but within the limits of 360°."""
    angle = np.concatenate([RNG.uniform(-170, 170, 40), [-466.8, -400.0, -380.0, -354.1]])
    assert turns_further(np.radians(angle), LIMITS).tolist() == [0] * 40 + [-1] * 4
    typo = np.radians(np.append(RNG.uniform(-350, 350, 60), 400.0))
    assert turns_further(typo, LIMITS).tolist() == [0] * 60 + [1]  # the joint really turns


def test_angles_within_less_than_a_turn_are_as_they_stand():
    """Two ranges of a joint with a wide gap behind: counted back, they were 360° off, and outside of the limits."""
    apart = np.radians(np.concatenate([RNG.uniform(-136, -81, 30), RNG.uniform(56, 138, 30)]))
    assert not turns_further(apart, np.radians([-179.0, 179.0])).any()
    assert not turns_further(apart, LIMITS).any()


def test_non_repeating_gear_error_keeps_its_turn():
    wave = TransmissionError(axis=4, order=50.5, amplitude_deg=0.01, phase_deg=0.0)
    one = table(1)
    assert without_whole_turns(one, RIG.model_copy(update={"effects": (wave,)})) == (one, ())


def test_joint_outside_its_limits_is_named_with_rows_and_value():
    one = table(0)
    one.q[4, 1] = np.radians(400.0)
    (doubt,) = beyond_limits(one, RIG)
    assert "axis 2" in doubt and "400.0°" in doubt and "in row 5" in doubt
    assert beyond_limits(table(0), RIG) == ()

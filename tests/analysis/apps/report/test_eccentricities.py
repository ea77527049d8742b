"""Eccentricity by angle and by distance: a remark explains a difference beyond the noise."""

import numpy as np
import pytest

import analysis
from analysis.apps.report.run_answer import eccentricities_in_words
from rigs.effects import JointOffset


def test_an_error_of_the_arm_says_why_two_eccentricities_differ_and_a_sound_arm_says_nothing():
    """A wrong zero turns the tool and shifts its circle by different amounts: no place of the ball is both."""
    sound, bent = (
        analysis.evaluate(analysis.simulate("paper-fanuc", "yaw", "acw", effects=effects))
        for effects in ((), (JointOffset(axis=3, offset_deg=0.05),))
    )
    assert eccentricities_in_words([sound]) == []
    by_angle, by_distance = bent.figures["eccentricity_mm"], bent.figures["distance_eccentricity_mm"]
    apart, u = abs(by_angle.value - by_distance.value), float(np.hypot(by_angle.u, by_distance.u))
    assert apart > 4 * u and by_distance.value == pytest.approx(by_angle.value, abs=1)
    (line,) = eccentricities_in_words([sound, bent])
    assert f" {1000 * apart:.0f} µm" in line

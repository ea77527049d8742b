"""Effects: signs of measurement.md, zero is the identity, and the vocabulary and the files match."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import analysis.effects
from analysis.effects import link_side
from rigs.effects import Backlash, Effect, JointOffset, TransmissionError

Q = np.zeros((401, 6))
Q[:, 1] = np.radians(np.concatenate([np.linspace(0, 2, 200), np.linspace(2, 0, 201)]))


def _deviation_deg(effect: Effect) -> np.ndarray:
    return np.degrees(link_side([effect], Q) - Q)


def test_backlash_lags_half_its_width_and_crosses_it_at_a_reversal() -> None:
    lag = _deviation_deg(Backlash(effect="backlash", axis=2, width_deg=0.1))
    assert np.abs(lag[:, [0, 2, 3, 4, 5]]).max() == 0
    rising, falling = lag[20:200, 1], lag[220:, 1]
    np.testing.assert_allclose(rising, -0.05, atol=1e-12)
    np.testing.assert_allclose(falling, +0.05, atol=1e-12)
    assert (np.diff(lag[200:220, 1]) >= -1e-12).all()


def test_backlash_is_the_play_operator_sample_by_sample() -> None:
    rng = np.random.default_rng(3)
    q = np.zeros((3000, 6))
    q[:, 0] = np.cumsum(rng.normal(0, 1e-3, 3000))
    half = np.radians(0.2) / 2
    y = [q[0, 0]]
    for x in q[1:, 0]:
        y.append(min(max(y[-1], x - half), x + half))
    linked = link_side([Backlash(effect="backlash", axis=1, width_deg=0.2)], q)
    np.testing.assert_allclose(linked[:, 0], y, atol=1e-15)


def test_offset_and_transmission_error_add_to_the_reported_angle() -> None:
    offset = JointOffset(effect="joint_offset", axis=2, offset_deg=0.3)
    gear = TransmissionError(effect="transmission_error", axis=2, order=100, amplitude_deg=0.01, phase_deg=30)
    both = np.degrees(link_side([offset, gear], Q) - Q)[:, 1]
    np.testing.assert_allclose(both, 0.3 + 0.01 * np.sin(100 * Q[:, 1] + np.radians(30)), atol=1e-12)


@pytest.mark.parametrize(
    "effect",
    [
        JointOffset(effect="joint_offset", axis=2, offset_deg=0),
        Backlash(effect="backlash", axis=2, width_deg=0),
        TransmissionError(effect="transmission_error", axis=2, order=3, amplitude_deg=0),
    ],
)
def test_a_zero_effect_changes_nothing(effect: Effect) -> None:
    assert np.array_equal(link_side([effect], Q), Q)


def test_every_name_of_the_vocabulary_has_its_file_and_the_other_way_round() -> None:
    union = get_args(get_args(Effect)[0])
    names = {get_args(model.model_fields["effect"].annotation)[0] for model in union}
    files = {path.stem for path in Path(analysis.effects.__file__).parent.glob("*.py")} - {"__init__"}
    assert names == files

"""The second order against a curve that is known in closed form."""

import numpy as np
import pytest

from analysis.procedures.shared.lap_curve import PHI
from analysis.procedures.shared.second_order import second_order_figures


@pytest.mark.parametrize("at_deg", [0.0, 40.0, 130.0])
def test_two_waves_are_found_beside_a_sine_and_an_offset(at_deg: float) -> None:
    waves = 0.002 * np.cos(2 * (PHI - np.radians(at_deg)))
    found = second_order_figures(0.1 + 0.3 * np.sin(PHI) + waves, 70.0)
    assert found["second_order_deg"] == pytest.approx(np.degrees(0.002))
    assert np.cos(2 * np.radians(found["second_order_at_deg"] - at_deg)) == pytest.approx(1.0)


def test_curves_are_evaluated_in_stacks() -> None:
    stack = np.stack([np.cos(2 * PHI), 3 * np.cos(2 * PHI)])
    np.testing.assert_allclose(second_order_figures(stack, 70.0)["second_order_deg"], np.degrees([1.0, 3.0]))

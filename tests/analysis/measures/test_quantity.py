"""How a figure is rounded for a person."""

from __future__ import annotations

import pytest

from analysis.measures.quantity import Quantity


@pytest.mark.parametrize("u", [0.0, 0.012, float("inf")])
def test_a_small_negative_value_is_no_negative_zero(u: float) -> None:
    rounded = Quantity(0.0, u, "mm").rounded(-0.00001)
    assert float(rounded) == 0 and not rounded.startswith("-")
    assert Quantity(0.0, u, "mm").rounded(-0.06).startswith("-0.06")

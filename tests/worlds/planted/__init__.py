"""Simulated cases with known results: every figure is measured in noise and compared with its exact value.

`closed_forms` contains the formulas, `cells` the noise of a cell, `circles`, `targets` and `poses` the tests, and
`score` the agreement of figures with the truth.
"""

from tests.worlds.planted.closed_forms import (
    BALL,
    FINE,
    FRAME,
    circle_readings,
    directions,
    hemisphere,
    repeatability_table,
    true_radial,
    ur10,
    with_readings,
    wrong_angle,
)

__all__ = [
    "BALL",
    "FINE",
    "FRAME",
    "circle_readings",
    "directions",
    "hemisphere",
    "repeatability_table",
    "true_radial",
    "ur10",
    "with_readings",
    "wrong_angle",
]

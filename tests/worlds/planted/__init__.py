"""Planted cases: every reported figure measured from closed forms in noise, beside what was planted.

`closed_forms` holds the formulas, `cells` the noise of a cell, `circles`, `targets` and `poses` the tests, `score` how
well figures agree with the truth.
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

"""Least squares within bounds, compared with scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear, nnls

from analysis.robot.kinematics.bounded_least_squares import bounded_least_squares


@pytest.mark.parametrize("seed", range(40))
def test_the_optimum_within_bounds_is_that_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = int(rng.integers(1, 13))
    A, values = rng.normal(size=(q + seed % 3, q)), rng.normal(size=q + seed % 3)
    low, high = np.sort(rng.normal(scale=1.5, size=(2, q)), axis=0)
    low[rng.random(q) < 0.3], high[rng.random(q) < 0.3] = -np.inf, np.inf
    best, is_at_bound = bounded_least_squares(A, values, low, high)
    expected = lsq_linear(A, values, (low, high), method="bvls", tol=1e-14)
    assert best == pytest.approx(expected.x, rel=1e-7, abs=1e-7)
    assert (is_at_bound == (expected.active_mask != 0)).all()
    assert ((best >= low) & (best <= high)).all()


@pytest.mark.parametrize("seed", range(10))
def test_non_negative_least_squares_ignore_columns_of_zeros(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, values = rng.normal(size=(50, 6)), rng.normal(size=50)
    A[:, seed % 6] = 0.0
    best, _ = bounded_least_squares(A, values, np.zeros(6), np.full(6, np.inf))
    assert float(np.linalg.norm(values - A @ best)) == pytest.approx(nnls(A, values)[1], rel=1e-12)
    assert best[seed % 6] == 0.0

"""Stands of a recorded motion, with bad rows of the robot's feedback among them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from analysis.traces.stands import stands_of


def motion(stands: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, angles and readings at 100 Hz: stands of 3 s with a second of motion between two."""
    t_s = np.arange(0, 4 * stands, 0.01)
    share = np.clip(t_s % 4 - 3, 0, 1) + t_s // 4
    noise = np.random.default_rng(3).normal(0, 1e-6, (len(t_s), 6))
    return t_s, np.radians(10 * share)[:, None] * np.arange(1, 7) + noise, np.stack([share, -share], axis=1)


@pytest.mark.parametrize("off_deg", [0.05, 30.0, -0.02])
def test_a_bad_row_in_each_stand_changes_no_stand(off_deg: float) -> None:
    t_s, q, g_mm = motion()
    clean = stands_of(t_s, q, g_mm)
    assert len(clean) == 4
    bad = q.copy()
    bad[150::400, 2] += np.radians(off_deg)
    seen = stands_of(t_s, bad, g_mm)
    assert [(one.begin, one.end) for one in seen] == [(one.begin, one.end) for one in clean]
    for one, other in zip(seen, clean, strict=True):
        np.testing.assert_allclose(one.q, other.q, atol=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_stands_never_share_a_row(seed: int) -> None:
    t_s, q, g_mm = motion()
    rng = np.random.default_rng(seed)
    rows = rng.integers(len(t_s), size=40)
    q[rows, rng.integers(6, size=40)] += np.radians(rng.choice([0.05, 5.0], size=40))
    stands = stands_of(t_s, q, g_mm)
    assert all(one.end <= other.begin for one, other in itertools.pairwise(stands))

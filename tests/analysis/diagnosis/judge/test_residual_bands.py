"""Noise alone leaves little; an effect outside the library leaves more, and its band is reported."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.evidence.observation import ORDER_OF
from analysis.diagnosis.judge.residuals import bands_above_noise
from tests.support.diagnosis_cells import Array, healthy, white

HALF = len(ORDER_OF) // 2


def _bump(block: int, part: int, low: int, high: int, size: float) -> Array:
    """A deterministic bump of `size` standard deviations in every order of a band of one block; part 0 distance, 1
    angle."""
    linear = healthy()
    bump = np.zeros(len(linear.y))
    entries = np.flatnonzero((low <= ORDER_OF) & (high >= ORDER_OF) & (np.arange(len(ORDER_OF)) // HALF == part))
    # Behind the orders of a block stand its means over standing and its trend.
    bump[linear.rows[block].start + entries] = size * (-1.0) ** entries
    return bump


def test_noise_alone_has_no_band_that_is_reported() -> None:
    linear = healthy()
    assert all(bands_above_noise(linear.blocks, white(linear, seed)) == () for seed in range(20))


@pytest.mark.parametrize(("block", "part", "orders"), [(0, 1, (8, 15)), (1, 0, (30, 59)), (1, 1, (3, 7))])
def test_a_bump_exceeds_it_and_is_reported_by_its_band(block: int, part: int, orders: tuple[int, int]) -> None:
    linear = healthy()
    left = white(linear, 1) + _bump(block, part, *orders, 3.0)
    first = bands_above_noise(linear.blocks, left)[0]
    assert (first.test, first.direction) == ("yaw", ("cw", "acw")[block])
    assert (first.part, first.orders) == (("distance", "angle")[part], orders)
    assert first.ratio > 4 and f"{orders[0]} to {orders[1]} waves" in first.words


def test_the_band_with_most_energy_in_mm_is_first() -> None:
    """Not the one with most sigmas: fine orders are quiet, and a little there is worth little."""
    linear = healthy()
    sd = np.concatenate([block.sd_mm for block in linear.blocks])
    slow, fine = _bump(0, 0, 3, 7, 2.5), _bump(1, 1, 120, 255, 2.5)
    found = bands_above_noise(linear.blocks, white(linear, 4) + slow + fine)
    energies = [float(((bump * sd) ** 2).sum()) for bump in (slow, fine)]
    wanted = [(3, 7), (120, 255)][int(np.argmax(energies))]
    assert found[0].orders == wanted and len(found) >= 2


def test_less_than_noise_is_nothing() -> None:
    linear = healthy()
    assert bands_above_noise(linear.blocks, 0.5 * white(linear, 1)) == ()

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.observation import GRID, ORDER_OF
from analysis.diagnosis.fit.responses import Linearisation, limits_um, linearise, noise_um
from analysis.diagnosis.plan.further_tests import sigma_between
from rigs.effects import Effect
from rigs.effects.backlash import Backlash
from tests.support.diagnosis_cells import healthy, scatter_um

RUNS = 40


def _with_apart(um: float) -> Linearisation:
    """Many runs that differ from their mean by so much, rms of a gauge."""
    rng, linear = np.random.default_rng(3), healthy()
    sd_mm = 1e-3 * um * np.sqrt(2 * GRID / len(ORDER_OF))
    apart = [rng.normal(0.0, sd_mm, (RUNS, len(block.y_mm))) for block in linear.blocks]
    blocks = [replace(block, steady_mm=one) for block, one in zip(linear.blocks, apart, strict=True)]
    return linearise(blocks, linear.setups)


@pytest.mark.parametrize("um", [5.0, 50.0])
def test_scatter_of_a_run_follows_from_its_repeats(um):
    np.testing.assert_allclose(scatter_um(_with_apart(um)), um, rtol=0.05)
    np.testing.assert_allclose(limits_um(_with_apart(um)), um, rtol=0.05)


def test_noise_of_a_run_includes_timestamps():
    linear = _with_apart(5.0)
    blocks = [replace(block, apart_mm=3 * block.steady_mm) for block in linear.blocks]
    np.testing.assert_allclose(noise_um(linearise(blocks, linear.setups)), 15.0, rtol=0.05)
    np.testing.assert_allclose(scatter_um(linearise(blocks, linear.setups)), 5.0, rtol=0.05)


def test_a_circle_that_was_not_repeated_scatters_as_its_noise_does():
    linear = healthy()
    alone = [replace(block, steady_mm=np.zeros((1, len(block.y_mm)))) for block in linear.blocks]
    noise_um = 1e3 * np.sqrt([block.count * (block.sd_mm[: len(ORDER_OF)] ** 2).sum() / (2 * GRID) for block in alone])
    assert (scatter_um(linearise(alone, linear.setups)) >= noise_um).all()


def test_a_rival_of_size_zero_does_not_stop_the_plan():
    (effect, absent), test = (Backlash(axis=1, width_deg=width) for width in (0.02, 0.0)), _Told()
    assert sigma_between(effect, absent)(test) == 7.0 and test.asked == [effect]


class _Told:
    def __init__(self) -> None:
        self.asked: list[Effect] = []

    @property
    def expected(self) -> _Told:
        return self

    def separation_sigma(self, ones: Sequence[Effect], _: Sequence[Effect]) -> float:
        self.asked += ones
        return 7.0

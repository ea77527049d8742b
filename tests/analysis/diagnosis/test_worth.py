"""The scatter of one run, above which a name is material: what repeated runs show of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.linearisation import Linearisation, linearise
from analysis.diagnosis.observed_run import GRID, ORDER_OF
from analysis.diagnosis.worth import LEAST_MATERIAL_UM, limits_um, scatter_um
from tests.support.diagnosis_cells import healthy

RUNS = 40


def _with_apart(um: float) -> Linearisation:
    """Many runs that differ from their mean by so much, rms of a gauge."""
    rng, linear = np.random.default_rng(3), healthy()
    sd_mm = 1e-3 * um * np.sqrt(2 * GRID / len(ORDER_OF))
    apart = [rng.normal(0.0, sd_mm, (RUNS, len(block.y_mm))) for block in linear.blocks]
    blocks = [replace(block, apart_mm=one) for block, one in zip(linear.blocks, apart, strict=True)]
    return linearise(blocks, linear.setups)


@pytest.mark.parametrize("um", [5.0, 50.0])
def test_the_scatter_of_a_run_is_what_its_repeats_show(um: float) -> None:
    np.testing.assert_allclose(scatter_um(_with_apart(um)), um, rtol=0.05)
    np.testing.assert_allclose(limits_um(_with_apart(um), None), um, rtol=0.05)
    np.testing.assert_allclose(limits_um(_with_apart(um), 7.0), 7.0)


def test_the_limit_of_a_name_is_the_scatter_that_others_make() -> None:
    linear = _with_apart(50.0)
    setup = linear.blocks[0].one.setup
    np.testing.assert_allclose(limits_um(linear, None, {setup: 40.0}), 30.0, rtol=0.08)
    np.testing.assert_allclose(limits_um(linear, None, {setup: 60.0}), LEAST_MATERIAL_UM)
    np.testing.assert_allclose(limits_um(linear, None, {"another": 40.0}), 50.0, rtol=0.05)
    np.testing.assert_allclose(limits_um(linear, 7.0, {setup: 40.0}), 7.0)


def test_few_repeats_that_scatter_unequally_show_less_for_certain() -> None:
    """Three runs each way: 100, 10 and 10 µm from their mean, not 58 µm each."""
    linear = _with_apart(1.0)
    unequal = [replace(block, apart_mm=block.apart_mm[:3] * [[100.0], [10.0], [10.0]]) for block in linear.blocks]
    alike = [replace(block, apart_mm=block.apart_mm[:3] * np.sqrt(10200 / 3)) for block in linear.blocks]
    several = linearise(unequal, linear.setups), linearise(alike, linear.setups)
    np.testing.assert_allclose(*map(scatter_um, several), rtol=0.1)
    # The mean square of 100² and four times 10² is uncertain by 63 %, with six runs.
    np.testing.assert_allclose(limits_um(several[0], None), scatter_um(several[0]) * np.sqrt(1 - 0.61), rtol=0.05)
    np.testing.assert_allclose(limits_um(several[1], None), scatter_um(several[1]), rtol=0.1)


def test_both_directions_of_a_set_up_have_one_limit() -> None:
    found = scatter_um(healthy())
    assert found[0] == pytest.approx(found[1]) and found[0] > 0
    assert (limits_um(healthy(), None) >= LEAST_MATERIAL_UM).all()


def test_a_circle_that_was_not_repeated_scatters_as_its_noise_does() -> None:
    linear = healthy()
    alone = [replace(block, apart_mm=np.zeros((1, len(block.y_mm)))) for block in linear.blocks]
    noise_um = 1e3 * np.sqrt([block.count * (block.sd_mm[: len(ORDER_OF)] ** 2).sum() / (2 * GRID) for block in alone])
    assert (scatter_um(linearise(alone, linear.setups)) >= noise_um).all()

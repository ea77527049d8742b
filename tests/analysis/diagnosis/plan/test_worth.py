"""The scatter of one run, above which a name is material: what repeated runs show of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.evidence.observation import GRID, ORDER_OF
from analysis.diagnosis.fit.responses import (
    LEAST_MATERIAL_UM,
    Linearisation,
    limits_um,
    linearise,
    noise_um,
)
from analysis.robot.kinematics.arm import Array
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
def test_the_scatter_of_a_run_is_what_its_repeats_show(um: float) -> None:
    np.testing.assert_allclose(scatter_um(_with_apart(um)), um, rtol=0.05)
    np.testing.assert_allclose(limits_um(_with_apart(um)), um, rtol=0.05)


def test_the_limit_of_a_name_is_the_scatter_that_others_make() -> None:
    linear = _with_apart(50.0)
    setup = linear.blocks[0].setup
    np.testing.assert_allclose(limits_um(linear, {setup: 40.0}), 30.0, rtol=0.08)
    np.testing.assert_allclose(limits_um(linear, {setup: 60.0}), LEAST_MATERIAL_UM)
    np.testing.assert_allclose(limits_um(linear, {"another": 40.0}), 50.0, rtol=0.05)


@pytest.mark.parametrize(("runs", "ways", "rel"), [(3, 2, 0.3), (2, 2, 0.4), (6, 1, 0.3)])
def test_the_limit_is_lessened_by_what_few_repeats_leave_open(runs: int, ways: int, rel: float) -> None:
    """Runs that lie elsewhere by one random length each: their mean square is as uncertain as that of a few draws."""
    rng, linear = np.random.default_rng(5), healthy()
    lengths = rng.normal(0.0, 1.0, (300, 2, runs, 1)) * (np.arange(2) < ways)[:, None, None]
    squares, less = [], []
    for own in lengths:
        blocks = [_elsewhere(block, length) for block, length in zip(linear.blocks, own, strict=True)]
        shown = linearise(blocks, linear.setups)
        squares.append(scatter_um(shown)[0] ** 2)
        less.append(squares[-1] - limits_um(shown)[0] ** 2)
    assert np.sqrt(np.mean(np.square(less))) == pytest.approx(np.std(squares), rel=rel)


def _elsewhere(block: Block, length: Array) -> Block:
    """Runs that lie elsewhere by lengths (n, 1), each of some 40 µm."""
    steady = (length - length.mean()) * np.full(len(block.y_mm), 0.04)
    return replace(block, steady_mm=steady)


def test_two_runs_leave_no_uncertainty_to_lessen_by() -> None:
    linear = healthy()
    two = [
        replace(block, steady_mm=np.array([[-1.0], [1.0]]) * np.ones(len(block.y_mm))) for block in linear.blocks[:1]
    ]
    alone = linearise(two, linear.setups)
    np.testing.assert_allclose(limits_um(alone), scatter_um(alone))


def test_the_noise_of_a_run_contains_what_stamps_add() -> None:
    linear = _with_apart(5.0)
    blocks = [replace(block, apart_mm=3 * block.steady_mm) for block in linear.blocks]
    np.testing.assert_allclose(noise_um(linearise(blocks, linear.setups)), 15.0, rtol=0.05)
    np.testing.assert_allclose(scatter_um(linearise(blocks, linear.setups)), 5.0, rtol=0.05)


def test_both_directions_of_a_set_up_have_one_limit() -> None:
    found = scatter_um(healthy())
    assert found[0] == pytest.approx(found[1]) and found[0] > 0
    assert (limits_um(healthy()) >= LEAST_MATERIAL_UM).all()


def test_a_circle_that_was_not_repeated_scatters_as_its_noise_does() -> None:
    linear = healthy()
    alone = [replace(block, steady_mm=np.zeros((1, len(block.y_mm)))) for block in linear.blocks]
    noise_um = 1e3 * np.sqrt([block.count * (block.sd_mm[: len(ORDER_OF)] ** 2).sum() / (2 * GRID) for block in alone])
    assert (scatter_um(linearise(alone, linear.setups)) >= noise_um).all()

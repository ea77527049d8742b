import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import Block, blocks_of
from analysis.diagnosis.evidence.observation import ORDER_OF
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.responses import linearise
from analysis.diagnosis.judge.budget import GapMeasure
from analysis.diagnosis.judge.residuals import ResidualPlace, bands_above_noise, places, reversals_of
from rigs.effects import Effect, ReversalSpike
from tests.support.diagnosis_cells import Array, healthy, measured, seen, table_of, white

NOISE = [np.split(white(healthy(), 6), 2)[k] * block.sd_mm for k, block in enumerate(healthy().blocks)]

SCATTER = GapMeasure(healthy()).scatter_mm()


def _shown(effect: Effect) -> list[Array]:
    return [noise + added for noise, added in zip(NOISE, healthy().responses([effect]), strict=True)]


def _places(left_mm: list[Array]) -> tuple[ResidualPlace, ...]:
    return places(healthy().blocks, left_mm, SCATTER)


def _wave(block: Block, cycles: int, size_mm: float) -> Array:
    phi = block.sampling.phi
    return block.entries(size_mm * np.cos(cycles * phi)[:, None] * np.ones(2))


def test_noise_is_no_place():
    assert _places(NOISE) == ()


def test_scatter_between_runs_is_no_place():
    drawn = np.random.default_rng(4).standard_normal(SCATTER[0].shape[1])
    drawn *= 2 / np.sqrt(np.mean(drawn**2))
    shown = [noise + scatter @ drawn for noise, scatter in zip(NOISE, SCATTER, strict=True)]
    assert _places(shown) == ()
    assert places(healthy().blocks, shown, [scatter[:, :0] for scatter in SCATTER])


def test_a_step_at_a_reversal_is_placed_there_with_its_joint():
    found = _places(_shown(ReversalSpike(axis=1, amplitude_deg=0.003, decay_s=0.05)))
    assert {place.direction for place in found} == {"cw", "acw"}
    for block in healthy().blocks:
        own = [phi for phi, joint in reversals_of(block) if joint == 1]
        here = [place for place in found if f"yaw {place.direction}" == block.name and place.sigma > 10]
        assert len(own) == 2 and here
        for place in here:
            assert place.joint == 1 and "reversal" in place.why and place.rms_um > 1
            middle = place.from_deg + ((place.to_deg - place.from_deg) % 360) / 2
            assert min(abs((phi - middle + 180) % 360 - 180) for phi in own) < 8


def test_a_wave_stays_in_its_own_run_and_is_no_reversal_everywhere():
    first = healthy().blocks[0]
    found = _places([NOISE[0] + _wave(first, 1, 0.2), NOISE[1]])
    assert found and {place.direction for place in found} == {"cw"} and {place.part for place in found} == {"distance"}
    assert any(place.why.startswith(("part of", "1 wave")) for place in found)


def test_targets_that_are_off_are_counted_and_the_worst_is_named():
    runs = seen([measured(table_of("radial", None, 1), "radial", "radial")])
    setups, _ = fit_run_setups(runs)
    (block,) = blocks_of(runs, setups)
    left = np.random.default_rng(1).normal(0.0, 1.0, len(block.y_mm)) * block.sd_mm
    (scatter,) = GapMeasure(linearise([block], setups)).scatter_mm()
    assert places([block], [left], [scatter]) == ()
    left[[4, 9]] = [0.05, -0.08]
    (place,) = places([block], [left], [scatter])
    table = block.table
    numbers = getattr(table, "target", np.empty(0))[[4, 9]]
    assert (place.test, place.direction, place.joint) == ("radial", None, None)
    assert (place.from_deg, place.to_deg) == (min(numbers), max(numbers))
    assert place.why.startswith(f"2 of {len(left)} targets") and place.why.endswith(
        f"differ, most at number {numbers[1]}"
    )


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


def test_noise_alone_has_no_band_that_is_reported():
    linear = healthy()
    assert all(bands_above_noise(linear.blocks, white(linear, seed)) == () for seed in range(20))


@pytest.mark.parametrize(("block", "part", "orders"), [(0, 1, (8, 15)), (1, 0, (30, 59)), (1, 1, (3, 7))])
def test_a_bump_exceeds_it_and_is_reported_by_its_band(block, part, orders):
    linear = healthy()
    left = white(linear, 1) + _bump(block, part, *orders, 3.0)
    first = bands_above_noise(linear.blocks, left)[0]
    assert (first.test, first.direction) == ("yaw", ("cw", "acw")[block])
    assert (first.part, first.orders) == (("distance", "angle")[part], orders)
    assert first.ratio > 4 and f"{orders[0]} to {orders[1]} waves" in first.words

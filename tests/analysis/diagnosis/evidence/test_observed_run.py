"""A circle as orders: unitary and back again, sampled at any rows, with the stands before and after the lap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.observation import (
    GRID,
    ORDER_OF,
    ORDER_OF_TREND,
    Sampling,
    bridging,
    curve,
    observe_run,
    rms,
    sampling_of,
)
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.robot.model.predict import model_of
from analysis.runs.tables import CircleTable
from rigs.errors import FileError
from rigs.schema.vocabulary import Direction
from tests.support.diagnosis_cells import RIG, WAYS, Array, table_of

AT = np.arange(GRID) * 2 * np.pi / GRID
HALF = len(ORDER_OF) // 2
AS_THEY_ARE = Sampling(
    np.arange(GRID)[None], np.arange(GRID)[None], np.zeros((1, GRID)), AT, (), np.empty(0), np.empty(0)
)


def _circle(way: Direction) -> CircleTable:
    table = table_of("yaw", way, 7)
    assert isinstance(table, CircleTable)
    return table


def _standing(table: CircleTable, before: int, after: int) -> CircleTable:
    """The run with some rows of standing at its ends."""
    rows = np.concatenate([np.zeros(before, int), np.arange(len(table.t_s)), np.full(after, len(table.t_s) - 1)])
    return replace(table, t_s=0.02 * np.arange(len(rows)), q=table.q[rows], g_mm=table.g_mm[rows])


def test_orders_and_readings_are_each_others_inverse() -> None:
    orders = np.random.default_rng(1).normal(size=len(ORDER_OF))
    readings = curve(orders)
    np.testing.assert_allclose(AS_THEY_ARE.vector(readings), orders, atol=1e-12)
    assert (readings**2).sum() == pytest.approx((orders**2).sum())


@pytest.mark.parametrize(("sign", "half"), [(1, slice(0, HALF)), (-1, slice(HALF, 2 * HALF))])
def test_what_both_gauges_see_alike_is_sum_and_what_they_see_apart_difference(sign: int, half: slice) -> None:
    wave = np.cos(5 * AT + 0.4)
    vector = AS_THEY_ARE.vector(np.stack([wave, sign * wave], axis=1))
    energy = np.zeros(len(ORDER_OF))
    energy[half] = np.where(ORDER_OF[half] == 5, vector[half] ** 2, 0.0)
    np.testing.assert_allclose(vector**2, energy, atol=1e-12)


@pytest.mark.parametrize("way", WAYS)
def test_rows_of_a_lap_in_either_direction_are_laid_over_the_same_grid(way: Direction) -> None:
    one = observe_run(model_of(RIG), _circle(way), "run")
    assert one.sampling and one.name == f"yaw {way}"
    smooth = np.stack([np.sin(3 * one.sampling.phi), np.cos(one.sampling.phi)], axis=1)
    wanted = np.stack([np.sin(3 * AT), np.cos(AT)], axis=1)
    np.testing.assert_allclose(one.sampling.gridded(smooth), wanted, atol=2e-4)


def _lap_from(begin: float, count: int = 700) -> tuple[Sampling, Array]:
    """A lap that begins at an angle (rad), and readings that end it 0.2 mm from where they began, as those of a joint
    that turns by a whole turn in it."""
    phi = begin + np.linspace(0, 2 * np.pi, count, endpoint=False)
    turned = (phi - begin) / (2 * np.pi)
    return sampling_of(phi, (), np.empty(0)), np.stack([0.1 * turned, 0.2 * turned], axis=1)


def test_repeats_of_a_lap_agree_where_it_begins() -> None:
    """Each begins within a row of the others, on another side of a grid angle."""
    step = 2 * np.pi / GRID
    laps = [_lap_from((100 + off) * step) for off in (-0.3, 0.2, 0.4)]
    plain = [one.gridded(values) for one, values in laps]
    apart = np.ptp(plain, axis=0).max()
    assert apart > 0.1
    bridged = bridging([one for one, _ in laps])
    same = [one.gridded(values) for one, (_, values) in zip(bridged, laps, strict=True)]
    assert np.ptp(same, axis=0).max() < apart / 50
    # Elsewhere nothing has changed.
    kept = np.abs(np.arange(GRID) - 100) > 4
    np.testing.assert_array_equal(np.array(same)[:, kept], np.array(plain)[:, kept])


@pytest.mark.parametrize(("count", "lost"), [(700, 3), (36, 0), (45, 0)])
@pytest.mark.parametrize("way", [1, -1])
def test_repeats_agree_also_where_rows_are_lost_or_few(count: int, lost: int, way: int) -> None:
    laps = []
    for k, off in enumerate((-0.3, 0.2, 0.4)):
        begin = (100 + off) * 2 * np.pi / GRID
        turned = np.arange(count - (lost if k == 1 else 0)) / count
        laps.append((sampling_of(begin + way * 2 * np.pi * turned, (), np.empty(0)), np.outer(turned, [0.1, 0.2])))
    same = [one.gridded(values) for one, (_, values) in zip(bridging([one for one, _ in laps]), laps, strict=True)]
    # They begin 0.7 steps of the grid apart, over which they rise by 0.3 µm.
    assert np.ptp(same, axis=0).max() < 0.002
    assert max(np.ptp(values) for _, values in laps) > 0.19


def test_laps_that_begin_at_the_seam_of_the_grid_are_bridged_too() -> None:
    step = 2 * np.pi / GRID
    laps = [_lap_from(off * step) for off in (GRID - 0.4, 0.3)]
    same = [one.gridded(values) for one, (_, values) in zip(bridging([one for one, _ in laps]), laps, strict=True)]
    assert np.ptp(same, axis=0).max() < 0.002


def test_laps_that_begin_far_from_each_other_stay_as_they_are() -> None:
    laps = [_lap_from(begin)[0] for begin in (0.0, 1.0)]
    assert bridging(laps) == laps


def test_stands_at_both_ends_are_found_and_their_readings_averaged() -> None:
    one = observe_run(model_of(RIG), _standing(_circle("cw"), 60, 40), "run")
    assert one.sampling and len(one.sampling.stands) == 2
    first, last = one.sampling.stands
    assert len(first) == pytest.approx(60, abs=2) and len(last) == pytest.approx(40, abs=2)
    lap = len(one.sampling.phi)  # of two laps
    np.testing.assert_allclose(one.sampling.stand_share, np.array([len(first), len(last)]) * GRID * 2 / lap)
    values = np.zeros((len(one.rows), 2))
    values[first] = [1.0, 3.0]
    entries = one.sampling.vector(values)
    stands = entries[2 * HALF : 2 * HALF + 4]  # what follows is the trend of the laps
    np.testing.assert_allclose(stands, np.array([4.0, 2.0, 0.0, 0.0]) / np.sqrt(2), atol=1e-12)
    assert len(one.sampling.without_stands().vector(values)) == len(entries) - 4


def test_the_error_of_a_lap_is_the_same_however_long_the_robot_stands_beside_it() -> None:
    table = _circle("cw")
    wave = 0.1 * np.sin(5 * np.linspace(0, 2 * np.pi, len(table.t_s)))
    table = replace(table, g_mm=table.g_mm + wave[:, None])
    errors = []
    for stands in (0, 500):
        placed, left = fit_run_setups([observe_run(model_of(RIG), _standing(table, stands, stands), "run")])
        errors.append((rms(left), *placed["yaw"].ball))
    assert errors[0] == pytest.approx(errors[1], rel=0.01) and errors[0][0] == pytest.approx(0.071, rel=0.05)


@pytest.mark.parametrize("ends", [(60, 0), (0, 40), (2, 60)])
def test_one_stand_alone_does_not_count(ends: tuple[int, int]) -> None:
    before, after = ends
    table = _circle("cw")
    # The program itself begins and ends in motion: rows of the ramps are left out.
    inner = slice(20, -20)
    table = replace(table, t_s=table.t_s[inner], q=table.q[inner], g_mm=table.g_mm[inner])
    one = observe_run(model_of(RIG), _standing(table, before, after), "run")
    assert one.sampling and one.sampling.stands == ()


@pytest.mark.parametrize("step_mm", [0.0005, 0.010])
def test_the_step_of_the_coarser_gauge_is_kept(step_mm: float) -> None:
    table = _circle("cw")
    g_mm = np.stack([np.round(table.g_mm[:, 0] / step_mm) * step_mm, np.round(table.g_mm[:, 1] / 1e-4) * 1e-4], axis=1)
    one = observe_run(model_of(RIG), replace(table, g_mm=g_mm), "run")
    assert one.step_mm == pytest.approx(step_mm, rel=0.01)


def test_targets_have_no_sampling() -> None:
    one = observe_run(model_of(RIG), table_of("radial", None, 7), "run")
    assert one.sampling is None and one.name == "radial"


def test_half_a_circle_is_refused() -> None:
    table = _circle("cw")
    half = slice(0, len(table.t_s) // 5)
    with pytest.raises(FileError, match="no data"):
        observe_run(model_of(RIG), replace(table, t_s=table.t_s[half], q=table.q[half], g_mm=table.g_mm[half]), "run")


def test_a_gauge_that_drifts_shows_from_lap_to_lap_and_a_form_of_the_circle_does_not() -> None:
    run = observe_run(model_of(RIG), _circle("cw"), "run")
    assert run.sampling and len(run.sampling.trend) == 2
    phi, rows = run.sampling.phi, len(run.rows)
    trend = slice(-len(ORDER_OF_TREND), None)
    lap = np.zeros((rows, 2))
    lap[: len(phi), 0] = 1 + np.cos(phi) + np.sin(3 * phi)
    assert np.abs(run.sampling.vector(lap)[trend]).max() < 1e-3
    drifts = np.zeros((rows, 2))
    drifts[: len(phi), 0] = np.arange(len(phi)) / len(phi)  # half a mm from the middle of a lap to that of the next
    shown = run.sampling.vector(drifts)[trend]
    assert abs(shown[0]) == pytest.approx(0.5 / np.sqrt(2) * np.sqrt(GRID / 2), rel=0.01)
    assert np.abs(np.delete(shown, [0, len(shown) // 2])).max() < 0.02 * abs(shown[0])

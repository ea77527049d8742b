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
    in_content_order,
    observe,
    observe_run,
    sampling_of,
    smooth_path,
)
from analysis.robot.predict import model_of
from analysis.runs.tables import CircleTable, PoseTable
from rigs.errors import FileError
from rigs.schema.vocabulary import Direction
from tests.support.diagnosis_cells import RIG, WAYS, table_of

AT = np.arange(GRID) * 2 * np.pi / GRID
HALF = len(ORDER_OF) // 2
AS_THEY_ARE = Sampling(
    np.arange(GRID)[None], np.arange(GRID)[None], np.zeros((1, GRID)), AT, (), np.empty(0), np.empty(0)
)


def _circle(way: Direction) -> CircleTable:
    return table_of("yaw", way, 7)


def _standing(table: CircleTable, before: int, after: int) -> CircleTable:
    rows = np.concatenate([np.zeros(before, int), np.arange(len(table.t_s)), np.full(after, len(table.t_s) - 1)])
    return replace(table, t_s=0.02 * np.arange(len(rows)), q=table.q[rows], g_mm=table.g_mm[rows])


def test_orders_and_readings_are_each_others_inverse():
    orders = np.random.default_rng(1).normal(size=len(ORDER_OF))
    readings = curve(orders)
    np.testing.assert_allclose(AS_THEY_ARE.vector(readings), orders, atol=1e-12)
    assert (readings**2).sum() == pytest.approx((orders**2).sum())


@pytest.mark.parametrize(("sign", "half"), [(1, slice(0, HALF)), (-1, slice(HALF, 2 * HALF))])
def test_sum_and_difference_separate_common_and_opposite_errors_of_gauges(sign, half):
    wave = np.cos(5 * AT + 0.4)
    vector = AS_THEY_ARE.vector(np.stack([wave, sign * wave], axis=1))
    energy = np.zeros(len(ORDER_OF))
    energy[half] = np.where(ORDER_OF[half] == 5, vector[half] ** 2, 0.0)
    np.testing.assert_allclose(vector**2, energy, atol=1e-12)


@pytest.mark.parametrize("way", WAYS)
def test_rows_of_a_lap_in_either_direction_are_laid_over_the_same_grid(way):
    one = observe_run(model_of(RIG), _circle(way), "run")
    assert one.sampling and one.name == f"yaw {way}"
    smooth = np.stack([np.sin(3 * one.sampling.phi), np.cos(one.sampling.phi)], axis=1)
    wanted = np.stack([np.sin(3 * AT), np.cos(AT)], axis=1)
    np.testing.assert_allclose(one.sampling.gridded(smooth), wanted, atol=2e-4)


@pytest.mark.parametrize(("count", "lost"), [(700, 3), (36, 0), (45, 0)])
@pytest.mark.parametrize("way", [1, -1])
def test_repeats_agree_also_with_lost_or_few_rows(count, lost, way):
    laps = []
    for k, off in enumerate((-0.3, 0.2, 0.4)):
        begin = (100 + off) * 2 * np.pi / GRID
        turned = np.arange(count - (lost if k == 1 else 0)) / count
        laps.append((sampling_of(begin + way * 2 * np.pi * turned, (), np.empty(0)), np.outer(turned, [0.1, 0.2])))
    same = [one.gridded(values) for one, (_, values) in zip(bridging([one for one, _ in laps]), laps, strict=True)]
    # They begin 0.7 steps of the grid apart, over which they rise by 0.3 µm.
    assert np.ptp(same, axis=0).max() < 0.002
    assert max(np.ptp(values) for _, values in laps) > 0.19


def test_stands_at_both_ends_are_found_and_their_readings_averaged():
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


def test_half_a_circle_is_refused():
    table = _circle("cw")
    half = slice(0, len(table.t_s) // 5)
    with pytest.raises(FileError, match="no data"):
        observe_run(model_of(RIG), replace(table, t_s=table.t_s[half], q=table.q[half], g_mm=table.g_mm[half]), "run")


def test_a_gauge_that_drifts_shows_from_lap_to_lap_and_a_form_of_the_circle_does_not():
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


STEP_DEG = 0.01


def _table() -> CircleTable:
    return table_of("yaw", "cw", None)


def test_a_rounded_path_comes_back():
    table = _table()
    rounded = replace(table, q=np.radians(STEP_DEG * np.round(np.degrees(table.q) / STEP_DEG)))
    one = observe(model_of(RIG), rounded, "run")
    found = smooth_path(one)
    inner = one.rows
    off = np.degrees(found.path.q - table.q)[inner]
    assert np.sqrt((off**2).mean()) < STEP_DEG / 8
    assert np.sqrt((np.degrees(one.path.q - table.q)[inner] ** 2).mean()) > STEP_DEG / 4


def test_targets_are_left_alone():
    one = observe(model_of(RIG), table_of("radial", None, 1), "run")
    found = smooth_path(one)
    assert found is one


def test_observation_of_poses_is_independent_of_the_row_order():
    rng = np.random.default_rng(4)
    q, xyz_mm, order = rng.uniform(-1, 1, (60, 6)), rng.uniform(-900, 900, (60, 3)), rng.permutation(60)
    tables = PoseTable(q, xyz_mm, None), PoseTable(q[order], xyz_mm[order], None)
    here, there = (in_content_order(observe(model_of(RIG), table, "poses")) for table in tables)
    np.testing.assert_array_equal(here.values, there.values)

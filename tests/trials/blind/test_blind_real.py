"""The real world: its noise has the levels it says, its arms are as said, its oracle sees what can be seen."""

from __future__ import annotations

import filecmp
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.nightly import cases
from tests.worlds import stranger
from tests.worlds.stranger.faults import SIGNED, Fault
from tests.worlds.stranger.names import everything
from tests.worlds.stranger.real import noise as noises
from tests.worlds.stranger.real.arm import drawn_fault, healthy_arm, plant
from tests.worlds.stranger.real.cases import LAPS
from tests.worlds.stranger.real.oracle import Oracle, slow_covariance
from tests.worlds.stranger.sight import REPEATS, sight_of


def levels(rng: np.random.Generator, targets: tuple[int, ...] = (1, 2)) -> noises.Levels:
    return noises.drawn_levels(rng, 8, 2, list(targets))


def test_every_level_is_within_the_table():
    apart = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        own, cell = levels(rng), noises.drawn_cell(rng, "one", 50.0)
        assert np.all((own.white_mm >= 2e-4) & (own.white_mm <= 3e-3))
        assert np.all((own.slow_mm >= 5e-4) & (own.slow_mm <= 2e-2))
        assert own.white_mm.max() / own.white_mm.min() <= 4
        apart.append(own.white_mm.max() / own.white_mm.min())
        assert own.slow_s == 0 or 0.1 <= own.slow_s <= 5
        assert 3e-4 <= own.joints_deg <= 5e-3 and 1e-3 <= own.ball_mm <= 2e-2
        assert 10 * np.linalg.norm(own.drift_mm_min) <= 2e-2
        assert all(0.003 <= stop <= 0.060 for stop in own.stops_mm.values())
        assert cell.outliers <= 0.005 and cell.jitter_s <= 0.02
    assert np.median(apart) > 1.3


@pytest.mark.parametrize("tau_s", [0.0, 0.3, 2.0])
def test_slow_noise_has_the_covariance_of_the_oracle(tau_s):
    made = noises.slow(60.0, tau_s, 400, np.random.default_rng(1))
    for lag_s in (0.0, 0.2, 1.0):
        k = round(lag_s / noises.SLOW_STEP_S)
        found = float(np.mean(made[: len(made) // 2 : 50] * made[k : len(made) // 2 + k : 50]))
        assert found == pytest.approx(float(slow_covariance(np.array([lag_s, 60.0]), tau_s)[0]), abs=0.08)


def test_stops_scatter_per_target_with_heavy_tails_on_request():
    rng = np.random.default_rng(3)
    own, target = levels(rng), np.repeat([1, 2], 20_000)
    off = np.linalg.norm(noises.stop_scatter(own, 0.0, target, rng), axis=1)
    for number in (1, 2):
        assert np.sqrt(np.mean(off[target == number] ** 2)) == pytest.approx(own.stops_mm[number], rel=0.03)
    heavy = noises.stop_scatter(own, 2.2, target, rng)[target == 1, 0]
    core = own.stops_mm[1] / np.sqrt(3)
    assert np.mean(np.abs(heavy) > 5 * core) > 0.01


@pytest.mark.parametrize("bursts", [False, True])
def test_outliers_have_the_stated_number_and_size(bursts):
    cell = noises.CellNoise(50.0, 1e-3, 0.0, 0.005, bursts, 0.1, 1e-3, 1e-4)
    found = noises.wild(cell, np.array([1e-3, 2e-3]), 200_000, np.random.default_rng(4))
    assert np.mean(found != 0) == pytest.approx(0.005, rel=0.15)
    size = np.abs(found[found[:, 1] != 0, 1]) / 2e-3
    # Two bursts may fall on one reading and cancel.
    assert np.mean((size >= 10) & (size <= 100)) > 0.97


def test_a_healthy_arm_has_everything_at_its_healthy_width():
    names = {Fault(effect, keys, 0.0).name for effect, keys in everything()}
    arms = [healthy_arm(1.0, np.random.default_rng(seed)) for seed in range(60)]
    assert all({fault.name for fault in arm} == names for arm in arms)
    squares: dict[str, float] = {}
    for fault in (fault for arm in arms for fault in arm):
        squares[fault.effect] = squares.get(fault.effect, 0.0) + (fault.size / fault.healthy) ** 2 / len(arms)
        assert fault.size >= 0 or fault.effect in SIGNED
    for effect, square in squares.items():
        seats = sum(other == effect for other, _ in everything())
        assert square / seats == pytest.approx(1.0, abs=0.6), effect


def test_planted_and_healthy_wave_of_one_order_are_one_wave():
    planted, own, other = (
        Fault("transmission_error", {"axis": 2}, size, {"order": order, "phase_deg": phase})
        for size, order, phase in ((0.1, 16.0, 350.0), (0.005, 16.0, 100.0), (0.005, 7.0, 20.0))
    )
    whole, rest = plant([own, other], planted)
    assert rest == [other] and whole.shape["order"] == 16.0

    def at(angle: float, *waves: Fault) -> float:
        return sum(one.size * np.sin(16 * angle + np.radians(one.shape["phase_deg"])) for one in waves)

    for angle in np.linspace(0, 2, 9).tolist():
        assert at(angle, whole) == pytest.approx(at(angle, planted, own), abs=1e-12)


def test_faults_are_5_to_100_times_healthy_and_large_ones_8():
    for kind, least in (("one", 5), ("one_large", 8), ("off_grid", 5)):
        drawn = [drawn_fault(np.random.default_rng(seed), kind) for seed in range(100)]
        times = [abs(fault.size / fault.healthy) for fault in drawn if fault]
        assert len(times) > 80 and min(times) >= 0.999 * least and 80 < max(times) <= 100.1


@cache
def oracle_of(white: float) -> Oracle:
    """UR10e in a cell whose levels are in the middle of the table, gauges `white` times as noisy."""
    rng = np.random.default_rng(9)
    sight = sight_of("ur10e")
    numbers = tuple({int(k) for k in sight.targets["target"]})
    own = noises.Levels(
        np.full((8, 2), white * 1e-3), np.full(8, white * 3e-3), 0.5, 0.8, 1e-3, 4e-3, np.zeros(3),
        dict.fromkeys(numbers, 0.015),
    )  # fmt: skip
    return Oracle(sight, noises.drawn_cell(rng, "one", 50.0), dict.fromkeys(("yaw", "roll", "radial"), own), 2, LAPS)


def test_oracle_knows_invisible_and_indistinguishable_faults():
    """diagnosis-recipe.md, "Twins and the unseen": on a UR10e."""
    scale = Fault("gauge_scale", {"gauge": "g1"}, 0.02)
    (seen,) = oracle_of(1.0).look([scale], 1.0)
    assert "gauge_inclination g1" in seen.twins
    (geometry,) = oracle_of(1.0).look([Fault("link_geometry", {"axis": 1, "field": "d"}, 20.0)], 1.0)
    assert geometry.sigma < 1
    (turned,) = oracle_of(1.0).look([Fault("joint_offset", {"axis": 1}, 2.0)], 1.0)
    assert turned.sigma < 1
    (play,) = oracle_of(1.0).look([Fault("backlash", {"axis": 2}, 0.2)], 1.0)
    assert play.testable and not play.twins


def test_the_oracle_sees_less_in_more_noise_and_in_more_background():
    fault = Fault("servo_lag", {"axis": 3}, 0.01)
    (quiet,), (noisy,) = oracle_of(1.0).look([fault], 1.0), oracle_of(6.0).look([fault], 1.0)
    (crowded,) = oracle_of(1.0).look([fault], 3.0)
    assert quiet.sigma > 1.2 * noisy.sigma and quiet.sigma > crowded.sigma


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, int], tuple[Path, dict[str, Any]]]:
    """A case of a kind and seed, and its truth: each generated once."""

    @cache
    def case(kind: str, seed: int) -> tuple[Path, dict[str, Any]]:
        root = tmp_path_factory.mktemp(kind)
        path = stranger.generate_real(kind, seed, root, root / "truth")
        return path, json.loads((root / "truth" / f"{path.name}.json").read_text(encoding="utf-8"))

    return case


@pytest.mark.parametrize("kind", cases(stranger.REAL_KINDS, ("two", "foreign_third")))
def test_cases_have_their_kind(kind, made):
    case, truth = made(kind, 3)
    count = {"healthy": 0, "foreign_large": 0, "two": 2, "three": 3}.get(kind, 1)
    assert len(truth["hidden"]) == count
    assert len(truth["outside"]) == kind.startswith("foreign")
    for one in truth["hidden"]:
        assert one["times"] >= (8 if kind == "one_large" else 5) - 1e-6
        moved = one["worth_um"]
        assert any(um >= 0.8 * max(3.0, truth["scatter_um"][test]) for test, um in moved.items())
        assert one["name"] in one["class"]
    lines = [line.split(",") for line in (case / "runs.csv").read_text(encoding="utf-8").split()[1:]]
    uses = [(test, way, use) for _, test, way, use, _ in lines]
    for test in ("yaw", "roll"):
        assert all(uses.count((test, way, "train")) == REPEATS for way in ("acw", "cw"))
    assert uses.count(("repeatability", "", "train")) == 1 and 1 <= uses.count(("radial", "", "train")) <= 2
    assert sum(use == "held_out" for *_, use in uses) == sum(use == "unseen" for *_, use in uses) == 2


def test_a_case_is_fixed_by_kind_and_seed(made, tmp_path):
    first, _ = made("one", 3)
    second = stranger.generate_real("one", 3, tmp_path / "b", tmp_path / "t")
    names = sorted(path.name for path in first.iterdir() if path.is_file())
    assert filecmp.cmpfiles(first, second, names, shallow=False)[0] == names

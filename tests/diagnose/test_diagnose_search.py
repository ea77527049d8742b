"""Gains and scores beside a Gaussian log density by brute force, on a small made-up dictionary."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from cells import Array

from analysis.diagnose.candidates import Candidate, Shape
from analysis.diagnose.evidence import WIDE, Dictionary
from analysis.diagnose.search import DEPTH, Search, Table
from rigs.effects import Backlash, BallForm, Compliance, JointOffset, healthy_size

N, LEVEL = 60, 0.1
WAVES = tuple(BallForm(lobes=3, amplitude_mm=0.001, phase_deg=phase) for phase in (0, 90))
PLAY = Backlash(axis=1, width_deg=0.01)
SHAPES = (
    Shape(PLAY.model_copy(update={"transit": 1.0}), PLAY, 0.5),
    Shape(PLAY.model_copy(update={"preload": 1.0}), PLAY, 0.2),
)
OFFSETS = [Candidate(f"joint_offset {k}", (JointOffset(axis=k, offset_deg=0.02),)) for k in (1, 2, 3, 4, 5, 6)]
SOFT = Candidate("compliance 2", (Compliance(axis=2, deg_per_Nm=5e-5),))
WAVE = Candidate("ball_form", WAVES)
GAP = Candidate("backlash 1", (PLAY,), SHAPES)
CANDIDATES = [*OFFSETS, SOFT, WAVE, GAP]
SOFT_AT, WAVE_AT, GAP_AT = 6, 7, 8


def _dictionary(y: Array) -> Dictionary:
    """Random columns, each as long as 10 sigmas of a healthy size."""
    columns = sum(len(one.effects) + len(one.shapes) for one in CANDIDATES)
    made = Dictionary.__new__(Dictionary)
    made.candidates, made.y, made.main, made.shape = CANDIDATES, y, [], []
    made.G = np.random.default_rng(8).normal(0.0, 10 / np.sqrt(N), (N, columns))
    begin = 0
    for one in CANDIDATES:
        ends = begin + len(one.effects), begin + len(one.effects) + len(one.shapes)
        made.main.append(np.arange(begin, ends[0]))
        made.shape.append(np.arange(*ends))
        begin = ends[1]
    made.sigma = np.array([np.linalg.norm(made.G[:, cols], axis=0).max() for cols in made.main])
    made.own = np.ones(len(CANDIDATES))
    return made


@cache
def _search(*planted: tuple[int, float], seed: int = 3) -> Search:
    """Noise with some columns (number, healthy sizes) in it."""
    G = _dictionary(np.zeros(N)).G
    y = np.random.default_rng(seed).normal(size=N) + sum(size * G[:, k] for k, size in planted)
    return Search(_dictionary(np.asarray(y)))


def _log_density(y: Array, C: Array) -> float:
    """Of a Gaussian, the constant left out."""
    return float(-0.5 * (y @ np.linalg.solve(C, y) + np.linalg.slogdet(C)[1]))


def _dense(search: Search, level: float = LEVEL) -> Array:
    """Covariance of noise and background: every main column with its healthy share."""
    share = search.dictionary.background(level)
    mains = np.concatenate(search.dictionary.main)
    B = search.dictionary.G[:, mains] * share[mains]
    return np.eye(N) + B @ B.T


def _prior(search: Search, k: int, C: Array) -> Array:
    """What a named effect may add: a main column anything up to 35 sigma or its own size, a shape a share of it."""
    dictionary = search.dictionary
    X, S = dictionary.G[:, dictionary.main[k]], dictionary.G[:, dictionary.shape[k]]
    A, b = X.T @ np.linalg.solve(C, X), X.T @ np.linalg.solve(C, search.y)
    size = np.linalg.solve(A, b)
    wide = (WIDE**2 + size @ b / len(b)) * X @ np.linalg.inv(A) @ X.T
    shares = np.array([shape.share for shape in CANDIDATES[k].shapes]) * np.linalg.norm(size)
    return np.asarray(wide + (S * shares**2) @ S.T)


def test_the_null_is_the_density_of_noise_and_background() -> None:
    search = _search((2, 0.5))
    quiet, rich = (search.table(level).null for level in (LEVEL, 0.8))
    assert quiet == pytest.approx(_log_density(search.y, _dense(search)))
    # A richer background is less likely beforehand, by 6 for each doubling from 0.1 on.
    assert rich == pytest.approx(_log_density(search.y, _dense(search, 0.8)) - 18)


@pytest.mark.parametrize("k", [2, SOFT_AT, WAVE_AT, GAP_AT])
def test_one_name_gains_what_the_density_gains(k: int) -> None:
    search = _search((int(_dictionary(np.zeros(N)).main[k][0]), 0.8))
    table, C = search.table(LEVEL), _dense(search)
    gained = _log_density(search.y, C + _prior(search, k, C)) - _log_density(search.y, C)
    assert table.gains(())[k] == pytest.approx(gained, abs=1e-5)
    assert table.score((k,)) == pytest.approx(table.null + gained - search.price, abs=1e-5)


def test_several_names_score_together_and_gain_beside_each_other() -> None:
    search = _search((2, 0.8), (int(_dictionary(np.zeros(N)).main[WAVE_AT][1]), -0.9))
    table, C = search.table(LEVEL), _dense(search)
    chosen = (2, GAP_AT, WAVE_AT)
    whole = C + sum(_prior(search, k, C) for k in chosen)
    assert table.score(chosen) == pytest.approx(_log_density(search.y, whole) - 3 * search.price, abs=1e-5)
    beside = C + _prior(search, 2, C)
    gained = _log_density(search.y, beside + _prior(search, WAVE_AT, beside)) - _log_density(search.y, beside)
    assert table.gains((2,))[WAVE_AT] == pytest.approx(gained, abs=1e-4)


def test_beside_free_columns_a_name_gains_what_they_leave() -> None:
    """As if the columns themselves had nothing of what is free."""
    search = _search((2, 0.8), (5, 1.5))
    free = np.random.default_rng(1).normal(size=(N, 3))
    basis, _ = np.linalg.qr(free)
    bare = _dictionary(search.y - basis @ (basis.T @ search.y))
    bare.G = bare.G - basis @ (basis.T @ bare.G)
    bare.sigma = search.dictionary.sigma
    beside, expected = search.beside(bare.y, free).table(LEVEL), Search(bare).table(LEVEL)
    np.testing.assert_allclose(beside.gains(()), expected.gains(()), atol=1e-8)
    np.testing.assert_allclose(beside.gains((GAP_AT,)), expected.gains((GAP_AT,)), atol=1e-8)
    assert beside.score((2, WAVE_AT)) == pytest.approx(expected.score((2, WAVE_AT)))


def test_what_is_free_already_is_no_name() -> None:
    search = _search((2, 5.0))
    free = search.dictionary.G[:, [2]]
    gains = search.beside(search.y, free).table(LEVEL).gains(())
    assert gains[2] == -np.inf and search.table(LEVEL).gains(())[2] > 100


def test_noise_draws_no_name() -> None:
    for seed in range(20):
        assert _search(seed=100 + seed).at(LEVEL).chosen == ()


def test_what_was_planted_is_chosen_with_its_sizes() -> None:
    mains = _dictionary(np.zeros(N)).main
    search = _search((4, -2.0), (int(mains[WAVE_AT][0]), 1.5), (int(mains[WAVE_AT][1]), 1.5))
    found = search.best((0.05, LEVEL))
    assert set(found.chosen) == {4, WAVE_AT} and found.score > search.table(found.level).null
    sizes = dict(zip(found.chosen, found.sizes, strict=True))
    assert sizes[4][0] == pytest.approx(-2.0, abs=0.4)
    offset, wave = (search.start(k, sizes[k]) for k in (4, WAVE_AT))
    assert isinstance(offset, JointOffset) and (offset.axis, offset.offset_deg) == (5, pytest.approx(-0.04, rel=0.2))
    assert isinstance(wave, BallForm)
    assert wave.amplitude_mm == pytest.approx(1.5 * np.sqrt(2) * healthy_size(wave), rel=0.2)
    assert wave.phase_deg == pytest.approx(45, abs=12)


def test_a_width_below_zero_is_no_name() -> None:
    main = int(_dictionary(np.zeros(N)).main[SOFT_AT][0])
    assert _search((main, -2.0)).table(LEVEL).gains(())[SOFT_AT] == -np.inf
    assert _search((main, 2.0)).at(LEVEL).chosen == (SOFT_AT,)


def test_a_name_is_given_once_and_only_where_it_can_be_seen() -> None:
    search = _search((4, 2.0))
    assert search.table(LEVEL).gains((4,))[4] == -np.inf
    dictionary = _dictionary(search.y)
    dictionary.own[4] = 0.0
    dictionary.sigma[2] = 0.1
    blind = Search(dictionary)
    assert set(blind.not_testable) == {"joint_offset 5", "joint_offset 3"}
    assert 4 not in Table(blind, LEVEL).explained().chosen
    assert blind.beside(search.y, dictionary.G[:, :1]).not_testable == blind.not_testable


def test_no_more_names_than_a_person_believes() -> None:
    search = _search(*((k, 3.0) for k in range(6)))
    assert len(search.at(LEVEL).chosen) == DEPTH


def test_a_wrong_first_name_is_dropped_when_two_do_better() -> None:
    """The third column is nearly the sum of the first two: alone it explains most, but both together all."""
    dictionary = _dictionary(np.zeros(N))
    rng = np.random.default_rng(4)
    dictionary.G[:, 2] = (dictionary.G[:, 0] + dictionary.G[:, 1]) / np.sqrt(2) + rng.normal(0.0, 0.3, N)
    y = 4.0 * dictionary.G[:, 0] + 2.0 * dictionary.G[:, 1] + rng.normal(size=N)
    search = Search(dictionary, y)
    table = search.table(LEVEL)
    assert int(np.argmax(table.gains(()))) == 2
    assert set(table.explained().chosen) == {0, 1}

"""An error without a name is described by what it depends on; named effects and noise leave little to a free form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.fit.background import CoefficientPosterior, FittedTerms
from analysis.diagnosis.fit.free_forms import FREE_PRICE, best_free_form, free_forms_of
from analysis.diagnosis.fit.responses import Linearisation, Response
from rigs.effects import Backlash, JointOffset
from tests.support.diagnosis_cells import Array, healthy, no_background, white

_SURE = 7.0
"""Log evidence that any name must win (its price and the number of names)."""


def _beside(
    linear: Linearisation, left: Array, known: Array | None = None, more: Array | None = None
) -> CoefficientPosterior:
    """Return the residual (N,) after noise and set-ups; known: columns (N, q) of free size; more: of standard
    deviation 1.
    """
    T = np.empty((len(left), 0)) if known is None else known
    q = T.shape[1]
    return no_background(linear, more).posterior(
        FittedTerms(left, (Response(T),), 1e-6 * np.eye(q), np.zeros(q), np.full(q, np.nan))
    )


def _rates(block: Block) -> Array:
    return np.asarray(np.gradient(block.path.q, block.path.t_s, axis=0), dtype=float)


def _slips(block: Block) -> Array:
    q = block.path.q[:, 1]
    return np.where(q > q.min() + 0.4 * np.ptp(q), 2e-5, 0.0)[:, None]


ERRORS: dict[str, tuple[int, Callable[[Block], Array]]] = {
    "an error of axis 2 that goes with its angle": (2, _slips),
    "an error of axis 4 that goes with the speed, whichever way it turns": (
        4,
        lambda block: 3e-3 * np.abs(_rates(block)[:, [3]]),
    ),
    "an error of axis 1 that goes with the way axis 3 turns": (
        1,
        lambda block: 1e-5 * np.sign(_rates(block)[:, [2]]),
    ),
}


@pytest.mark.parametrize("words", ERRORS)
def test_an_error_that_no_effect_describes_is_reported_by_what_it_goes_with(words: str) -> None:
    linear = healthy()
    axis, off = ERRORS[words]
    added = linear.without_set_up(linear.by_joint(axis, off))[:, 0]
    left = white(linear, 1) + added * 30 / np.linalg.norm(added)
    found = best_free_form(tuple(free_forms_of(linear)), _beside(linear, left))
    assert found.words == words and found.gain > 4 * _SURE
    beside = best_free_form(tuple(free_forms_of(linear)), _beside(linear, left, added[:, None]))
    assert beside.gain < _SURE  # what a name does is not done again


def test_beside_names_and_a_background_a_form_gains_what_the_density_gains() -> None:
    """By brute force: a form of any size on top of noise, background and names of any size, over none."""
    linear = healthy()
    other = linear.columns([JointOffset(axis=axis, offset_deg=2e-3) for axis in (2, 3, 4, 5)])
    free = linear.columns([Backlash(axis=axis, width_deg=1e-3) for axis in (1, 2)])
    C = np.eye(len(free)) + other @ other.T + 100 * linear.U @ linear.U.T + 1e6 * free @ free.T
    words = "an error of axis 4 that goes with the speed, whichever way it turns"
    added = linear.by_joint(4, ERRORS[words][1])[:, 0]
    y = np.random.default_rng(5).normal(size=len(free)) + added * 200 / np.linalg.norm(added)
    found = best_free_form(tuple(free_forms_of(linear)), _beside(linear, y, free, other))
    form = next(form for form in free_forms_of(linear) if form.words == found.words).columns
    densities = [_log_density(y, C + s * form @ form.T) for s in 4.0 ** np.arange(-4, 11)]
    assert (
        found.gain == pytest.approx(max(densities) - _log_density(y, C) - FREE_PRICE, rel=1e-2) and found.gain > _SURE
    )


def _log_density(y: Array, C: Array) -> float:
    """Of a Gaussian, the constant left out."""
    return float(-0.5 * (y @ np.linalg.solve(C, y) + np.linalg.slogdet(C)[1]))


def test_what_changes_with_time_is_reported_by_the_gauge() -> None:
    linear = healthy()

    def settles(block: Block) -> Array:
        t = block.path.t_s
        return np.where(t > 0.3 * t[-1], 1e-3, 0.0)[:, None]

    added = linear.without_set_up(linear.by_gauge((0.0, 1.0), settles))[:, 0]
    left = white(linear, 2) + added * 30 / np.linalg.norm(added)
    found = best_free_form(tuple(free_forms_of(linear)), _beside(linear, left))
    assert "time in gauge 2" in found.words and found.gain > 4 * _SURE


def test_a_dent_is_attributed_to_the_ball() -> None:
    linear = healthy()

    def dented(block: Block) -> Array:
        lap = np.linspace(0, 2 * np.pi, len(block.path.t_s))
        lap = lap if block.name.endswith("acw") else -lap
        return -1e-3 * np.exp(-0.5 * ((lap % (2 * np.pi) - 2.0) / 0.1) ** 2)[:, None]

    added = linear.without_set_up(linear.by_gauge((1.0, 1.0), dented))[:, 0]
    left = white(linear, 3) + added * 30 / np.linalg.norm(added)
    found = best_free_form(tuple(free_forms_of(linear)), _beside(linear, left))
    assert "the ball" in found.words and found.gain > 4 * _SURE


def test_noise_alone_has_no_form() -> None:
    linear = healthy()
    gains = [
        best_free_form(tuple(free_forms_of(linear)), _beside(linear, white(linear, seed))).gain for seed in range(10)
    ]
    assert max(gains) < _SURE

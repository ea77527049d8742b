from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.fit.background import CoefficientPosterior, FittedTerms
from analysis.diagnosis.fit.responses import Linearisation, Response
from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.unknown import UnknownCauses
from rigs.effects import Backlash, JointOffset, TransmissionError
from tests.support.diagnosis_cells import Array, healthy, healthy_columns, holding, no_background, white

_SURE = 7.0
"""Log evidence that any name must win (its price and the number of names)."""


@pytest.fixture(scope="module")
def causes():
    return UnknownCauses.in_runs(healthy())


def _beside(
    linear: Linearisation, left: Array, known: Array | None = None, more: Array | None = None
) -> CoefficientPosterior:
    """Posterior for a residual (N,) after noise and set-ups; known: columns (N, q) of free size; more: of standard
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
    "an error of axis 2 over its angle": (2, _slips),
    "an error of axis 4 over its speed": (4, lambda block: 3e-3 * np.abs(_rates(block)[:, [3]])),
    "an error of axis 1 that depends on the directions of motion": (
        1,
        lambda block: 1e-5 * np.sign(_rates(block)[:, [2]]),
    ),
}


@pytest.mark.parametrize("kind", ERRORS)
def test_error_of_a_joint_is_found_by_its_quantity(causes, kind):
    linear = healthy()
    axis, error = ERRORS[kind]
    added = linear.without_set_up(linear.by_joint(axis, error))[:, 0]
    left = white(linear, 1) + added * 30 / np.linalg.norm(added)
    found = causes.likeliest(_beside(linear, left))
    assert found.kind == kind and found.gain > 4 * _SURE
    beside = causes.likeliest(_beside(linear, left, added[:, None]))
    assert beside.gain < _SURE  # the named effect explains it


def test_gain_is_the_ratio_of_densities(causes):
    """Densities with and without a cause of any amplitude, next to noise, background and names, by brute force."""
    linear = healthy()
    other = linear.columns([JointOffset(axis=axis, offset_deg=2e-3) for axis in (2, 3, 4, 5)])
    free = linear.columns([Backlash(axis=axis, width_deg=1e-3) for axis in (1, 2)])
    C = np.eye(len(free)) + other @ other.T + 100 * linear.U @ linear.U.T + 1e6 * free @ free.T
    added = linear.by_joint(4, ERRORS["an error of axis 4 over its speed"][1])[:, 0]
    y = np.random.default_rng(5).normal(size=len(free)) + added * 200 / np.linalg.norm(added)
    gains = causes.gains(_beside(linear, y, free, other))["an error of axis 4 over its speed"]
    columns = causes.responses["an error of axis 4 over its speed"].columns
    densities = [_log_density(y, C + s * columns @ columns.T) for s in 4.0 ** np.arange(-3, 10)]
    assert gains.max() == pytest.approx(max(densities) - _log_density(y, C), rel=1e-2) and gains.max() > _SURE


def _log_density(y: Array, C: Array) -> float:
    """Log density of a Gaussian without its constant."""
    root = np.linalg.cholesky(C)
    white = scipy.linalg.solve_triangular(root, y, lower=True)
    return float(-0.5 * white @ white - np.log(np.diag(root)).sum())


def _settles(block: Block) -> Array:
    t = block.path.t_s
    return np.where(t > 0.3 * t[-1], 1e-3, 0.0)[:, None]


def _dented(block: Block) -> Array:
    lap = np.linspace(0, 2 * np.pi, len(block.path.t_s))
    lap = lap if block.name.endswith("acw") else -lap
    return -1e-3 * np.exp(-0.5 * ((lap % (2 * np.pi) - 2.0) / 0.1) ** 2)[:, None]


@pytest.mark.parametrize(
    ("error", "shares", "kind"),
    [
        (_settles, (0.0, 1.0), "a change of the gauges over time"),
        (_dented, (1.0, 1.0), "an error of the ball that varies with the position of the link"),
    ],
)
def test_error_of_the_gauges_is_found_by_its_quantity(causes, error, shares, kind):
    linear = healthy()
    added = linear.without_set_up(linear.by_gauge(shares, error))[:, 0]
    found = causes.likeliest(_beside(linear, white(linear, 2) + added * 30 / np.linalg.norm(added)))
    assert found.kind == kind and found.gain > 4 * _SURE


def test_noise_shows_no_unknown_cause(causes):
    found = [causes.likeliest(_beside(healthy(), white(healthy(), seed))) for seed in range(10)]
    assert all(cause is not None and cause.gain < 0 for cause in found)


def test_unknown_cause_replaces_a_name_that_imitates_it():
    linear = healthy()
    slip = linear.without_set_up(linear.by_joint(2, _slips))[:, 0]
    readings = white(linear, 5) + 3000 * slip / np.linalg.norm(slip)
    selection = Selection(holding(linear, readings), healthy_columns())
    state = selection.initial_state((TransmissionError(axis=2, order=8, amplitude_deg=0.01),))
    compared = selection.against_unknown(state)
    assert compared.effects == () and "an error of axis 2 over its angle" in {cause.kind for cause in compared.unknown}
    assert selection.evidence(compared) > selection.evidence(state)


def test_no_unknown_cause_is_added_to_noise():
    selection = Selection(holding(healthy(), white(healthy(), 5)), healthy_columns())
    state = selection.initial_state(())
    assert selection.against_unknown(state) is state

from functools import cache

import numpy as np
import pytest

from analysis.diagnosis.fit.background import CoefficientPosterior, FittedTerms, background_of
from analysis.diagnosis.fit.candidates import HEALTHY, LARGEST_FAULT, Form, fault_sizes
from analysis.diagnosis.fit.responses import Response
from rigs.effects import Backlash, JointOffset, TransmissionError
from tests.support.diagnosis_cells import Array, columns_of

N = 60
RNG = np.random.default_rng(4)
X = RNG.normal(size=(N, 9))
BAND = np.arange(N) // 30
WEIGHT = np.where(BAND == 0, 1.0, 0.4)
WEIGHT[40:] *= RNG.uniform(0.3, 1.0, 20)
GEAR = tuple(TransmissionError(axis=1, order=3, amplitude_deg=0.002, phase_deg=phase) for phase in (0.0, 90.0))
FORMS = (
    Form("joint_offset 2", (JointOffset(axis=2, offset_deg=0.01),), 1.0, columns=(0,)),
    Form("joint_offset 3", (JointOffset(axis=3, offset_deg=0.01),), 1.0, columns=(1,)),
    Form("transmission_error 1", GEAR, 1.0, columns=(2, 3)),
)
VARIANCE = np.array([1.0, 0.0, 0.5, 0.5, 100.0, 100.0, 1.0, 1.0, 2.0])
EXPECTED = np.array([0.8, 0.0, -0.3, 0.4, 0.0, 0.0, 0.0, 0.2, 0.0])
Y = X @ np.array([4.0, 0.0, -3.0, 2.0, 5.0, -5.0, 1.0, 0.0, 0.5]) + RNG.normal(size=N)
T = RNG.normal(size=(N, 2))
PRECISION, MEAN = np.diag([0.1, 0.02]), np.array([0.5, -1.0])
BACKGROUND = background_of(columns_of(X, BAND, FORMS), WEIGHT, VARIANCE, EXPECTED)
AWAY = Y - X @ EXPECTED - T @ MEAN


def _covariance(variance: Array) -> Array:
    dense: Array = np.diag(1 / WEIGHT) + X @ np.diag(variance) @ X.T
    return dense


C = _covariance(VARIANCE)


@cache
def _posterior() -> CoefficientPosterior:
    return BACKGROUND.posterior(FittedTerms(Y + T @ np.zeros(2), (Response(T),), PRECISION, MEAN, np.full(2, np.nan)))


def _log_density(y: Array, covariance: Array) -> float:
    return float(-0.5 * (y @ np.linalg.solve(covariance, y) + np.linalg.slogdet(covariance)[1]))


def _with_known(variance: Array) -> Array:
    return _covariance(variance) + T @ np.linalg.inv(PRECISION) @ T.T


def test_products_and_determinant_are_those_of_the_dense_covariance():
    both, wanted = np.column_stack([T, Y]), np.column_stack([T, Y]).T @ np.linalg.solve(C, np.column_stack([T, Y]))
    marginal = BACKGROUND.marginal(both)
    np.testing.assert_allclose(marginal.products(marginal), wanted, atol=1e-9)
    assert BACKGROUND.logdet == pytest.approx(np.linalg.slogdet(C)[1])
    dense = np.diag(VARIANCE) - np.diag(VARIANCE) @ X.T @ np.linalg.solve(C, X @ np.diag(VARIANCE))
    np.testing.assert_allclose(BACKGROUND.covariance, dense, atol=1e-9)
    alone = background_of(BACKGROUND.columns, WEIGHT, VARIANCE, EXPECTED)  # of which nobody has asked the covariance
    np.testing.assert_allclose(alone.variances, np.diag(dense), atol=1e-9)


@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_a_response_has_the_same_products_in_every_background(scale):
    one, columns = Response(T), BACKGROUND.columns
    for weight in (np.ones(N), WEIGHT, np.where(BAND == 0, scale, 1.0)):
        background = background_of(columns, weight, VARIANCE, EXPECTED)
        products, absorbed = background.marginal_terms(FittedTerms(Y, (one,), PRECISION, MEAN, np.full(2, np.nan)))
        wanted = background.marginal(np.column_stack([T, Y - X @ EXPECTED]))
        np.testing.assert_allclose(products, wanted.products(wanted), atol=1e-9)
        np.testing.assert_allclose(absorbed, wanted.absorbed, atol=1e-9)


def test_means_and_covariances_are_those_of_the_joint_normal_law():
    prior = np.zeros((11, 11))
    prior[:9, :9], prior[9:, 9:] = np.diag(VARIANCE), np.linalg.inv(PRECISION)
    columns = np.concatenate([X, T], axis=1)
    gain = prior @ columns.T @ np.linalg.inv(np.diag(1 / WEIGHT) + columns @ prior @ columns.T)
    mean, covariance = gain @ AWAY, prior - gain @ columns @ prior
    found = _posterior()
    np.testing.assert_allclose(found.mean, EXPECTED + mean[:9], atol=1e-8)
    np.testing.assert_allclose(found.term_means, MEAN + mean[9:], atol=1e-8)
    everywhere = np.array([[0, 3], [8, 1], [4, 4]])
    among = [covariance[np.ix_(some, some)] for some in everywhere]
    np.testing.assert_allclose(found.covariance_among(everywhere), among, atol=1e-8)
    np.testing.assert_allclose(found.variance, np.diag(covariance)[:9], atol=1e-8)
    np.testing.assert_allclose(found.covariance_times(EXPECTED), covariance[:9, :9] @ EXPECTED, atol=1e-8)
    np.testing.assert_allclose(found.term_covariance, covariance[9:, 9:], atol=1e-8)
    np.testing.assert_allclose(found.residual, Y - X @ found.mean - T @ found.term_means, atol=1e-9)
    np.testing.assert_allclose(found.healthy_share, X[:, :4] @ found.mean[:4], atol=1e-9)
    np.testing.assert_allclose(found.residual_at_prior, Y - X @ EXPECTED, atol=1e-9)


@pytest.mark.parametrize("alike", [0.0, 0.999], ids=["own", "nearly a column"])
def test_the_energy_that_uncertain_coefficients_hide_is_that_of_the_joint_normal_law(alike):
    terms = alike * X[:, 4:6] + (1 - alike) * T
    prior = np.zeros((11, 11))
    prior[:9, :9], prior[9:, 9:] = np.diag(VARIANCE), np.linalg.inv(PRECISION)
    columns = np.concatenate([X, terms], axis=1)
    across = prior @ columns.T
    joint = prior - across @ np.linalg.solve(np.diag(1 / WEIGHT) + columns @ across, across.T)
    wanted = np.bincount(BAND, np.einsum("ni,ij,nj->n", columns, joint, columns))
    found = BACKGROUND.posterior(FittedTerms(Y, (Response(terms),), PRECISION, MEAN, np.full(2, np.nan))).spent
    np.testing.assert_allclose(found, wanted, rtol=1e-6)
    np.testing.assert_allclose(BACKGROUND.spent, np.bincount(BAND, ((X @ BACKGROUND.covariance) * X).sum(axis=1)))


@pytest.mark.parametrize("k", [0, 2])
def test_a_cavitys_gain_is_a_difference_of_log_evidence(k):
    cols = list(FORMS[k].columns)
    gains = _posterior().gains(FORMS, HEALTHY)

    def evidence(each: float, expected: float = 0.0) -> float:
        variance = VARIANCE.copy()
        variance[cols] = each
        return _log_density(AWAY + (1 - expected) * X[:, cols] @ EXPECTED[cols], _with_known(variance))

    sizes = fault_sizes(1.0)
    dense = np.array([evidence(size**2 / len(cols)) for size in sizes])
    now = evidence(float(VARIANCE[cols[0]]), expected=1.0)
    assert gains.fault[k] == pytest.approx(dense.max() + np.log(np.exp(dense - dense.max()).mean()) - now, abs=1e-6)
    assert gains.healthy[k] == pytest.approx(evidence(1 / len(cols)) - now, abs=1e-6)


def test_the_evidence_is_the_density_of_the_readings():
    known = FittedTerms(Y, (Response(T),), PRECISION, MEAN, np.full(2, np.nan))
    assert BACKGROUND.evidence(known) == pytest.approx(_log_density(AWAY, _with_known(VARIANCE)))


@pytest.mark.parametrize("k", [0, 2])
def test_the_size_that_readings_show_is_that_without_a_prior(k):
    cols = list(FORMS[k].columns)
    variance = VARIANCE.copy()
    variance[cols] = 0.0
    weighted = np.linalg.solve(_with_known(variance), X[:, cols])
    shown = np.linalg.solve(weighted.T @ X[:, cols], weighted.T @ (AWAY + X[:, cols] @ EXPECTED[cols]))
    assert _posterior().gains(FORMS, HEALTHY).size[k] == pytest.approx(np.linalg.norm(shown), rel=1e-6)


def test_sigma_follows_the_readings_without_a_healthy_prior():
    variance = VARIANCE.copy()
    variance[0] = 0.0
    wanted = np.sqrt(X[:, 0] @ np.linalg.solve(_with_known(variance), X[:, 0]))
    assert _posterior().gains(FORMS, HEALTHY).sigma[0] == pytest.approx(wanted, rel=1e-6)


def test_a_size_that_cannot_be_negative_is_no_fault_the_wrong_way():
    play = Form("backlash 2", (Backlash(axis=2, width_deg=0.01),), 1.0, columns=(0,))
    background = background_of(columns_of(X, BAND, (play,)), WEIGHT, VARIANCE)
    for sign, is_seen in ((1.0, True), (-1.0, False)):
        posterior = background.posterior(
            FittedTerms(sign * 10 * X[:, 0], (), np.empty((0, 0)), np.empty(0), np.empty(0))
        )
        assert np.isfinite(posterior.gains((play,), HEALTHY).fault[0]) == is_seen


def test_the_cavity_of_columns_beside_all_else_is_that_of_the_dense_covariance():
    pair = np.random.default_rng(9).normal(size=(N, 2))
    precision, eta = _posterior().cavity(pair)
    dense = _with_known(VARIANCE)
    np.testing.assert_allclose(precision, pair.T @ np.linalg.solve(dense, pair), rtol=1e-8)
    np.testing.assert_allclose(eta, pair.T @ np.linalg.solve(dense, AWAY), rtol=1e-8)


@pytest.mark.parametrize("k", [0, 2])
def test_posterior_with_a_fault_equals_that_of_a_new_factor(k):
    variance, expected = VARIANCE.copy(), EXPECTED.copy()
    cols = list(FORMS[k].columns)
    variance[cols], expected[cols] = LARGEST_FAULT**2, 0.0
    terms = FittedTerms(Y, (Response(T),), PRECISION, MEAN, np.full(2, np.nan))
    wanted = background_of(BACKGROUND.columns, WEIGHT, variance, expected).posterior(terms)
    found = _posterior().as_coefficients().with_fault(FORMS[k])
    np.testing.assert_allclose(found.mean, wanted.mean, atol=1e-7)
    everywhere = np.array([[0, 3], [8, 2], [4, 6]])
    np.testing.assert_allclose(found.covariance_among(everywhere), wanted.covariance_among(everywhere), atol=1e-7)
    np.testing.assert_allclose(found.gains(FORMS, HEALTHY).size, wanted.gains(FORMS, HEALTHY).size, rtol=1e-6)

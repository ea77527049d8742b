"""The linear model against direct formulas, numeric integration and models that are fitted again."""

from __future__ import annotations

import doctest
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from analysis.inference import levels, linear_model
from analysis.inference.levels import LevelPrior, at_levels, fit_levels, noise_of_residual, slope_by_logs
from analysis.inference.linear_model import (
    Cavity,
    LinearModel,
    Posterior,
    PosteriorByCoefficients,
    PosteriorByReadings,
    Prior,
    cavity,
    condition,
    left_out,
    log_bayes_factor,
    zero_mean,
)

NOISE = np.array([0.5, 2.0])


def drawn(readings: int, coefficients: int) -> tuple[LinearModel, Prior]:
    """A model with two bands of readings; the last coefficient is held at its mean."""
    rng = np.random.default_rng(1)
    X = rng.standard_normal((readings, coefficients))
    variance = rng.uniform(0.1, 3.0, coefficients)
    variance[-1] = 0.0
    band = np.arange(readings) % 2
    return linear_model.linear_model(X, rng.standard_normal(readings), band), Prior(
        rng.standard_normal(len(variance)), variance
    )


SIDES = pytest.mark.parametrize(
    ("shape", "side"),
    [((12, 5), PosteriorByCoefficients), ((5, 12), PosteriorByReadings)],
    ids=["coefficients", "readings"],
)


@pytest.mark.parametrize("module", [linear_model, levels], ids=lambda module: module.__name__)
def test_examples_of_the_module_run(module: ModuleType):
    with np.printoptions(legacy="1.25"):
        result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0


def covariance_of_readings(model: LinearModel, prior: Prior) -> np.ndarray:
    return np.diag(NOISE[model.band]) + (model.X * prior.variance) @ model.X.T


@SIDES
def test_posterior_is_that_of_the_joint_normal_distribution(shape: tuple[int, int], side: type[Posterior]):
    model, prior = drawn(*shape)
    posterior = condition(model, prior, NOISE)
    assert isinstance(posterior, side)
    C = covariance_of_readings(model, prior)
    gain = prior.variance[:, None] * model.X.T @ np.linalg.inv(C)
    assert posterior.log_evidence == pytest.approx(multivariate_normal(model.X @ prior.mean, C).logpdf(model.y))
    np.testing.assert_allclose(posterior.mean, prior.mean + gain @ (model.y - model.X @ prior.mean))
    expected = np.diag(prior.variance) - gain @ model.X * prior.variance
    np.testing.assert_allclose(posterior.covariance(), expected, atol=1e-12)
    columns = np.array([[0, 3], [1, 4]])
    blocks = expected[columns[:, :, None], columns[:, None, :]]
    np.testing.assert_allclose(posterior.covariance_among(columns), blocks, atol=1e-12)
    mean, covariance = posterior.predict(model.X[:2])
    np.testing.assert_allclose(mean, model.X[:2] @ posterior.mean)
    np.testing.assert_allclose(covariance, model.X[:2] @ expected @ model.X[:2].T, atol=1e-12)


@SIDES
def test_information_and_score_are_products_with_the_inverse_covariance(shape: tuple[int, int], side: type[Posterior]):
    model, prior = drawn(*shape)
    posterior, inverse = condition(model, prior, NOISE), np.linalg.inv(covariance_of_readings(model, prior))
    every = np.arange(shape[1])
    np.testing.assert_allclose(posterior.information(every), model.X.T @ inverse @ model.X, atol=1e-12)
    np.testing.assert_allclose(posterior.score(), model.X.T @ inverse @ (model.y - model.X @ prior.mean), atol=1e-12)
    np.testing.assert_allclose(posterior.precision_among(np.arange(shape[0])), inverse, atol=1e-12)


@SIDES
def test_gradient_agrees_with_differences_of_the_evidence(shape: tuple[int, int], side: type[Posterior]):
    model, prior = drawn(*shape)
    gradient, step = condition(model, prior, NOISE).gradient(), 1e-5

    def slope(up: Posterior, down: Posterior) -> float:
        return (up.log_evidence - down.log_evidence) / (2 * step)

    for band in range(2):
        times = np.exp(step * np.eye(2)[band])
        differences = slope(condition(model, prior, NOISE * times), condition(model, prior, NOISE / times))
        assert gradient.by_log_noise[band] == pytest.approx(differences, rel=1e-6, abs=1e-8)
    for column in range(shape[1]):
        times = np.exp(step * np.eye(shape[1])[column])
        up, down = (replace(prior, variance=prior.variance * each) for each in (times, 1 / times))
        differences = slope(condition(model, up, NOISE), condition(model, down, NOISE))
        assert gradient.by_log_variance[column] == pytest.approx(differences, rel=1e-6, abs=1e-8)


@SIDES
def test_readings_left_out_are_predicted_as_by_a_fit_without_them(shape: tuple[int, int], side: type[Posterior]):
    model, prior = drawn(*shape)
    rows = np.array([0, 3])
    keep = np.setdiff1d(np.arange(shape[0]), rows)
    others = condition(linear_model.linear_model(model.X[keep], model.y[keep], model.band[keep]), prior, NOISE)
    mean, covariance = others.predict(model.X[rows])
    predicted = left_out(condition(model, prior, NOISE), rows)
    np.testing.assert_allclose(predicted.error, model.y[rows] - mean, atol=1e-12)
    np.testing.assert_allclose(predicted.covariance, covariance + np.diag(NOISE[model.band[rows]]), atol=1e-12)
    assert predicted.chi_square == pytest.approx(
        predicted.error @ np.linalg.inv(predicted.covariance) @ predicted.error
    )


@SIDES
def test_cavity_predicts_the_evidence_with_another_prior(shape: tuple[int, int], side: type[Posterior]):
    model, prior = drawn(*shape)
    columns = np.array([0, 2])
    likelihood = cavity(condition(model, prior, NOISE), columns)
    evidence = []
    for variance in (0.0, 4.0):
        changed, mean = prior.variance.copy(), prior.mean.copy()
        changed[columns], mean[columns] = variance, 0.0
        evidence.append(condition(model, Prior(mean, changed), NOISE).log_evidence)
    gain = log_bayes_factor(likelihood, np.array([4.0]))
    assert gain[0] == pytest.approx(evidence[1] - evidence[0])


@SIDES
def test_cavity_of_a_held_coefficient_is_that_of_a_free_one(shape: tuple[int, int], side: type[Posterior]):
    model, prior = drawn(*shape)
    last = np.array([shape[1] - 1])
    freed = prior.variance.copy()
    freed[last] = 1.5
    held, free = (cavity(condition(model, each, NOISE), last) for each in (prior, replace(prior, variance=freed)))
    np.testing.assert_allclose(held.precision, free.precision)
    np.testing.assert_allclose(held.shift, free.shift)


def test_bayes_factor_agrees_with_numeric_integration():
    likelihood, variance = Cavity(np.array([[3.0]]), np.array([2.0])), 0.7

    def density(b: float) -> float:
        return float(np.exp(2.0 * b - 1.5 * b**2) * norm(0, np.sqrt(variance)).pdf(b))

    assert np.exp(log_bayes_factor(likelihood, np.array([variance]))[0]) == pytest.approx(quad(density, -9, 9)[0])


def test_levels_maximise_evidence_and_prior():
    model, prior = drawn(60, 20)
    group = np.arange(20) % 2
    group[5] = -1
    of_levels = LevelPrior(np.full(4, -0.3), np.full(4, 0.8), np.full(4, -5.0), np.full(4, 5.0))
    fitted = fit_levels(model, prior, group, of_levels, np.zeros(4))
    slope = slope_by_logs(fitted.posterior, group, 2) - (fitted.logs - of_levels.median) / of_levels.width**2
    assert np.abs(slope).max() < 1e-2
    assert fitted.posterior.prior.variance[5] == prior.variance[5]


def test_slope_by_levels_includes_prior_means_that_grow_with_them():
    model, prior = drawn(12, 5)
    group, logs, step = np.array([0, 0, 1, 1, -1]), np.array([0.2, -0.1, 0.4, 0.3]), 1e-5
    slope = slope_by_logs(at_levels(model, prior, group, logs), group, 2)
    for k, change in enumerate(step * np.eye(4)):
        up, down = (at_levels(model, prior, group, each).log_evidence for each in (logs + change, logs - change))
        assert slope[k] == pytest.approx((up - down) / (2 * step), rel=1e-6)


@pytest.mark.parametrize("shape", [(60, 4), (60, 61)])
def test_noise_of_the_residual_converges_to_the_likeliest_noise(shape: tuple[int, int]):
    model, _ = drawn(*shape)
    prior, noise = zero_mean(np.full(shape[1], 0.01)), np.ones(2)
    for _ in range(300):
        noise = noise_of_residual(condition(model, prior, noise))
    assert np.abs(condition(model, prior, noise).gradient().by_log_noise).max() < 1e-6


@SIDES
def test_freedom_is_the_share_of_the_inverse_covariance(shape: tuple[int, int], side: type[Posterior]):
    model, prior = drawn(*shape)
    diagonal = np.diag(np.linalg.inv(covariance_of_readings(model, prior)))
    expected = NOISE * np.bincount(model.band, diagonal)
    np.testing.assert_allclose(condition(model, prior, NOISE).freedom(), expected)


def test_free_constant_beside_few_readings_keeps_its_digits_by_coefficients():
    rng = np.random.default_rng(2)
    X = np.concatenate([np.ones((6, 1)), rng.standard_normal((6, 12))], axis=1)
    y = 5.0 + 1e-3 * rng.standard_normal(6)
    variance = np.concatenate([[1e12], np.full(12, 1e-8)])
    model = linear_model.linear_model(X, y, by_readings=False)
    posterior = condition(model, zero_mean(variance), np.array([1e-6]))
    weighted = np.linalg.inv(1e-6 * np.eye(6) + (X[:, 1:] * variance[1:]) @ X[:, 1:].T)
    assert posterior.mean[0] == pytest.approx(np.ones(6) @ weighted @ y / weighted.sum(), rel=1e-12)

import numpy as np

from tests.support.outsider import case, stated

DRAWS, TAIL = 1200, 12
"""Values drawn, from Student's distribution with so many degrees of freedom: its longer tails keep all weights small.
"""


def test_means_and_uncertainties_are_those_of_the_forward_model_called_for_every_value():
    one = stated(case(0))
    rng = np.random.default_rng(0)
    away = rng.standard_normal((DRAWS, len(one.u))) * np.sqrt(TAIL / rng.chisquare(TAIL, DRAWS))[:, None]
    values = one.mean + away @ np.linalg.cholesky(one.covariance).T
    drawn = -0.5 * (TAIL + len(one.u)) * np.log1p((away**2).sum(axis=1) / TAIL)
    weight = np.array([one.log_density(each) for each in values]) - drawn
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    assert 1 / np.sum(weight**2) > DRAWS / 2  # as good as so many independent draws
    mean = weight @ values
    sd = np.sqrt(weight @ (values - mean) ** 2)
    # Four standard errors of so many draws.
    assert np.abs((one.mean - mean) / sd).max() < 0.15
    assert np.abs(one.u / sd - 1).max() < 0.12

import doctest

import numpy as np
import pytest

from analysis.diagnosis.fit import triangles as module
from analysis.diagnosis.fit.triangles import double_triangle, lower_triangle, symmetric


def test_examples_of_the_module_run():
    with np.printoptions(legacy="1.25"):
        result = doctest.testmod(module, extraglobs={"np": np})
    assert result.attempted > 0 and result.failed == 0


@pytest.mark.parametrize("p", [1, 2, 7, 300])
def test_triangles_keep_the_matrix_and_the_sum_of_its_products(p):
    rng = np.random.default_rng(p)
    one, other = (part + part.T for part in rng.standard_normal((2, p, p)))
    np.testing.assert_array_equal(symmetric(lower_triangle(one)), one)
    assert lower_triangle(one) @ double_triangle(other) == pytest.approx(np.sum(one * other))

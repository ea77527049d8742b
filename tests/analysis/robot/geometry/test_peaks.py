import numpy as np
import pytest
from scipy.signal import find_peaks

from analysis.robot.geometry.circle import peaks


@pytest.mark.parametrize("seed", range(20))
def test_peaks_are_those_of_scipy(seed):
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal(size=400))
    for prominence in (0.5, 2.0, 5.0, 100.0):
        np.testing.assert_array_equal(peaks(x, prominence), find_peaks(x, prominence=prominence)[0])


def test_a_flat_top_is_at_its_middle():
    x = np.array([0.0, 1.0, 3.0, 3.0, 3.0, 2.0, 0.0])
    assert peaks(x, 1.5).tolist() == find_peaks(x, prominence=1.5)[0].tolist() == [3]

from typing import get_args

import numpy as np
import pytest

from rigs.schema.modbus import Number
from rigs.signedness import unsigned_readings

TRUE = np.round(0.3 * np.sin(np.linspace(0, 7, 400)), 3)


@pytest.mark.parametrize(("bits", "count"), [(12, 0.002), (16, 0.001), (16, 0.0005), (32, 0.0001)])
def test_a_jump_by_all_counts_is_named(bits, count):
    found = unsigned_readings(np.where(TRUE < 0, TRUE + count * 2.0**bits, TRUE), [count])
    fact, remedy = found
    assert f"2^{bits} " in fact and f"{bits} bits" in remedy
    assert (f"`type: int{bits}`" in remedy) == (f"int{bits}" in get_args(Number))  # the rig file has no int12


def test_sound_readings_outliers_and_one_value_are_not():
    rng = np.random.default_rng(3)
    for _ in range(300):
        values = np.round(rng.normal(rng.uniform(-3, 3), rng.uniform(0.001, 2), 200), int(rng.integers(1, 5)))
        values[7] += rng.uniform(-100, 100)
        assert unsigned_readings(values) is None
    assert unsigned_readings(np.array([65.517])) is None

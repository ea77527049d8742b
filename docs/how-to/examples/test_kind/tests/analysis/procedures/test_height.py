"""Heights of an arm whose second joint is wrong by a known angle, against its closed form."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.procedures.height import HeightTable
from analysis.procedures.shared.test_kind import evaluate
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.tables import columns_of, table_from
from rigs.errors import FileError
from rigs.load import load

RIG, _ = load("ur10e-cell")
Q = np.random.default_rng(1).uniform(-1.0, 1.0, (12, 6))
OFF = np.eye(6)[1] * 1e-3


def test_the_error_is_what_the_joint_lifts_the_tool_by_whatever_the_table_s_height() -> None:
    z = forward(arm_of(RIG.robot), Q + OFF)[:, 2, 3]
    lifted = z - forward(arm_of(RIG.robot), Q)[:, 2, 3]
    result = evaluate(HeightTable(Q, z - 740.0), RIG, 0.0, "heights")
    assert result.figures["height_rms_mm"].value == pytest.approx(lifted.std(), rel=1e-9)
    assert result.figures["height_band_mm"].value == pytest.approx(np.ptp(lifted), rel=1e-9)
    assert 0.0 < result.figures["height_rms_mm"].u < 0.02


def test_the_columns_of_a_file_are_read_again() -> None:
    table = HeightTable(Q, np.linspace(100.0, 900.0, 12))
    again = table_from(columns_of(table), "height", None, "heights")
    assert isinstance(again, HeightTable) and np.allclose(again.q, Q) and np.allclose(again.height_mm, table.height_mm)


def test_too_few_heights_are_refused() -> None:
    with pytest.raises(FileError) as error:
        evaluate(HeightTable(Q[:3], np.ones(3)), RIG, 0.0, "heights")
    assert error.value.code == "height.few"

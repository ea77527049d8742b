"""The steps of a controller's last digit are taken off the reported angles; a smooth path stays as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.observation import observe, smooth_path
from analysis.robot.model.predict import model_of
from analysis.runs.tables import CircleTable
from tests.support.diagnosis_cells import RIG, table_of

STEP_DEG = 0.01
INNER = slice(20, -20)


def _table() -> CircleTable:
    table = table_of("yaw", "cw", None)
    assert isinstance(table, CircleTable)
    return table


def test_a_path_without_rounding_hardly_changes() -> None:
    one = observe(model_of(RIG), _table(), "run")
    found = smooth_path(one)
    assert np.abs(found.path.q - one.path.q)[INNER].max() < np.radians(2e-4)


def test_a_rounded_path_comes_back() -> None:
    table = _table()
    rounded = replace(table, q=np.radians(STEP_DEG * np.round(np.degrees(table.q) / STEP_DEG)))
    one = observe(model_of(RIG), rounded, "run")
    found = smooth_path(one)
    inner = one.rows
    off = np.degrees(found.path.q - table.q)[inner]
    assert np.sqrt((off**2).mean()) < STEP_DEG / 8
    assert np.sqrt((np.degrees(one.path.q - table.q)[inner] ** 2).mean()) > STEP_DEG / 4


def test_uneven_rows_are_weighed_by_their_time() -> None:
    """A fifth of the rows lost at random."""
    table = _table()
    kept = np.random.default_rng(3).random(len(table.t_s)) > 0.2
    part = replace(table, t_s=table.t_s[kept], q=table.q[kept], g_mm=table.g_mm[kept])
    found = smooth_path(observe(model_of(RIG), part, "run"))
    assert np.abs(found.path.q - part.q)[INNER].max() < np.radians(1.5e-3)


def test_targets_are_left_alone() -> None:
    one = observe(model_of(RIG), table_of("radial", None, 1), "run")
    found = smooth_path(one)
    assert found is one

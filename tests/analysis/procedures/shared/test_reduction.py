import dataclasses

import numpy as np
import pytest

from analysis.procedures.shared.lap_curve import PHI, nodes_of, reduced
from analysis.robot.geometry.circle import CircleFrame
from analysis.runs.laps import Laps

ROWS = 20_000
FRAME = CircleFrame(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), 70.0)
AT = np.linspace(0, 2 * np.pi, ROWS, endpoint=False)
PLAYED = 0.5 * np.sin(AT) + 0.02 * np.sin(7 * AT) + np.where(np.sin(AT - 1) > 0, 0.02, -0.02)


def _laps(g_mm: np.ndarray) -> Laps:
    phi, rows = np.concatenate([AT, 2 * np.pi + AT]), np.tile(g_mm, (2, 1))
    rows += np.random.default_rng(1).normal(0, 0.001, rows.shape)
    return Laps("acw", FRAME, phi / 0.35, phi, np.zeros((len(phi), 6)), rows, 18.0, 18.0, count=2)


def test_bursts_that_hide_from_their_neighbours_leave_no_bias():
    """Five in a row are most of a median of seven; 0.5 % of 40 µm to one side would be 0.2 µm of the level."""
    laps, rng = _laps(np.stack([PLAYED, PLAYED], axis=1)), np.random.default_rng(2)
    starts = rng.random(len(laps.phi)) < 0.001
    hit = np.maximum.reduce([np.roll(starts, k) for k in range(5)])
    wild = laps.g_mm + (hit * np.exp(rng.uniform(np.log(0.01), np.log(0.1), len(hit))))[:, None]
    clean, found = reduced(laps), reduced(dataclasses.replace(laps, g_mm=wild))
    assert abs((found.g_mm - clean.g_mm).mean()) < 5e-5
    assert np.abs(found.g_mm - clean.g_mm).max() < 0.01
    assert found.notes[0].startswith("outliers ")
    assert ROWS - found.rows < 1.5 * hit.sum() / 2


def test_a_play_is_no_wild_reading():
    one = np.zeros(2 * ROWS)
    one[1234] = 0.5
    laps = _laps(np.stack([PLAYED, PLAYED], axis=1))
    found = reduced(dataclasses.replace(laps, g_mm=laps.g_mm + one[:, None]))
    assert len(found.notes) == 1 and "1, 1 of 40000" in found.notes[0]
    true = nodes_of(AT, PLAYED)
    smooth = np.abs(np.sin(PHI - 1)) > 0.05
    assert found.g_mm.mean(axis=(0, 2))[np.argsort(found.order)][smooth] == pytest.approx(true[smooth], abs=5e-4)

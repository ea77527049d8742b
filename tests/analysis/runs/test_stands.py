"""Standstills of a recorded motion, also with bad rows of the feedback.

Several readings of one standstill count as one reading, and the figures are those of the standstills.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from analysis.procedures import pose
from analysis.runs.stands import average_standstills, rows_per_standstill, stands_of
from analysis.runs.tables import PoseTable, RepeatabilityTable
from tests.analysis.procedures.checks.test_lost_poses import table
from tests.worlds import planted


def motion(stands: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, angles and readings at 100 Hz: stands of 3 s with a second of motion between two."""
    t_s = np.arange(0, 4 * stands, 0.01)
    share = np.clip(t_s % 4 - 3, 0, 1) + t_s // 4
    noise = np.random.default_rng(3).normal(0, 1e-6, (len(t_s), 6))
    return t_s, np.radians(10 * share)[:, None] * np.arange(1, 7) + noise, np.stack([share, -share], axis=1)


@pytest.mark.parametrize("off_deg", [0.05, 30.0, -0.02])
def test_a_bad_row_in_each_stand_changes_no_stand(off_deg):
    t_s, q, g_mm = motion()
    clean = stands_of(t_s, q, g_mm)
    assert len(clean) == 4
    bad = q.copy()
    bad[150::400, 2] += np.radians(off_deg)
    seen = stands_of(t_s, bad, g_mm)
    assert [(one.begin, one.end) for one in seen] == [(one.begin, one.end) for one in clean]
    for one, other in zip(seen, clean, strict=True):
        np.testing.assert_allclose(one.q, other.q, atol=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_stands_never_share_a_row(seed):
    t_s, q, g_mm = motion()
    rng = np.random.default_rng(seed)
    rows = rng.integers(len(t_s), size=40)
    q[rows, rng.integers(6, size=40)] += np.radians(rng.choice([0.05, 5.0], size=40))
    stands = stands_of(t_s, q, g_mm)
    assert all(one.end <= other.begin for one, other in itertools.pairwise(stands))


def read_thrice(one: PoseTable, noise_mm: float = 0.005) -> PoseTable:
    rng = np.random.default_rng(4)
    rpy = None if one.rpy is None else np.repeat(one.rpy, 3, axis=0)
    xyz = np.repeat(one.xyz_mm, 3, axis=0)
    return PoseTable(np.repeat(one.q, 3, axis=0), xyz + rng.normal(0, noise_mm, xyz.shape), rpy)


def test_three_readings_of_a_stand_are_one_and_no_visits():
    sound = table(40, turned=True)
    found = average_standstills(read_thrice(sound))
    assert rows_per_standstill(read_thrice(sound)).tolist() == [3] * 40
    assert isinstance(found, PoseTable) and found.rpy is not None and sound.rpy is not None
    np.testing.assert_allclose(found.xyz_mm, sound.xyz_mm, atol=0.02)
    np.testing.assert_allclose(found.rpy, sound.rpy, atol=1e-9)
    assert found.rows.tolist() == list(range(1, 121, 3))
    result = pose.evaluate(found, planted.ur10(), 0.02)
    assert not any(name.startswith(("rp_", "repeat")) for name in result.figures)
    assert result.figures["rms_mm"].value == pytest.approx(
        pose.evaluate(sound, planted.ur10(), 0.02).figures["rms_mm"].value, rel=0.02
    )


def test_visits_after_a_move_scatter_like_stands():
    sound = table(12)
    rng = np.random.default_rng(5)
    laps = PoseTable(np.tile(sound.q, (4, 1)), np.tile(sound.xyz_mm, (4, 1)) + rng.normal(0, 0.03, (48, 3)), None)
    assert average_standstills(laps) is laps
    found = average_standstills(read_thrice(laps))
    assert isinstance(found, PoseTable)
    plain, averaged = (pose.evaluate(one, planted.ur10(), 0.02).figures["rp_mm"].value for one in (laps, found))
    assert averaged == pytest.approx(plain, rel=0.1)


def test_a_wild_or_lost_reading_is_not_averaged_with_sound_ones():
    thrice = read_thrice(table(20))
    xyz = thrice.xyz_mm.copy()
    xyz[10], xyz[31] = 0.0, xyz[31] + 600.0
    found = average_standstills(replace(thrice, xyz_mm=xyz))
    result = pose.evaluate(found, planted.ur10(), 0.02, same_rad=1e-9)
    assert "rows 11 and 32" in result.notes[0]
    assert result.figures["rms_mm"].value < 0.2


def test_readings_of_one_approach_are_one_visit():
    rounds, each = 5, 3
    rng = np.random.default_rng(6)
    g_mm = rng.normal(0, 0.02, 2 * rounds)
    q = np.tile([[0.1] * 6], (2 * rounds, 1)) + rng.normal(0, 1e-6, (2 * rounds, 6))
    visits = RepeatabilityTable(
        target=np.ones(2 * rounds, dtype=np.int64),
        approach=np.array(["out", "in"] * rounds),
        round=np.repeat(np.arange(1, rounds + 1), 2),
        t_s=np.zeros(2 * rounds),
        q=q,
        g_mm=g_mm,
    )
    repeated = {
        name: np.repeat(getattr(visits, name), each, axis=0)
        for name in ("target", "approach", "round", "t_s", "q", "g_mm")
    }
    repeated["g_mm"] = repeated["g_mm"] + np.tile([-1e-3, 0.0, 1e-3], 2 * rounds)
    found = average_standstills(RepeatabilityTable(**repeated))
    assert isinstance(found, RepeatabilityTable) and len(found.q) == 10
    np.testing.assert_allclose(found.g_mm, g_mm, atol=1e-12)
    assert found.approach.tolist() == visits.approach.tolist() and found.round.tolist() == visits.round.tolist()

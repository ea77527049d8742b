from dataclasses import replace

import numpy as np
import pytest

from analysis.procedures import pose
from analysis.robot.geometry.driven_programs import radial_program, repeatability_stops, stops
from analysis.runs.align import Aligned
from analysis.runs.stands import average_standstills, rows_per_standstill, stands_of
from analysis.runs.tables import PoseTable, RadialTable, format_of
from rigs.load import load
from rigs.rig import Rig
from tests.analysis.procedures.checks.test_lost_poses import table
from tests.worlds.planted import closed_forms as planted


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


def read_thrice(one: PoseTable) -> PoseTable:
    rng = np.random.default_rng(4)
    rpy = None if one.rpy is None else np.repeat(one.rpy, 3, axis=0)
    xyz = np.repeat(one.xyz_mm, 3, axis=0)
    return PoseTable(np.repeat(one.q, 3, axis=0), xyz + rng.normal(0, 0.005, xyz.shape), rpy)


def test_three_readings_of_a_stand_are_one_and_no_visits():
    sound = table(40, turned=True)
    found = average_standstills(read_thrice(sound))
    assert rows_per_standstill(read_thrice(sound)).tolist() == [3] * 40
    assert found.rpy is not None and sound.rpy is not None
    np.testing.assert_allclose(found.xyz_mm, sound.xyz_mm, atol=0.02)
    np.testing.assert_allclose(found.rpy, sound.rpy, atol=1e-9)
    assert found.rows.tolist() == list(range(1, 121, 3))
    result = pose.evaluate(found, planted.ur10(), 0.02)
    assert not any(name.startswith(("rp_", "repeat")) for name in result.figures)
    assert result.figures["rms_mm"].value == pytest.approx(
        pose.evaluate(sound, planted.ur10(), 0.02).figures["rms_mm"].value, rel=0.02
    )


def test_a_wild_or_lost_reading_is_not_averaged_with_sound_ones():
    thrice = read_thrice(table(20))
    xyz = thrice.xyz_mm.copy()
    xyz[10], xyz[31] = 0.0, xyz[31] + 600.0
    found = average_standstills(replace(thrice, xyz_mm=xyz))
    result = pose.evaluate(found, planted.ur10(), 0.02, same_rad=1e-9)
    assert "rows 11 and 32" in result.notes[0]
    assert result.figures["rms_mm"].value < 0.2


RATE_HZ = 20.0


def rig_of(visits: int = 2) -> Rig:
    rig, _ = load("paper-errors")
    hemisphere = rig.tests.hemisphere.model_copy(update={"step_deg": 60.0, "orientations": 1, "visits": visits})
    return rig.model_copy(update={"tests": rig.tests.model_copy(update={"hemisphere": hemisphere})})


def driven(q: np.ndarray, dwell_s: float = 1.0) -> Aligned:
    t_s, path = stops(q, dwell_s=dwell_s)
    at = np.arange(0.0, t_s[-1], 1 / RATE_HZ)
    joints = np.stack([np.interp(at, t_s, joint) for joint in path.T], axis=1)
    starts = t_s[np.flatnonzero(np.diff(t_s) > 0.9 * dwell_s)]
    number = np.searchsorted(starts, at, side="right") - 1
    g_mm = 1e-3 * number[:, None] + 1e-5 * (np.arange(len(at)) % 2)[:, None]
    return Aligned(at, joints, g_mm, 0.0, np.zeros(len(at)), ())


def table_of(q: np.ndarray, rig: Rig) -> tuple[RadialTable, list[str]]:
    return format_of("radial").recorded(driven(q), rig, None, "run")


@pytest.mark.parametrize("before", [[4], [2, 5]])
@pytest.mark.parametrize("after", [[], [0]])
def test_stands_before_and_after_the_program_are_no_visits(before, after):
    rig = rig_of()
    program = radial_program(rig)
    order = [*before, *range(len(program.q)), *after]
    table, doubts = table_of(program.q[order], rig)
    assert table.target.tolist() == program.target.tolist()
    numbers = np.arange(len(before), len(before) + len(program.q))
    np.testing.assert_allclose(table.g_mm, 1e-3 * numbers, atol=2e-5)
    assert any(said.startswith(f"{len(before) + len(after)} stops outside") for said in doubts), doubts


def test_other_order_is_accepted_with_a_doubt():
    rig = rig_of(visits=1)
    program = radial_program(rig)
    table, doubts = table_of(program.q[::-1], rig)
    assert table.target.tolist() == program.target[::-1].tolist()
    assert any("a different order" in said for said in doubts)


def test_a_repeatability_program_with_a_stand_before_it():
    rig, _ = load("paper-errors")
    q = repeatability_stops(rig)
    table, doubts = format_of("repeatability").recorded(driven(q[[13, *range(len(q))]]), rig, None, "run")
    expected, _ = format_of("repeatability").recorded(driven(q), rig, None, "run")
    assert table.approach.tolist() == expected.approach.tolist()
    assert table.round.tolist() == expected.round.tolist()
    assert any(said.startswith("1 stops outside") for said in doubts)

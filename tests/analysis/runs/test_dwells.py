from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from analysis.robot.geometry.driven_programs import radial_program, repeatability_stops, stops
from analysis.runs.align import Aligned
from analysis.runs.tables import RadialTable, format_of
from rigs.load import load
from rigs.rig import Rig

RATE_HZ = 20.0


def rig_of(visits: int = 2) -> Rig:
    rig, _ = load("paper-errors")
    assert rig.tests.hemisphere is not None
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


def test_a_program_of_two_visits_is_read_twice():
    rig = rig_of()
    program = radial_program(rig)
    table, doubts = table_of(program.q, rig)
    assert table.target.tolist() == program.target.tolist()
    assert len(table.target) == 2 * len(set(table.target.tolist()))
    assert doubts == []


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


def test_one_pass_and_the_way_home_are_one_visit_of_each():
    rig = rig_of()
    program = radial_program(rig)
    once = len(program.q) // 2
    table, _ = table_of(program.q[[*range(once), 0]], rig)
    assert table.target.tolist() == program.target[:once].tolist()


def test_a_missing_stand_costs_no_other():
    rig = rig_of()
    program = radial_program(rig)
    rows = [k for k in range(len(program.q)) if k not in (3, len(program.q) - 2)]
    table, _ = table_of(program.q[rows], rig)
    assert table.target.tolist() == program.target[rows].tolist()


def test_a_stand_held_longer_is_one_visit():
    rig = rig_of(visits=1)
    program = radial_program(rig)
    table, doubts = table_of(np.repeat(program.q, 2, axis=0), rig)
    assert table.target.tolist() == program.target.tolist()
    assert doubts == []


def test_other_order_is_accepted_with_a_doubt():
    rig = rig_of(visits=1)
    program = radial_program(rig)
    table, doubts = table_of(program.q[::-1], rig)
    assert table.target.tolist() == program.target[::-1].tolist()
    assert any("a different order" in said for said in doubts)


def test_wild_readings_of_a_stand_are_counted_and_not_averaged():
    rig = rig_of(visits=1)
    program = radial_program(rig)
    data = driven(program.q)
    g_mm = data.g_mm + np.random.default_rng(1).normal(0, 1e-4, data.g_mm.shape)
    wild = g_mm.copy()
    wild[17] += 1.0
    plain, _ = format_of("radial").recorded(dataclasses.replace(data, g_mm=g_mm), rig, None, "run")
    table, doubts = format_of("radial").recorded(dataclasses.replace(data, g_mm=wild), rig, None, "run")
    assert np.abs(table.g_mm - plain.g_mm).max() < 1e-4
    assert any(doubt.startswith("1 readings") for doubt in doubts)


def test_a_repeatability_program_with_a_stand_before_it():
    rig, _ = load("paper-errors")
    q = repeatability_stops(rig)
    table, doubts = format_of("repeatability").recorded(driven(q[[13, *range(len(q))]]), rig, None, "run")
    expected, _ = format_of("repeatability").recorded(driven(q), rig, None, "run")
    assert table.approach.tolist() == expected.approach.tolist()
    assert table.round.tolist() == expected.round.tolist()
    assert any(said.startswith("1 stops outside") for said in doubts)

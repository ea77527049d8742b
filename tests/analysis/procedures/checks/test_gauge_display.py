from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from analysis import Measured, simulate
from analysis.procedures.checks.gauge_display import display_findings
from analysis.robot.kinematics.arm import Array
from tests.support.made_once import made_once

CELLS = [("paper-fanuc", "yaw", 1), ("ur10e-cell", "roll", 5)]
"""Rig, test and axis with play: laps with and without noise that hides the steps between readings."""


@made_once
def circle(rig: str, test: str, axis: int, folder: Path) -> Measured:
    hidden = folder / f"{rig}-{test}.yaml"
    effect = {"effect": "backlash", "axis": axis, "width_deg": 0.03}
    hidden.write_text(yaml.safe_dump({"effects": [effect], "eccentricity_mm": [0.7, -0.5, 0.1]}))
    return simulate(rig, test, "acw", seed=axis, effects=hidden)


def shown_as(run: Measured, change: Callable[[Array], Array]) -> Measured:
    return replace(run, table=run.table.with_readings(np.apply_along_axis(change, 0, run.table.readings)))


def lost_sign(g: Array) -> Array:
    return np.where((g < 0) & (g > -1), -g, g)


def lost_sign_of_long_travel(g: Array) -> Array:
    return lost_sign(4 * g)


def wrapped(g: Array) -> Array:
    size = 0.6 * np.ptp(g)
    return np.asarray((g - g.min() + 0.3 * size) % size)


def stuck(g: Array) -> Array:
    begin = len(g) // 3
    return np.concatenate([g[:begin], np.full(len(g) // 25, g[begin]), g[begin + len(g) // 25 :]])


FAULTS: dict[str, Callable[[Array], Array]] = {
    "lost sign": lost_sign,
    "lost sign, towards": lambda g: -lost_sign(g),
    "lost sign, over 1 mm": lost_sign_of_long_travel,
    "upper end": lambda g: np.minimum(g, np.quantile(g, 0.85)),
    "lower end": lambda g: np.maximum(g, np.quantile(g, 0.2)),
    "stuck": stuck,
    "wrapped": wrapped,
}
SOUND: dict[str, Callable[[Array], Array]] = {
    "as measured": lambda g: g,
    "zeroed at its smallest reading": lambda g: g - g.min(),
    "display of 0.01 mm": lambda g: g.round(2),
    "display of 0.001 mm, towards": lambda g: -g.round(3),
    "three outliers": lambda g: g + 5.0 * np.isin(np.arange(len(g)), [100, 200, 300]),
}


@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: f"{cell[0]}-{cell[1]}")
@pytest.mark.parametrize("fault", FAULTS)
def test_display_fault_is_found_with_its_rows(fault, cell, tmp_path):
    findings = list(display_findings(shown_as(circle(*cell, tmp_path), FAULTS[fault])))
    assert {finding.columns for finding in findings} == {("g1_mm",), ("g2_mm",)}
    assert all(finding.strength == "decisive" and "rows " in finding.what for finding in findings)


@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: f"{cell[0]}-{cell[1]}")
@pytest.mark.parametrize("times", [2, 3, 5])
def test_repeated_readings_are_a_doubt(times, cell, tmp_path):
    run = shown_as(circle(*cell, tmp_path), lambda g: g[np.arange(len(g)) // times * times])
    assert [finding.strength for finding in display_findings(run)] == ["likely", "likely"]


@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: f"{cell[0]}-{cell[1]}")
@pytest.mark.parametrize("display", SOUND)
def test_sound_display_has_no_finding(display, cell, tmp_path):
    assert list(display_findings(shown_as(circle(*cell, tmp_path), SOUND[display]))) == []

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.trials.unknown.__main__ import counts_text
from tests.trials.unknown.judging import after_repair, first_act_um, judge_name, was_told
from tests.worlds.unknown.cells import draw_cell


@pytest.fixture(scope="module")
def cell():
    """A UR10e with cubic torsion of axis 2."""
    return draw_cell(0)


def named(name: str, value: float, sd: float = 1e-4, **more: Any) -> dict[str, Any]:
    axis = name.partition(" ")[2]
    effect = {"name": name, "parameters": {"size": {"value": value, "sd": sd}}, "posterior": 0.99, "stands": True}
    return effect | ({"axis": int(axis)} if axis.isdigit() else {}) | more


def test_a_name_is_right_by_its_size(cell):
    zero = cell.known.names()["joint_offset 3"]
    assert judge_name(cell, named("joint_offset 3", zero)) == "right"
    assert judge_name(cell, named("joint_offset 3", 10 * zero)) == "wrong"
    assert judge_name(cell, named("joint_offset 3", 10 * zero, sd=abs(4 * zero))) == "right"  # within its uncertainty


def test_a_name_is_related_by_cause_and_axis(cell):
    assert judge_name(cell, named("compliance 2", 1.0)) == "related"
    assert judge_name(cell, named("compliance 3", 1.0)) == "wrong"
    assert judge_name(cell.sound(), named("compliance 2", 1.0)) == "wrong"
    assert judge_name(cell, named("ball_form", 1.0)) == "wrong"


def test_fault_with_a_right_rival_is_ambiguous(cell):
    rivals = [named("compliance 2", 1.0, posterior=0.3)]
    assert judge_name(cell, named("ball_form", 1.0, posterior=0.7, rivals=rivals)) == "ambiguous"
    assert judge_name(cell, named("ball_form", 1.0, posterior=0.97, rivals=rivals)) == "wrong"
    assert judge_name(cell, named("ball_form", 1.0, posterior=0.7, rivals=[named("time_lag", 1.0)])) == "wrong"


def test_only_certain_names_count(cell):
    assert judge_name(cell, named("ball_form", 1.0, stands=False, posterior=0.9)) == ""
    assert judge_name(cell, named("ball_form", 1.0, stands=False, posterior=0.96)) == "wrong"


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        ({"condition": "outside_library"}, True),
        ({"condition": "nothing_unusual", "movements": [{"what": "tool"}]}, True),
        ({"condition": "named", "remainder": {"share": 0.2}}, True),
        ({"condition": "named", "remainder": {"share": 0.01}, "acts": [{"why": "fault"}]}, False),
        ({"condition": "named", "acts": [{"why": "fault"}, {"why": "unexplained"}]}, False),
    ],
)
def test_answers_that_count_as_reported(answer, told):
    assert was_told(answer) == told


def test_repair_removes_only_its_effect(cell, tmp_path):
    rich = replace(cell, known=replace(cell.known, play=np.radians([0.0, 0.2, 0, 0, 0, 0])))
    before, after, calibrated = first_act_um(rich, {"acts": [{"kind": "repair", "effect": "backlash 2"}]}, tmp_path)
    assert after < 0.9 * before
    assert np.isnan(calibrated)
    before, after, _ = first_act_um(rich, {"acts": [{"kind": "repair", "effect": "backlash 3"}]}, tmp_path)
    assert after == before
    assert after_repair(cell, "repair", "compliance 2", {}).cause is None  # the torsion is of that gear


def test_a_wrong_zero_makes_it_worse(cell, tmp_path):
    answer = {
        "acts": [{"kind": "remaster", "effect": "joint_offset 3"}],
        "effects": [named("joint_offset 3", 0.2)],
    }
    before, after, _ = first_act_um(cell, answer, tmp_path)
    assert after > 1.5 * before


def test_cells_are_counted():
    said = {"imitated": False, "wrong_faults": [], "wrong_certain": ["x"], "related": [], "worse": False, "cpu_s": 6.0}
    rows = [
        {"kind": "cubic torsion", "with": said | {"told": seed > 0}, "sound": said | {"told": True, "cpu_s": 3.0}}
        for seed in range(3)
    ]
    assert "| all | 3 | 2 | 0 | 0 | 3 | 0 | 0 | 2.0 | 2.0 |" in counts_text(rows)

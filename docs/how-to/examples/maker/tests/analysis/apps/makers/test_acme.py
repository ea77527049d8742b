"""Programs of Acme: what is corrected in them, what is left, and a zero that a person enters."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from analysis.apps.correct.corrected_program import CorrectedProgram, correct_program
from analysis.apps.correct.stated_points import computed_points
from analysis.apps.emulate.driving import ControllerState
from analysis.apps.makers.motion_plan import demand_of
from analysis.apps.makers.writing import encoded_programs, programs_of
from analysis.apps.programs.planned import plans_of
from rigs.load import load
from tests.worlds.arms.faulty_arm import known

RIG = known(load("ur10e-cell")[0])
(PLAN,) = plans_of(RIG, "repeatability", 3.0)
(TEXT,) = programs_of("acme", [(PLAN, demand_of(PLAN))]).values()


def corrected(directory: Path, text: str) -> CorrectedProgram:
    file = directory / "a.acm"
    with file.open("wb") as opened:
        encoded_programs("acme", {file.name: text})[file.name](opened)
    return correct_program(computed_points(RIG), file)


def test_every_target_is_corrected_and_nothing_but_its_numbers(tmp_path: Path) -> None:
    done = corrected(tmp_path, TEXT)
    assert not done.left and len(done.names) == len(re.findall("^(?:JOINTS|LINE|TURN|VIA|ARC) ", TEXT, re.M))
    before, after = ((tmp_path / "a.acm").read_bytes(), done.files["a.acm"])
    assert before != after and re.sub(rb"[-\d.]+", b"#", before) == re.sub(rb"[-\d.]+", b"#", after)


def test_after_what_is_not_known_nothing_is_corrected(tmp_path: Path) -> None:
    head, moves = TEXT.split("JOINTS", 1)
    done = corrected(tmp_path, f"{head}SHIFT 0,0,1\nJOINTS{moves}")
    assert not done.names and {left.reason for left in done.left} == {"not_understood"}


def test_a_lower_zero_reads_more() -> None:
    entry = {"parameter": "zero of axis 3", "axis": 3, "add": -0.25, "unit": "deg"}
    entered = ControllerState.of_rig(RIG, "acme").entered(
        {"controller": {"name": "acme", "entries": [entry]}}, "a.yaml"
    )
    np.testing.assert_allclose(np.degrees(entered.reads_more), [0, 0, 0.25, 0, 0, 0], atol=1e-12)

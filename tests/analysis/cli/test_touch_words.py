from __future__ import annotations

import json
from pathlib import Path

import pytest

from rigs.arms import load_arm
from tests.support.command_line import ran

CELL = f"name: cell\n{load_arm('franka-fr3').text}tests: {{touch: {{sockets: [A, B]}}}}\n"


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("touch") / "cell.yaml"
    path.write_text(CELL)
    return path


def test_a_plan_of_touches_is_of_touches(cell):
    said = ran("plan", str(cell), "--tests", "touch", COLUMNS="200").stdout
    assert "touch: 3 runs" in said
    assert not [word for word in ("circle", "gauge") if word in said]


@pytest.mark.parametrize(
    "words",
    [
        ("plan", "{}", "--tests", "yaw"),
        ("plan", "{}", "--tests", "radial"),
        ("plan", "{}", "--propose"),
        ("simulate", "{}", "--test", "roll", "-o", "none"),
    ],
)
def test_seven_axes_are_refused_as_seven_axes(cell, words):
    done = ran(*(word.format(cell) for word in words))
    assert done.returncode == 3 and "7 axes" in done.stderr


def test_a_diagnosis_of_touches_speaks_of_touches(cell, tmp_path):
    assert ran("simulate", str(cell), "--test", "touch", "-o", str(tmp_path / "sim")).returncode == 0
    done = ran("diagnose", str(tmp_path / "sim"), "-o", str(tmp_path / "found"))
    assert done.returncode == 0
    found = json.loads((tmp_path / "found" / "diagnosis.json").read_text())
    doubts = " ".join(found["doubts"])
    assert "touched twice" in doubts
    assert not [word for word in ("no target", "circle", "turns back") if word in doubts]
    gap = found["gap"]
    assert gap["noise_floor"] < 1.5 * gap["train"]["before"]  # as much noise as the readings show

from typing import get_args

import pytest

from analysis.runs.tables import format_of
from rigs.load import SHIPPED, load, parse
from rigs.readiness import gauges_needed, missing_for, readiness_lines
from rigs.rig import Rig
from rigs.schema.vocabulary import TestName
from tests.support.command_line import ran

_FANUC = (SHIPPED / "paper-fanuc.yaml").read_text(encoding="utf-8")


def one_gauge() -> str:
    """The shipped cell without its second gauge."""
    return _FANUC[: _FANUC.index("  g2:\n")] + _FANUC[_FANUC.index("\nfeedback:") :]


@pytest.mark.parametrize("test", get_args(TestName))
def test_required_gauges_are_those_read_by_the_test(test):
    assert gauges_needed(test) == format_of(test).gauges


def test_a_file_without_its_second_gauge_is_ready_for_distances_alone():
    rig: Rig = parse(one_gauge(), "cell.yaml")
    ready = [test for test in get_args(TestName) if not missing_for(rig, test)]
    assert ready == ["radial", "repeatability"]
    assert [missing.key for missing in missing_for(rig, "yaw")] == ["gauges.g2"]
    assert "not possible: yaw, roll: " in "\n".join(readiness_lines(rig))


@pytest.mark.parametrize(
    "words",
    [
        ("check", "CELL"),
        ("simulate", "CELL", "--test", "yaw", "-o", "sim"),
        ("plan", "CELL", "--tests", "roll,radial"),
        ("session", "CELL", "--for", "fanuc", "--emulated", "--fast", "-o", "session"),
    ],
)
def test_command_for_two_gauges_refuses_one(words, tmp_path):
    cell = tmp_path / "cell.yaml"
    cell.write_text(one_gauge(), encoding="utf-8")
    done = ran(*(str(cell) if word == "CELL" else word for word in words), cwd=tmp_path)
    first = next(line for line in done.stderr.splitlines() if line)
    assert done.returncode == 3
    assert first.startswith("error: ") and "add gauges.g2" in first
    assert sorted(path.name for path in tmp_path.iterdir()) in (["cell.yaml"], ["cell.yaml", "session"])


def test_length_in_metres_is_doubted_and_makes_its_test_impossible(tmp_path):
    text = load("ur10e-cell")[1]
    for key, value, doubt, missing in (
        ("d_mm: 119.85", "d_mm: 0.11985", "axis 5 (wrist 2): d_mm ", ""),
        ("a_mm: -612.7", "a_mm: -0.6127", "axis 3 (elbow): a_mm ", "not possible: yaw, roll: "),
    ):
        assert key in text
        (tmp_path / "cell.yaml").write_text(text.replace(key, value), encoding="utf-8")
        shown = ran("check", "cell.yaml", cwd=tmp_path).stdout
        assert f"doubt: {doubt}" in shown and missing in shown
    assert "doubt" not in ran("check", "kinova-gen3-7").stdout

"""A rig file's text with values changed: everything else stays as a person wrote it."""

from __future__ import annotations

from typing import Any

import pytest

from analysis.reporting.changed_rig import with_values
from rigs.errors import FileError
from rigs.load import load, parse
from rigs.rig import Rig

TEXT = load("paper-fanuc")[1]


def _wanted(text: str, **circle: Any) -> Rig:
    rig = parse(text, "cell")
    assert rig.tests.circle
    tests = rig.tests.model_copy(update={"circle": rig.tests.circle.model_copy(update=circle)})
    return rig.model_copy(update={"tests": tests})


def test_only_the_lines_of_the_values_change() -> None:
    text = with_values(TEXT, {("tests", "circle", "radius_mm"): 140.0}, _wanted(TEXT, radius_mm=140.0), "cell")
    lines = list(zip(TEXT.splitlines(), text.splitlines(), strict=True))
    assert [after.strip() for before, after in lines if before != after] == ["radius_mm: 140.0"]


def test_a_list_written_line_by_line_is_replaced_whole() -> None:
    block = TEXT.replace("    normal: [-0.281, 0.240, 1]\n", "    normal:\n      - -0.281\n      - 0.240\n      - 1\n")
    text = with_values(block, {("tests", "circle", "normal"): [0, 0, 1]}, _wanted(block, normal=(0, 0, 1)), "cell")
    assert "    normal: [0, 0, 1]\n    zero: [1, 0, 0]" in text.replace("normal:\n      [0", "normal: [0")


@pytest.mark.parametrize("flow", [False, True])
def test_a_key_that_was_not_there_is_added(flow: bool) -> None:
    bare = TEXT.replace("    speed_mm_s: 25\n", "")
    if flow:
        begin, end = bare.index("  circle:\n"), bare.index("  hemisphere:\n")
        rows = [line.strip() for line in bare[begin:end].splitlines()[1:]]
        bare = bare[:begin] + "  circle: {" + ", ".join(rows) + "}\n" + bare[end:]
        bare = bare.replace(" # 934.9 mm from axis 1 at azimuth -5.39 deg, above the shoulder", "")
    text = with_values(bare, {("tests", "circle", "speed_mm_s"): 100.0}, _wanted(bare, speed_mm_s=100.0), "cell")
    assert text.count("speed_mm_s: 100.0") == 1


def test_a_whole_branch_that_was_not_there_is_added() -> None:
    bare = TEXT.replace("  tool: {xyz_mm: [0, 0, 327.3]} # flange to ball\n", "")
    rig = parse(bare, "cell")
    tool = rig.robot.tool.model_copy(update={"xyz_mm": (40.0, 0.0, 0.0)})
    wanted = rig.model_copy(update={"robot": rig.robot.model_copy(update={"tool": tool})})
    text = with_values(bare, {("robot", "tool", "xyz_mm"): [40.0, 0.0, 0.0]}, wanted, "cell")
    assert "  tool: {xyz_mm: [40.0, 0.0, 0.0]}\n  name: FANUC-like" in text


def test_a_value_that_others_share_by_an_alias_is_refused() -> None:
    shared = TEXT.replace("    radius_mm: 70", "    radius_mm: &r 70").replace(
        "    radius_mm: 400", "    radius_mm: *r"
    )
    with pytest.raises(FileError, match="YAML aliases"):
        with_values(shared, {("tests", "hemisphere", "radius_mm"): 300.0}, parse(shared, "cell"), "cell")

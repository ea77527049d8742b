"""The mechanics page: its table is what the simulator gives, its drawings are well formed and readable in the dark."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from dev.alignment import table

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "mechanics.md").read_text(encoding="utf-8")
DRAWINGS = sorted((ROOT / "docs" / "images").glob("mechanics-*.svg"))


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


@pytest.mark.timeout(300)
def test_the_table_is_what_the_simulator_gives() -> None:
    lines = table()
    begin = PAGE.index(lines[0])
    written = PAGE[begin:].split("\n\n", 1)[0].splitlines()
    assert len(written) == len(lines)
    for ours, theirs in zip(written[2:], lines[2:], strict=True):
        assert cells(ours)[0] == cells(theirs)[0]
        for one, other in zip(cells(ours)[1:], cells(theirs)[1:], strict=True):
            assert number(one) == pytest.approx(number(other), abs=2e-4), ours


def number(cell: str) -> float:
    return 0.0 if cell == "–" else float(re.sub(r"°| mm", "", cell).replace("−", "-"))


@pytest.mark.parametrize("path", DRAWINGS, ids=lambda path: path.stem)
def test_a_drawing_is_shown_and_has_colours_for_the_dark(path: Path) -> None:
    root = ET.parse(path).getroot()  # noqa: S314 - our own file
    assert root.get("aria-label") and f"images/{path.name}" in PAGE
    style = root.find("{http://www.w3.org/2000/svg}style")
    assert style is not None and style.text and "prefers-color-scheme: dark" in style.text
    assert root.find("{http://www.w3.org/2000/svg}rect[@class='paper']") is not None


def test_there_are_drawings() -> None:
    assert len(DRAWINGS) == 3

"""Rig files: the shipped ones are good; mistakes are told all at once, each with its place and remedy."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigs.errors import FileError
from rigs.load import SHIPPED, RigFileError, find, load, parse

TEXT = (SHIPPED / "paper-fanuc.yaml").read_text()


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_rigs_are_good_and_found_by_name(path: Path) -> None:
    rig, text = load(path.stem)
    assert rig.name == path.stem
    assert text == path.read_text()


def _problems(text: str) -> dict[str, tuple[int, str]]:
    with pytest.raises(RigFileError) as caught:
        parse(text, "cell.yaml")
    assert "\n" not in str(caught.value)
    return {problem.place: (problem.line, problem.message) for problem in caught.value.problems}


def _line(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1


def test_five_mistakes_are_told_at_once_with_line_place_and_remedy() -> None:
    text = (
        TEXT.replace("radius_mm: 70", "radius_mn: 70")
        .replace("axis: 5, width", "axis: 7, width")
        .replace("effect: backlash, axis: 1", "effect: backlsh, axis: 1")
        .replace("a_mm: 254.5", "a_mm: long")
        .replace("line: 4800 7E2", "line: 4800 9X2", 1)
    )
    problems = _problems(text)
    assert len(problems) == 5
    line, message = problems["tests.circle.radius_mn"]
    assert "did you mean radius_mm?" in message
    assert line == _line(text, "radius_mn")
    assert problems["robot.axes[2].a_mm"][0] == _line(text, "a_mm: long")
    assert "'9600 8N1'" in problems["gauges.g1.line"][1]
    assert "did you mean backlash?" in problems["effects[1]"][1]
    assert "effects[2].axis" in problems


def test_a_key_given_twice_is_refused() -> None:
    assert "twice" in _problems(TEXT + "\nname: other\n")["name"][1]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("limits_deg: [-150, 150]", "limits_deg: [150, -150]", "swap them"),
        ("/dev/serial/by-id/usb-FTDI_gauge_1-if00-port0", "COM3", "no port"),
        ("tcp://192.168.1.10:59002", "tcp://192.168.1.10:99999", "no port"),
        ("zero: [1, 0, 0]", "zero: [-0.281, 0.240, 1]", "parallel"),
        ("normal: [-0.281, 0.240, 1]", "normal: [0, 0, 0]", "length zero"),
        ("q6_deg]", "q5_deg]", "must stand in the line once"),
        ("usb-FTDI_gauge_2", "usb-FTDI_gauge_1", "give g2 its own port"),
        ("radius_mm: 70", "radius_mm: 0", "greater than 0"),
        ("radius_mm: 70", "radius_mm: .nan", "finite"),
        ("name: paper-fanuc", "name: ../paper", "match"),
    ],
)
def test_what_cannot_be_is_refused(old: str, new: str, told: str) -> None:
    assert old in TEXT
    messages = " ".join(message for _, message in _problems(TEXT.replace(old, new)).values())
    assert told in messages


def test_a_block_that_misses_its_own_registers_is_refused() -> None:
    text = (SHIPPED / "ur10e.yaml").read_text().replace("count: 13", "count: 3")
    assert "widen" in " ".join(message for _, message in _problems(text).values())


def test_a_missing_file_names_what_is_shipped() -> None:
    with pytest.raises(FileError, match="paper-fanuc"):
        find("no-such-rig")


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_damaged_file_gives_one_line_and_never_anything_else(data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(TEXT) - 1))
    length = data.draw(st.integers(0, 60))
    text = TEXT[:start] + data.draw(st.text(max_size=20)) + TEXT[start + length :]
    try:
        parse(text, "cell.yaml")
    except FileError as error:
        assert "\n" not in error.where + error.remedy

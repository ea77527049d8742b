from collections.abc import Callable

import pytest

from daq.discovery.robots import layout_of
from daq.protocol.conversation import Arrival

JOINTS = tuple(f"q{axis}_deg" for axis in range(1, 7))
ANGLES = (1.5, -70.25, 100.0, 55.0, 85.0, 108.0)


def printed(line: Callable[[int], str], count: int = 30, period_ms: float = 10.0) -> list[Arrival]:
    return [(line(k).encode(), round(1e9 + k * period_ms * 1e6)) for k in range(count)]


def joined(values: tuple[float, ...], separator: str = ",") -> str:
    return separator.join(f"{value:.5f}" for value in values)


@pytest.mark.parametrize(
    ("line", "fields", "separator"),
    [
        (lambda k: f"{10 * k},{joined(ANGLES)}\r\n", ("t_ms", *JOINTS), ","),
        (lambda k: f"{joined(ANGLES)},{0.01 * k:.3f}\n", (*JOINTS, "t_s"), ","),
        (lambda k: f"{10_000 * k};{joined(ANGLES, ';')}\n", ("t_us", *JOINTS), ";"),
        (lambda k: f"  {joined(ANGLES, '   ')}  \n", JOINTS, " "),
        (lambda k: f"J,{joined(ANGLES)},0\n", ("_", *JOINTS, "_"), ","),
    ],
)
def test_layouts(line, fields, separator):
    layout = layout_of(printed(line))
    assert (layout.fields, layout.separator, layout.sure) == (fields, separator, True)


def test_a_joint_that_turns_is_not_taken_for_a_clock():
    layout = layout_of(printed(lambda k: f"{10 * k},{0.2 * k},{joined(ANGLES[1:])}\n"))
    assert layout.fields == ("t_ms", *JOINTS)


def test_small_angles_could_be_radians():
    layout = layout_of(printed(lambda k: f"{joined((0.1, -1.2, 1.7, 0.9, 1.5, 1.9))}\n"))
    assert not layout.sure


@pytest.mark.parametrize(
    "line",
    [
        lambda k: "220 printer ready\r\n",
        lambda k: "1,2,3,4,5\n",
        lambda k: ",".join("1" * (6 + k % 2)) + "\n",
        lambda k: "\x00\xff\x01 no lines",
        lambda k: "nan,nan,nan,nan,nan,nan\n",
    ],
)
def test_other_lines_are_no_joints(line):
    assert layout_of(printed(line)) is None


def test_nothing_and_little():
    assert layout_of([]) is None
    assert layout_of(printed(lambda k: f"{joined(ANGLES)}\n", count=3)) is None

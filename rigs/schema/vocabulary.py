"""Names shared by rig files, runs, commands and reports. No slow imports, for a fast command line."""

from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Literal, get_args

TestName = Literal["yaw", "roll", "radial", "repeatability", "pose", "touch", "path"]
"""Kinds of tests. Packages may offer others as entry points `rig.tests`."""
ENTRY_POINTS = entry_points()
"""Entry points of all installed packages. Scanning an environment of a hundred packages takes 5 ms."""
OTHER_TESTS = {
    offer.name: offer for offer in ENTRY_POINTS.select(group="rig.tests") if offer.name not in get_args(TestName)
}
"""Test kinds of other packages by name. None can take over a name of rig's own tests."""
if not TYPE_CHECKING:
    TestName = Literal[(*get_args(TestName), *sorted(OTHER_TESTS))]
Direction = Literal["cw", "acw"]

CircleTest = Literal["yaw", "roll"]
DrivenTest = Literal[CircleTest, "radial", "repeatability"]
"""Tests with a robot program and the ball link."""
ProgramTest = Literal[DrivenTest, "iso9283"]
"""Kinds of programs: driven tests, and the poses and paths of ISO 9283 for a tracker."""
SimulatedTest = Literal[DrivenTest, "touch", "iso9283"]
"""Simulated tests: ball link tests, touches guided by hand, and ISO 9283 with a tracker."""
CIRCLES: tuple[CircleTest, ...] = get_args(CircleTest)
OF_ISO9283: tuple[TestName, ...] = ("pose", "path")
"""Tests of ISO 9283, recorded by a tracker."""
WITHOUT_GAUGES: tuple[TestName, ...] = (*OF_ISO9283, "touch")
PartName = Literal["circle", "hemisphere", "touch", "iso9283"]
TEST_PARTS: dict[TestName, PartName] = {
    **dict.fromkeys(CIRCLES, "circle"),
    **dict.fromkeys(tuple(test for test in get_args(DrivenTest) if test not in CIRCLES), "hemisphere"),
    **dict.fromkeys(OF_ISO9283, "iso9283"),
    "touch": "touch",
}
FURTHER = ("g3", "g4", "g5", "g6", "g7", "g8")

_WAYS: dict[str, Direction] = {
    "acw": "acw", "ccw": "acw", "counterclockwise": "acw", "anticlockwise": "acw", "cw": "cw", "clockwise": "cw"
}  # fmt: skip
MeasuredBy = Literal["gauges", "tracker", "sockets", "arm"]
"""Measuring device: two gauges and a ball link, a tracker, a ball seated in sockets, or another arm with a socket."""
TEST_WITHOUT_GAUGES: dict[MeasuredBy, TestName] = {"tracker": "pose", "sockets": "touch", "arm": "touch"}
"""Test of an arm measured without gauges."""
FEWEST_AXES, DRIVEN_AXES, MOST_AXES = 4, 6, 7
"""Smallest and largest number of axes, and the number that circles, programs and controller entries require."""


def direction_of(word: str) -> Direction | None:
    return _WAYS.get(word.casefold())


MakerName = str
"""Name of a maker of controllers (rigs/makers.py)."""

Build = Literal["industrial", "light", "torque_sensing", "servo"]
"""Design of an arm, which determines typical sizes of effects: reducers of industrial arms, strain-wave gears of light
arms and cobots, joint torque sensors, or hobby servos with load-bearing brackets.
"""

"""Names that rig files, runs, commands and reports share; free of slow imports, so that a command line starts fast."""

from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Literal, get_args

TestName = Literal[
    "yaw",
    "roll",
    "radial",
    "repeatability",
    "pose",
    "touch",
    "path",
]
"""The kinds of test: each is the module of its name in `analysis.procedures`, or a package offers it as `rig.tests`."""
OFFERED_TESTS = {kind.name: kind for kind in entry_points(group="rig.tests") if kind.name not in get_args(TestName)}
"""Kinds of test of other packages by name, none of which takes a name of rig's own."""
if not TYPE_CHECKING and OFFERED_TESTS:
    TestName = Literal[(*get_args(TestName), *sorted(OFFERED_TESTS))]
Direction = Literal["cw", "acw"]

CircleTest = Literal["yaw", "roll"]
DrivenTest = Literal[CircleTest, "radial", "repeatability"]
"""The tests that a program of the robot drives, with the ball link."""
ProgramTest = Literal[DrivenTest, "iso9283"]
"""What programs are written for: the driven tests, and the poses and paths of ISO 9283 for a tracker."""
SimulatedTest = Literal[DrivenTest, "touch", "iso9283"]
"""What is simulated: the tests of the ball link, touches, which a person guides, and ISO 9283 before a tracker."""
CIRCLES: tuple[CircleTest, ...] = get_args(CircleTest)
"""The tests on a circle."""
OF_ISO9283: tuple[TestName, ...] = ("pose", "path")
"""The tests of ISO 9283, which a tracker records by itself."""
WITHOUT_GAUGES: tuple[TestName, ...] = (*OF_ISO9283, "touch")
"""The tests that no gauge reads."""
PartName = Literal["circle", "hemisphere", "touch", "iso9283"]
TEST_PARTS: dict[TestName, PartName] = {
    **dict.fromkeys(CIRCLES, "circle"),
    **dict.fromkeys(tuple(test for test in get_args(DrivenTest) if test not in CIRCLES), "hemisphere"),
    **dict.fromkeys(OF_ISO9283, "iso9283"),
    "touch": "touch",
}
"""The part of `tests` in a rig file that says where each test is driven."""
FURTHER = ("g3", "g4", "g5", "g6", "g7", "g8")
"""Gauges that no test measures with."""

_WAYS: dict[str, Direction] = {
    "acw": "acw", "ccw": "acw", "counterclockwise": "acw", "anticlockwise": "acw", "cw": "cw", "clockwise": "cw"
}  # fmt: skip
MeasuredBy = Literal["gauges", "tracker", "sockets"]
"""What measures the arm: two gauges and a ball link, a tracker, or a ball that is seated in sockets."""
TEST_WITHOUT_GAUGES: dict[MeasuredBy, TestName] = {"tracker": "pose", "sockets": "touch"}
"""The test by which an arm is measured that has no gauges."""
FEWEST_AXES, DRIVEN_AXES, MOST_AXES = 4, 6, 7
"""The fewest and the most axes that an arm may have, and those of an arm that drives the ball link: a tool takes any
pose with six, so that circles, their programs and entries of controllers are of so many."""


def direction_of(word: str) -> Direction | None:
    """Return the direction that a word means, as people write it: ccw is acw; None for any other word."""
    return _WAYS.get(word.casefold())


MakerName = str
"""A maker of controllers by its name: one of MAKERS, or one that another package offers."""
_ALSO_NAMED: dict[MakerName, tuple[str, ...]] = {
    "ur": ("universalrobots",),
    "fanuc": (),
    "kuka": (),
    "abb": (),
    "yaskawa": ("motoman",),
}
"""The makers for whose controllers programs and corrections are written, and other names that their arms bear; a folder
in analysis/apps/makers has all else of each."""
MAKERS: tuple[MakerName, ...] = tuple(_ALSO_NAMED)


def offered_makers() -> dict[MakerName, str]:
    """Return the makers of other packages, each with the package that has its answers."""
    from rigs.schema.plugins import packages_of_makers  # noqa: PLC0415 - no command line waits for pydantic

    return {name: package for name, package in packages_of_makers().items() if name not in MAKERS}


def makers() -> tuple[MakerName, ...]:
    """Return all makers, those of other packages last."""
    return (*MAKERS, *offered_makers())


def maker_named(word: str) -> MakerName | None:
    """Return the maker that a word means, as people write it: UR, Universal Robots and UR10e are ur; None for any other
    word."""
    named = {_letters(maker): maker for maker in offered_makers()}
    named |= {name: maker for maker, others in _ALSO_NAMED.items() for name in (maker, *others)}
    names = [name for name in named if _letters(word).startswith(name)]
    return named[max(names, key=len)] if names else None


def _letters(word: str) -> str:
    return "".join(char for char in word.casefold() if char.isalnum())


def maker_of(interface: str) -> MakerName | None:
    """Return the maker whose controllers speak a feedback interface, which is named after it; None for any maker's."""
    return next((maker for maker in makers() if interface.startswith(f"{maker}_")), None)


Build = Literal["industrial", "light", "torque_sensing", "servo"]
"""How an arm is built, by which it is judged what is usual: with the reducers of large machines, with strain-wave gears
as light arms and cobots, with sensors of torque in its joints, or of hobby servos and brackets that carry them."""

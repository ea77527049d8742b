"""Names that rig files, runs, commands and reports share; free of imports, so that a command line starts fast."""

from typing import Literal, get_args

TestName = Literal["yaw", "roll", "radial", "repeatability", "pose", "touch", "path"]
Direction = Literal["cw", "acw"]

CIRCLES: tuple[Literal["yaw", "roll"], ...] = ("yaw", "roll")
"""The tests on a circle."""
WITHOUT_GAUGES: tuple[Literal["pose", "touch", "path"], ...] = ("pose", "touch", "path")
"""The tests that no gauge reads."""
FURTHER = ("g3", "g4", "g5", "g6", "g7", "g8")
"""Gauges that no test measures with."""

_WAYS: dict[str, Direction] = {
    "acw": "acw", "ccw": "acw", "counterclockwise": "acw", "anticlockwise": "acw", "cw": "cw", "clockwise": "cw"
}  # fmt: skip
FEWEST_AXES, DRIVEN_AXES, MOST_AXES = 4, 6, 7
"""The fewest and the most axes that an arm may have, and those of an arm that drives the ball link: a tool takes any
pose with six, so that circles, their programs and entries of controllers are of so many."""


def direction_of(word: str) -> Direction | None:
    """Return the direction that a word means, as people write it: ccw is acw; None for any other word."""
    return _WAYS.get(word.casefold())


DrivenTest = Literal["yaw", "roll", "radial", "repeatability"]
"""The tests that a program of the robot drives, with the ball link."""
ProgramTest = Literal["yaw", "roll", "radial", "repeatability", "iso9283"]
"""What programs are written for: the driven tests, and the poses and paths of ISO 9283 for a tracker."""
SimulatedTest = Literal["yaw", "roll", "radial", "repeatability", "touch", "iso9283"]
"""What is simulated: the tests of the ball link, touches, which a person guides, and ISO 9283 before a tracker."""
Maker = Literal["ur", "fanuc", "kuka", "abb", "yaskawa"]
"""Makers of controllers for which programs and corrections are written."""
MAKERS: tuple[Maker, ...] = get_args(Maker)


_ALSO_NAMED: dict[str, Maker] = {"universalrobots": "ur", "motoman": "yaskawa"}
"""Makers by names that their arms bear as well."""


def maker_named(word: str) -> Maker | None:
    """Return the maker that a word means, as people write it: UR, Universal Robots and UR10e are ur; None for any other
    word."""
    letters = "".join(char for char in word.casefold() if char.isalnum())
    named: dict[str, Maker] = {maker: maker for maker in MAKERS} | _ALSO_NAMED
    return next((maker for name, maker in named.items() if letters.startswith(name)), None)


def maker_of(interface: str) -> Maker | None:
    """Return the maker whose controllers speak a feedback interface, which is named after it; None for any maker's."""
    return next((maker for maker in MAKERS if interface.startswith(f"{maker}_")), None)


Build = Literal["industrial", "light", "torque_sensing", "servo"]
"""How an arm is built, by which it is judged what is usual: with the reducers of large machines, with strain-wave gears
as light arms and cobots, with sensors of torque in its joints, or of hobby servos and brackets that carry them."""

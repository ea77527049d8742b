"""Names that rig files, runs, commands and reports share; free of imports, so that a command line starts fast."""

from typing import Literal, get_args

TestName = Literal["yaw", "roll", "radial", "repeatability", "pose"]
Direction = Literal["cw", "acw"]

CIRCLES: tuple[Literal["yaw", "roll"], ...] = ("yaw", "roll")
"""The tests on a circle."""

DrivenTest = Literal["yaw", "roll", "radial", "repeatability"]
"""The tests that a program of the robot drives, with the ball link."""
Maker = Literal["ur", "fanuc", "kuka", "abb", "yaskawa"]
"""Makers of controllers for which programs and corrections are written."""
MAKERS: tuple[Maker, ...] = get_args(Maker)


def maker_of(interface: str) -> Maker | None:
    """Return the maker whose controllers speak a feedback interface, which is named after it; None for any maker's."""
    return next((maker for maker in MAKERS if interface.startswith(f"{maker}_")), None)

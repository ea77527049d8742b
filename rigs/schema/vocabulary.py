"""Names that rig files, runs, commands and reports share; free of imports, so that a command line starts fast."""

from typing import Literal

TestName = Literal["yaw", "roll", "radial", "repeatability", "pose"]
Direction = Literal["cw", "acw"]

CIRCLES: tuple[Literal["yaw", "roll"], ...] = ("yaw", "roll")
"""The tests on a circle."""

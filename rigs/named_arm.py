"""Comparison of the axes of a rig file with the arm of the library that it names (`robot.arm`)."""

from __future__ import annotations

from collections.abc import Iterator

from rigs.arms import arm_names, load_arm
from rigs.errors import FileError
from rigs.schema.robot import JointAxis, Robot

_ALIKE_SHARE, _ALIKE_DEG = 0.01, 3.0
"""Largest differences between the constants of one robot and the data sheet: 1 % of the reach, and 3°.

Chosen: constants of real controllers (UR, reach 0.9 to 1.8 m) differ by less than a fifth of that. `d_mm` is not
compared, because it is not determined at parallel axes.
"""


def _differing(given: JointAxis, named: JointAxis, reach_mm: float) -> Iterator[str]:
    """Keys of constants that are not those of the same arm."""
    if abs(given.a_mm - named.a_mm) > _ALIKE_SHARE * reach_mm:
        yield "a_mm"
    if abs((given.alpha_deg - named.alpha_deg + 180) % 360 - 180) > _ALIKE_DEG:
        yield "alpha_deg"


def _named(robot: Robot) -> Robot | None:
    named = load_arm(robot.arm).robot if robot.arm in arm_names() else None
    return named if named and len(named.axes) == len(robot.axes) else None


def named_arm_doubts(robot: Robot) -> Iterator[str]:
    """Constants that differ from the named arm by more than robots of the same model do."""
    named = _named(robot)
    for number, (given, its) in enumerate(zip(robot.axes, named.axes, strict=True) if named else (), 1):
        for key in _differing(given, its, named.reach_mm if named else 0.0):
            yield (
                f"{robot.axis_words(number)}: {key} is {getattr(given, key):g}, but {getattr(its, key):g} in the arm "
                f"{robot.arm} of the library, which robot.arm names; correct one of them, or remove robot.arm"
            )


def refuse_classic_constants(robot: Robot, where: str) -> None:
    """Refuse axes that are the named arm in the classic notation of Denavit and Hartenberg. Raises FileError."""
    named = _named(robot)
    if named is None or not any(named_arm_doubts(robot)):
        return
    as_classic = zip(robot.read_as_classic.axes, named.axes, strict=True)
    if not any(any(_differing(given, its, named.reach_mm)) for given, its in as_classic):
        raise FileError(
            f"{where}, robot.axes",
            f"has the constants of {robot.arm} in the classic notation of Denavit and Hartenberg, but rig uses the "
            "modified one (Craig)",
            f"move a_mm and alpha_deg of each axis to the next one, or copy the axes printed by `rig arms {robot.arm}`",
            code="rig_file.invalid",
        )

"""Further tests: those that could be run in addition, namely the other tests of the rig file and circles with another
set-up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.kinematics.arm import transform
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle
from rigs.schema.vocabulary import CIRCLES, TestName

_RADII_MM = (140.0, 50.0)
"""Radii of further circles. Chosen: twice the 70 mm of the paper's circle, and a smaller one that most arms can drive.
"""
_NEAR = 0.2
"""Difference of the logarithms of two radii below which they count as one. Chosen."""
_ASIDE_MM = 100.0
"""Displacement of the centre of a further circle. Chosen: enough to change the posture by several degrees on an arm of
one metre."""
FASTER = 4
"""Factor on the speed of a further circle. Chosen: time effects grow by the same factor."""
OFF_AXIS_MM = 40.0
"""Offset of the ball from axis 6 in a further circle. Chosen: a bracket of that length is easily made."""


@dataclass(frozen=True)
class FurtherTest:
    """A further test. `choices` lists rigs that are set up for it, each with a description; the first one that the arm
    can drive is used."""

    tests: tuple[TestName, ...]
    why: str
    choices: tuple[tuple[str, Rig], ...]


def further_tests(rig: Rig, tests: Sequence[TestName]) -> list[FurtherTest]:
    """Return the tests that are not among `tests`, including set-ups that the rig file does not contain."""
    missing: tuple[TestName, ...] = tuple(test for test in CIRCLES if test not in tests)
    found = []
    if missing and rig.tests.circle:
        words = f"{' and '.join(missing)} on the circle"
        found.append(FurtherTest(missing, "the tool's other tilt", ((words, rig),)))
    if rig.tests.hemisphere:
        if "radial" not in tests:
            found.append(FurtherTest(("radial",), "many postures, by distance alone", (("hemisphere (radial)", rig),)))
        if "repeatability" not in tests:
            found.append(FurtherTest(("repeatability",), "the same places from both sides", (("repeatability", rig),)))
    # Of tests that add equally much the first is reported, so tests of the rig file precede new set-ups.
    return found + (_other_circles(rig, rig.tests.circle, tests) if rig.tests.circle else [])


def _other_circles(rig: Rig, circle: Circle, tests: Sequence[TestName]) -> list[FurtherTest]:
    circles: tuple[TestName, ...] = tuple(test for test in CIRCLES if test in tests) or CIRCLES
    nearby = places(rig, circle)
    found = []
    for radius in other_radii(circle):
        words = f"circle of radius {radius:g} mm"
        choices = [(words, with_circle(rig, circle, radius_mm=radius))]
        choices += [(f"{words}, {w}", with_circle(rig, circle, radius_mm=radius, centre_mm=at)) for w, at in nearby]
        found.append(
            FurtherTest(
                circles, "the effect of an angle grows with the radius, that of a length does not", tuple(choices)
            )
        )
    elsewhere = tuple((f"circle {words}", with_circle(rig, circle, centre_mm=at)) for words, at in nearby)
    found.append(FurtherTest(circles, "another posture changes the effect of each joint and link", elsewhere))
    speed = FASTER * circle.speed_mm_s
    faster = ((f"circle at {speed:g} mm/s", with_circle(rig, circle, speed_mm_s=speed)),)
    found.append(
        FurtherTest(circles, "the effect of a delay grows with the speed, that of a play or a length does not", faster)
    )
    beside = ball_off_axis(rig)
    if beside:
        words = f"circle with the ball {OFF_AXIS_MM:g} mm off axis 6"
        found.append(FurtherTest(circles, "the ball moves when axis 6 turns", ((words, beside),)))
    return found


def other_radii(circle: Circle) -> tuple[float, ...]:
    """Return the radii in mm of further circles that differ from a circle's."""
    return tuple(radius for radius in _RADII_MM if abs(np.log(radius / circle.radius_mm)) > _NEAR)


def ball_off_axis(rig: Rig) -> Rig | None:
    """Return a rig with the ball OFF_AXIS_MM beside axis 6, or None where it is beside it already."""
    x, y, z = rig.robot.tool.xyz_mm
    if np.hypot(x, y) >= OFF_AXIS_MM / 2:
        return None
    tool = rig.robot.tool.model_copy(update={"xyz_mm": (x + OFF_AXIS_MM, y, z)})
    return rig.model_copy(update={"robot": rig.robot.model_copy(update={"tool": tool})})


def with_circle(rig: Rig, circle: Circle, **changed: Any) -> Rig:
    """Return a rig with its circle changed."""
    tests = rig.tests.model_copy(update={"circle": circle.model_copy(update=changed)})
    return rig.model_copy(update={"tests": tests})


def places(rig: Rig, circle: Circle) -> list[tuple[str, tuple[float, ...]]]:
    """Return centres displaced from the circle's, each with a description: towards axis 1 and away from it, along it
    down and up."""
    T, centre = transform(rig.robot.base), np.array(circle.centre_mm)
    up, out = T[:3, 2], centre - T[:3, 3]
    out = out - (out @ up) * up
    out /= max(float(np.linalg.norm(out)), 1e-9)
    ways = {"nearer to axis 1": -out, "lower": -up, "further from axis 1": out, "higher": up}
    return [(f"{_ASIDE_MM:g} mm {words}", tuple((centre + _ASIDE_MM * way).tolist())) for words, way in ways.items()]

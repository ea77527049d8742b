"""Additional circles: the rig's circle at other places, tilts, radii and speeds, and with the ball away from axis 6, as
far as the arm can drive them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.plan.further_tests import (
    FASTER,
    OFF_AXIS_MM,
    ball_off_axis,
    other_radii,
    places,
    with_circle,
)
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import circle_program
from rigs.errors import FileError, PathError, RigPlace, Undrivable
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle
from rigs.schema.vocabulary import TestName

_TILT_DEG = 30.0
"""Tilt of a further circle's plane. Chosen: enough to change the wrist posture, and possible for most arms."""
SET_UP_MIN = 10.0
"""Minutes to move the ball, adjust the link and load the program for a different circle. Chosen: for an experienced
operator.
"""

_REASONS: dict[Undrivable, str] = {
    "limits": "beyond the limits of a joint",
    "speed": "too fast for a joint",
    "singularity": "at a singularity",
    "reach": "out of reach",
}


@dataclass(frozen=True)
class CircleCandidate:
    rig: Rig
    words: str
    minutes: float


def circle_candidates(
    rig: Rig, tests: Sequence[TestName], runs: int
) -> tuple[tuple[CircleCandidate, ...], Counter[str]]:
    """Further circles that the arm can drive, and the number of the others by reason.

    runs: number of runs of each of `tests` in each direction, for the minutes. Raises FileError without tests.circle.
    """
    if rig.tests.circle is None:
        remedy = "add a circle: centre, posture, radius"
        raise FileError(RigPlace.of(rig.name), "needs tests.circle as a start", remedy, code="rig_file.invalid")
    circles, refused = [], Counter[str]()
    for words, other_rig in _circles(rig, rig.tests.circle):
        try:
            program = circle_program(other_rig, "acw")
        except PathError as error:
            refused[_REASONS[error.reason]] += 1
            continue
        assert other_rig.tests.circle is not None  # noqa: S101 - each has one
        start_deg = np.degrees(program.q[0]).round(2).tolist()
        ready = with_circle(other_rig, other_rig.tests.circle, posture_deg=tuple(start_deg))
        circles.append(CircleCandidate(ready, words, circle_minutes(float(program.t_s[-1]), tests, runs)))
    return tuple(circles), refused


def circle_minutes(lap_s: float, tests: Sequence[TestName], runs: int) -> float:
    return SET_UP_MIN + len(tests) * 2 * runs * lap_s / 60


def _circles(rig: Rig, circle: Circle) -> Iterator[tuple[str, Rig]]:
    aside = [(words, tuple(np.round(centre, 3).tolist())) for words, centre in places(rig, circle)]
    for where, centre in [("", circle.centre_mm), *aside]:
        for radius in (circle.radius_mm, *other_radii(circle)):
            changes = [where, "" if radius == circle.radius_mm else f"radius {radius:g} mm"]
            if any(changes):
                yield ", ".join(filter(None, changes)), with_circle(rig, circle, centre_mm=centre, radius_mm=radius)
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    frame, tilt = frame_of(circle), np.radians(_TILT_DEG)
    for about, axis in (("the zero direction", frame.u), ("the direction at 90°", frame.v)):
        normal = Rotation.from_rotvec(tilt * axis).apply(frame.n).round(6)
        yield f"tilted by {_TILT_DEG:g}° about {about}", with_circle(rig, circle, normal=tuple(normal.tolist()))
    yield f"{FASTER} times as fast", with_circle(rig, circle, speed_mm_s=FASTER * circle.speed_mm_s)
    off_axis = ball_off_axis(rig)
    if off_axis:
        yield f"ball {OFF_AXIS_MM:g} mm off axis 6", off_axis

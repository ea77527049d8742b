"""Circles that could be driven in addition: the rig's own circle at other places, tilts, radii and speeds, and with the
ball beside axis 6, as far as the arm can drive them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.further_tests import FASTER, OFF_AXIS_MM, ball_off_axis, other_radii, places, with_circle
from analysis.geometry.circle import frame_of
from analysis.geometry.programs import circle_program
from rigs.errors import FileError, PathError, RigPlace, Undrivable
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle
from rigs.schema.vocabulary import TestName

_TILT_DEG = 30.0
"""Tilt of a further circle's plane. Chosen: enough to change the posture of the wrist, and driven by most arms."""
SET_UP_MIN = 10.0
"""Minutes to move the ball, set the link and load the program for another circle. Chosen: somebody who has done it
before."""

_REASONS: dict[Undrivable, str] = {
    "limits": "beyond the limits of a joint",
    "speed": "too fast for a joint",
    "singularity": "at a singularity",
    "reach": "out of reach",
}


@dataclass(frozen=True)
class CircleCandidate:
    """A rig with a further circle, what it differs in, and the minutes of its set-up and runs."""

    rig: Rig
    words: str
    minutes: float


@dataclass(frozen=True)
class CircleCandidates:
    """The further circles that the arm can drive, and the number of those that it cannot by reason."""

    found: tuple[CircleCandidate, ...]
    refused: Counter[str]


def circle_candidates(rig: Rig, tests: Sequence[TestName], runs: int) -> CircleCandidates:
    """Return the further circles of a rig with their minutes for `runs` runs of each of `tests` in each direction.
    Raises FileError for a rig without a circle to begin from."""
    if rig.tests.circle is None:
        raise FileError(RigPlace.of(rig.name), "has no tests.circle to begin from", "add one: centre, posture, radius")
    found, refused = [], Counter[str]()
    for words, other in _circles(rig, rig.tests.circle):
        try:
            program = circle_program(other, "acw")
        except PathError as error:
            refused[_REASONS[error.reason]] += 1
            continue
        assert other.tests.circle is not None  # noqa: S101 - each has one
        start_deg = np.degrees(program.q[0]).round(2).tolist()
        ready = with_circle(other, other.tests.circle, posture_deg=tuple(start_deg))
        driven_min = len(tests) * 2 * runs * float(program.t_s[-1]) / 60
        found.append(CircleCandidate(ready, words, driven_min + SET_UP_MIN))
    return CircleCandidates(tuple(found), refused)


def _circles(rig: Rig, circle: Circle) -> Iterator[tuple[str, Rig]]:
    """Yield every further circle in words and as a rig: each radius at each place; and the rig's own circle tilted,
    faster, and with the ball beside axis 6."""
    aside = [(words, tuple(np.round(centre, 3).tolist())) for words, centre in places(rig, circle)]
    for where, centre in [("", circle.centre_mm), *aside]:
        for radius in (circle.radius_mm, *other_radii(circle)):
            changes = [where, "" if radius == circle.radius_mm else f"radius {radius:g} mm"]
            if any(changes):
                yield ", ".join(filter(None, changes)), with_circle(rig, circle, centre_mm=centre, radius_mm=radius)
    for words, normal in _tilts(circle):
        yield words, with_circle(rig, circle, normal=normal)
    yield f"{FASTER} times as fast", with_circle(rig, circle, speed_mm_s=FASTER * circle.speed_mm_s)
    beside = ball_off_axis(rig)
    if beside:
        yield f"ball {OFF_AXIS_MM:g} mm off axis 6", beside


def _tilts(circle: Circle) -> list[tuple[str, tuple[float, ...]]]:
    """Return the normal tilted about the zero direction and about the direction across it."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    frame, tilt = frame_of(circle), np.radians(_TILT_DEG)
    ways = (("its zero direction", frame.u), ("the direction at 90°", frame.v))
    tilted = [(name, Rotation.from_rotvec(tilt * axis).apply(frame.n).round(6)) for name, axis in ways]
    return [(f"tilted by {_TILT_DEG:g}° about {name}", tuple(normal.tolist())) for name, normal in tilted]

"""Tests of a rig (docs/conventions.md), automatic recording, and retention of runs.

The bounds prevent a typing error from creating a program with millions of poses.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from rigs.schema.part import Angle, Part, Vector
from rigs.schema.robot import Pose, Posture
from rigs.schema.unit_checks import not_in_metres, place_not_in_metres, speed_not_in_metres
from rigs.schema.vocabulary import CIRCLES, Direction, DrivenTest

_LONGEST_LAP_S = 1800.0


class _AboutTheBall(Part):
    """Position of targets relative to the base-ball."""

    centre_mm: Vector
    normal: Vector = (0.0, 0.0, 1.0)
    zero: Vector = (1.0, 0.0, 0.0)
    posture_deg: Posture

    @field_validator("normal", "zero")
    @classmethod
    def _has_length(cls, value: Vector) -> Vector:
        if math.hypot(*value) < 1e-9:
            raise ValueError("a direction needs a length above zero")
        return value

    @model_validator(mode="after")
    def _zero_in_plane(self) -> _AboutTheBall:
        (a, b, c), (x, y, z) = self.normal, self.zero
        across = math.hypot(b * z - c * y, c * x - a * z, a * y - b * x)
        if across < 1e-6 * math.hypot(a, b, c) * math.hypot(x, y, z):
            raise ValueError("zero is parallel to normal; choose a direction perpendicular to normal")
        return self


class Circle(_AboutTheBall):
    """Circle about the base-ball, driven acw and cw with the tool pointing at the centre.

    normal: normal of the plane. zero: direction of phi = 0, projected onto the plane. posture_deg: joint angles near
    the start of the acw circle, which select the solution of the inverse kinematics.
    """

    radius_mm: float = Field(default=70.0, ge=1, le=2000)
    speed_mm_s: float = Field(default=25.0, ge=0.5, le=2000)
    laps: int = Field(default=2, ge=1, le=50)
    """Laps in each direction, with a return in between. A single lap cannot reveal slow noise."""
    start_deg: Angle = 0.0
    lead_deg: float = Field(default=10.0, ge=0, le=90)
    """Lead-in and lead-out arc for acceleration and stopping; not analysed."""
    eccentricity_mm: Vector = (0.0, 0.0, 0.0)
    """Position of the base-ball relative to the circle centre, in the world frame.

    Only known for emulated or simulated cells.
    """

    _in_mm = field_validator("radius_mm", mode="before")(not_in_metres)
    _in_mm_s = field_validator("speed_mm_s", mode="before")(speed_not_in_metres)

    @model_validator(mode="after")
    def _ends_today(self) -> Circle:
        lap_s = 2 * math.pi * self.radius_mm / self.speed_mm_s
        if lap_s > _LONGEST_LAP_S:
            raise ValueError(
                f"a lap takes {lap_s / 60:.0f} min; at most {_LONGEST_LAP_S / 60:.0f} are allowed; increase speed_mm_s"
            )
        return self


class Hemisphere(_AboutTheBall):
    """Targets on a half sphere about the base-ball, each with several tool orientations.

    normal: direction to the middle of the hemisphere, polar angle 0, towards the working side of the robot. zero:
    direction of azimuth 0, projected onto the base of the hemisphere.
    """

    radius_mm: float = Field(default=400.0, ge=1, le=10_000)
    step_deg: float = Field(default=30.0, ge=5, le=90)
    """Angle between targets, in polar angle and in azimuth."""
    polar_max_deg: float = Field(default=90.0, gt=0, le=180)
    """Polar angle of the outermost ring."""
    orientations: int = Field(default=3, ge=1, le=15)
    visits: int = Field(default=2, ge=1, le=20)
    """Repetitions of all targets and orientations. The differences between visits are the scatter."""

    _in_mm = field_validator("radius_mm", mode="before")(not_in_metres)


class Repeatability(Part):
    """Targets of the hemisphere approached from outside and from inside along the radius."""

    approach_mm: float = Field(default=3.0, gt=0, le=100)
    rounds: int = Field(default=3, ge=1, le=1000)
    targets: Annotated[tuple[Annotated[int, Field(ge=1, le=10_000)], ...], Field(min_length=1, max_length=200)] = (1,)
    """Numbers of hemisphere targets, counted from 1."""


SocketName = Annotated[str, Field(min_length=1, max_length=40)]


class KnownSocketDistance(Part):
    """Known distance between two sockets of a part, measured or by design."""

    between: tuple[SocketName, SocketName]
    distance_mm: float = Field(gt=0, le=10_000)
    u_mm: float = Field(default=0.05, gt=0, le=100)
    """Standard uncertainty of the distance."""

    _in_mm = field_validator("distance_mm", mode="before")(not_in_metres)

    @model_validator(mode="after")
    def _of_two(self) -> KnownSocketDistance:
        if self.between[0] == self.between[1]:
            raise ValueError(
                f"the distance of {self.between[0]!r} from itself is always zero; name two different sockets"
            )
        return self


class Touch(Part):
    """Touch test: the ball on the tool is seated in fixed sockets, by hand or by a program, in a variety of postures.

    It needs no gauge: the measurement is that a seated ball returns to the same place.
    """

    sockets: Annotated[tuple[SocketName, ...], Field(min_length=1, max_length=50)]
    ball_mm: Vector = (0.0, 0.0, 100.0)
    """Approximate ball centre in the tool frame. The exact position is estimated."""
    touches: int = Field(default=40, ge=1, le=2000)
    """Number of touches requested by a recording, over all sockets."""
    seat: Literal["ball", "tip"] = "ball"
    """Kind of contact: a ball held in a socket, or the tip of a pointer that is guided into a punch mark by eye and
    scatters more."""
    distances: tuple[KnownSocketDistance, ...] = ()

    _in_mm = field_validator("ball_mm")(place_not_in_metres)

    @model_validator(mode="after")
    def _of_these_sockets(self) -> Touch:
        if len(set(self.sockets)) < len(self.sockets):
            raise ValueError("two sockets have the same name; use different names")
        if unknown := [name for distance in self.distances for name in distance.between if name not in self.sockets]:
            raise ValueError(f"distances use {unknown[0]!r}, which is not a socket; add the socket or correct the name")
        return self


class TrackerPose(Pose):
    """Pose of the tracker frame in the world, measured independently of the test poses.

    Possible methods: the mounting holes of the robot, or rotations of axes 1 and 2 only.
    """

    u_mm: float = Field(default=0.0, ge=0, le=100)
    """Standard uncertainty of a coordinate at the cube caused by this frame."""


class Iso9283(Part):
    """The cube of ISO 9283:1998, 6.8, for a tracker: five poses P1 … P5 and paths on the inclined plane of the cube.

    Missing values are computed from the range of the arm: the largest cube, with the tool pointing down or outwards.
    Edges are parallel to the axes of the robot base.
    """

    centre_mm: Vector | None = None
    """P1 in the world frame; by default the tool position at posture_deg, if given."""
    side_mm: float | None = Field(default=None, ge=20, le=5000)
    posture_deg: Posture | None = None
    """Joint angles near P1. The tool orientation there applies to all poses."""
    rises: Literal["x", "-x", "y", "-y"] = "x"
    """Direction of the base along which the inclined plane rises. The standard allows four planes."""
    cycles: int = Field(default=30, ge=3, le=1000)
    """Repetitions of P5 P4 P3 P2 P1; 30 in the standard."""
    joint_speed_deg_s: float = Field(default=30.0, gt=0, le=1000)
    """Speed of the fastest joint between poses.

    The standard requires the rated speed; use it once the path is known.
    """
    path_speed_mm_s: float = Field(default=250.0, gt=0, le=10_000)
    """Speed along the paths. The programs use 100, 50 and 10 %."""
    path_cycles: int = Field(default=10, ge=3, le=200)
    """Number of cycles along a path; 10 in the standard."""
    instrument: TrackerPose | None = None
    """Tracker frame. If absent, the frame is fitted to the poses, which makes AP and AT too small."""


class Tests(Part):
    """Tests of a rig. Omit the tests that are not set up."""

    circle: Circle | None = None
    hemisphere: Hemisphere | None = None
    repeatability: Repeatability | None = None
    touch: Touch | None = None
    iso9283: Iso9283 | None = None

    @property
    def distances(self) -> tuple[KnownSocketDistance, ...]:
        return self.touch.distances if self.touch else ()

    def with_distances(self, distances: Iterable[KnownSocketDistance]) -> Tests:
        if self.touch is None:
            return self
        kept = tuple(distance for distance in distances if {*distance.between} <= {*self.touch.sockets})
        return self.model_copy(update={"touch": self.touch.model_copy(update={"distances": kept})})


NEAR_DEG = 0.5
"""Largest distance of each joint from a posture for the robot to be there. Programs return to within 0.02°."""
STILL_DEG = 0.02
"""Joint motion per second that counts as standstill. Encoder noise is smaller, and the slowest circle is faster."""
STOOD_S = 0.3
"""Minimum time at standstill. A robot passing the start posture stays for less."""
_LEAST_MOVE_DEG = 4 * NEAR_DEG


class When(Part):
    """Start condition of a recording: a signal value or a motion."""

    signal: int | None = Field(default=None, ge=-(2**31), lt=2**31)
    from_deg: Posture | None = None
    """Posture before the motion."""
    to_deg: Posture | None = None
    """Posture after a few degrees of motion, which distinguishes cw from acw."""

    @model_validator(mode="after")
    def _one_kind(self) -> When:
        if (self.from_deg is None) != (self.to_deg is None):
            raise ValueError("a motion needs both from_deg and to_deg; rig automatic RUN writes them")
        if (self.signal is None) == (self.from_deg is None):
            raise ValueError("give either signal, or from_deg and to_deg")
        if self.from_deg and self.to_deg and largest_difference_deg(self.from_deg, self.to_deg) < _LEAST_MOVE_DEG:
            raise ValueError(f"to_deg is less than {_LEAST_MOVE_DEG:g}° from from_deg; give a more distant posture")
        return self

    def overlaps(self, when: When) -> bool:
        if self.from_deg and self.to_deg and when.from_deg and when.to_deg:
            reach = (math.dist(self.from_deg, self.to_deg) + math.dist(when.from_deg, when.to_deg)) / 2
            same_start = largest_difference_deg(self.from_deg, when.from_deg) <= 2 * NEAR_DEG
            return same_start and math.dist(self.to_deg, when.to_deg) < reach
        return self.signal is not None and self.signal == when.signal


class Rule(Part):
    """An event of the robot, and the recording started by it."""

    when: When
    test: DrivenTest
    direction: Direction | None = None
    still_s: float = Field(default=2.0, ge=0.2, le=3600)
    """Standstill that ends the run. After a signal it counts from the end of the signal."""

    @model_validator(mode="after")
    def _directed(self) -> Rule:
        if self.test in CIRCLES and self.direction is None:
            raise ValueError(f"a {self.test} test needs a direction; add direction: cw or acw")
        if self.test not in CIRCLES and self.direction is not None:
            raise ValueError(f"a {self.test} test has no direction; remove the key")
        return self

    @property
    def title(self) -> str:
        return f"{self.test} {self.direction}" if self.direction else self.test

    @property
    def event(self) -> str:
        return f"{'a motion' if self.when.signal is None else f'signal {self.when.signal}'}: {self.title}"


class Automatic(Part):
    """Rules for automatic recordings."""

    rules: Annotated[tuple[Rule, ...], Field(min_length=1, max_length=100)]

    @model_validator(mode="after")
    def _distinct(self) -> Automatic:
        numbered = combinations(enumerate(self.rules, 1), 2)
        pairs = [f"{i} and {j}" for (i, rule), (j, second_rule) in numbered if rule.when.overlaps(second_rule.when)]
        if pairs:
            raise ValueError(f"rules {', '.join(pairs)} wait for the same event; use different signals")
        return self

    def lacking(self, *, signal: bool, gauges: int) -> list[str]:
        unheard = [str(number) for number, rule in enumerate(self.rules, 1) if rule.when.signal is not None]
        paired = [str(number) for number, rule in enumerate(self.rules, 1) if rule.test in CIRCLES]
        lacks = []
        if unheard and not signal:
            one_that_can = "choose a feedback with a key signal, or a line_feed with that field"
            lacks.append(f"rule {', '.join(unheard)} waits for a signal, but the feedback has none: {one_that_can}")
        if paired and gauges < 2:
            lacks.append(f"rule {', '.join(paired)} needs two gauges: add gauges.g2")
        return lacks


class Retention(Part):
    """Time and size limits for exported runs. Other runs are never deleted."""

    days: float | None = Field(default=None, ge=1, le=36500)
    gigabytes: float | None = Field(default=None, ge=0.001, le=1e6)

    @model_validator(mode="after")
    def _some_limit(self) -> Retention:
        if self.days is None and self.gigabytes is None:
            raise ValueError("give days, gigabytes or both; omit retention to keep everything")
        return self


def largest_difference_deg(a_deg: Sequence[float], b_deg: Sequence[float]) -> float:
    return max(abs(a - b) for a, b in zip(a_deg, b_deg, strict=True))

"""The tests that a rig is set up for (measurement.md): circle for yaw and roll, hemisphere, repeatability."""

from __future__ import annotations

from pydantic import Field, field_validator, model_validator

from rigs.base import Part, Vector
from rigs.robot import Row


class Circle(Part):
    """A circle about the base-ball, driven acw and cw with the tool pointing at its centre."""

    centre_mm: Vector
    normal: Vector = (0.0, 0.0, 1.0)
    zero: Vector = (1.0, 0.0, 0.0)
    """Where phi = 0 lies; projected onto the circle's plane."""
    radius_mm: float = Field(default=70.0, gt=0)
    speed_mm_s: float = Field(default=25.0, gt=0)
    start_deg: float = 0.0
    lead_deg: float = Field(default=10.0, ge=0, le=90)
    """Arc driven before the lap to come to speed, and after it to stop; not analysed."""
    posture_deg: Row
    """Joint angles near the start of the acw circle: which of the arm's solutions the program uses."""
    eccentricity_mm: Vector = (0.0, 0.0, 0.0)
    """Base-ball less circle centre, in the world: known only where the cell is emulated or simulated."""

    @field_validator("normal")
    @classmethod
    def _has_length(cls, value: Vector) -> Vector:
        if sum(x * x for x in value) == 0:
            raise ValueError("a direction of length zero points nowhere")
        return value

    @model_validator(mode="after")
    def _zero_in_plane(self) -> Circle:
        (a, b, c), (x, y, z) = self.normal, self.zero
        cross = (b * z - c * y, c * x - a * z, a * y - b * x)
        if sum(v * v for v in cross) < 1e-12 * sum(v * v for v in self.normal):
            raise ValueError("zero is parallel to normal; choose a direction in the circle's plane")
        return self


class Hemisphere(Part):
    """Targets on a half sphere about the base-ball, each with several tool orientations."""

    centre_mm: Vector
    normal: Vector = (0.0, 0.0, 1.0)
    """Points to the middle of the hemisphere, towards the robot's working side: polar angle 0."""
    zero: Vector = (1.0, 0.0, 0.0)
    """Where azimuth 0 lies; projected onto the hemisphere's base."""
    radius_mm: float = Field(default=400.0, gt=0)
    step_deg: float = Field(default=30.0, gt=0, le=90)
    """Between targets, in polar angle and in azimuth."""
    polar_max_deg: float = Field(default=90.0, gt=0, le=180)
    """Where the outermost ring lies."""
    orientations: int = Field(default=3, ge=1)
    posture_deg: Row


class Repeatability(Part):
    """Targets of the hemisphere approached from outside and from inside along the radius."""

    approach_mm: float = Field(default=3.0, gt=0)
    rounds: int = Field(default=3, ge=1)
    targets: tuple[int, ...] = (1,)
    """Numbers of hemisphere targets, counted from 1."""


class Tests(Part):
    """The tests of a rig; leave out what it is not set up for."""

    circle: Circle | None = None
    hemisphere: Hemisphere | None = None
    repeatability: Repeatability | None = None

"""The part of the readings that no name explains, as values: what remains of places, and what it follows."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

Subject = Literal["posture", "approach", "time", "temperature", "speed"]


@dataclass(frozen=True)
class Looked:
    """A subject compared with the residual: `share` is the explained part of the mean square at left-out places,
    None if these runs do not contain the subject."""

    subject: Subject
    share: float | None


@dataclass(frozen=True)
class Remains:
    """Residual of each neighbourhood of places for a model fitted to all others, rms in µm of a distance; the noise
    of a reading; and the subjects compared."""

    um: float
    noise_um: float
    looked: tuple[Looked, ...]


What = Literal["angle", "load", "approach", "speed", "time", "place"]
"""Possible dependence of the unexplained part: angle of a joint, torque of gravity, approach side, speed; time;
place of the target."""
FOLLOWED = 0.2
"""Share from which the unexplained part is said to follow a subject. Chosen: the best of twenty subjects explains up
to a tenth of plain noise of 40 poses."""


@dataclass(frozen=True)
class Followed:
    """A dependence of the unexplained part: the subject, the joint (None for time and place), and the share of the
    variance explained at left-out places."""

    what: What
    axis: int | None
    share: float


@dataclass(frozen=True)
class Unexplained:
    """Part explained by no name and no usual error, rms in µm, and the subjects that it `follows`, the likeliest
    first. `scatter_um` is the scatter of a coordinate of poses if scatter explains the part and no target was
    visited twice; else None. `visits_um` is the rms distance between a visit of a target and the mean of its visits if
    it exceeds the repeatability of such arms; else None."""

    rms_um: float
    follows: tuple[Followed, ...] = ()
    scatter_um: float | None = None
    visits_um: float | None = None

    @property
    def likeliest(self) -> Followed | None:
        """The certain dependence, if any."""
        return next((followed for followed in self.follows if followed.share >= FOLLOWED), None)

    def to_dict(self) -> dict[str, Any]:
        """In plain types."""
        return asdict(self)

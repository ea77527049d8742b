"""The unexplained part of the readings as values: residual of places, and possible dependences."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

Subject = Literal["posture", "approach", "time", "temperature", "speed"]


@dataclass(frozen=True)
class ResidualCheck:
    """A quantity compared with the residual. `share`: explained part of the mean square at validation places; None
    if these runs do not contain the quantity.
    """

    subject: Subject
    share: float | None


@dataclass(frozen=True)
class ResidualSummary:
    """Residual of each neighbourhood of positions for a model fitted to all others, as rms distance in µm; noise of
    a reading; and the compared quantities.
    """

    um: float
    noise_um: float
    looked: tuple[ResidualCheck, ...]


What = Literal["angle", "load", "approach", "speed", "time", "place"]
"""Possible dependence of the unexplained part: angle of a joint, torque of gravity, approach side, speed; time;
place of the target."""
FOLLOWED = 0.2
"""Share from which the unexplained part is said to depend on a quantity. Chosen: the best of twenty quantities
explains up to a tenth of plain noise of 40 poses.
"""


@dataclass(frozen=True)
class Followed:
    """A dependence of the unexplained part: quantity, joint (None for time and place), and share of the variance
    explained at validation places.
    """

    what: What
    axis: int | None
    share: float


@dataclass(frozen=True)
class Unexplained:
    """Part explained by no named effect and no usual error, rms in µm, and the quantities on which it depends
    (`follows`), most likely first.

    `scatter_um`: scatter of a coordinate of poses if scatter explains the part and targets were visited only once;
    otherwise None. `visits_um`: rms distance between a visit of a target and the mean of its visits, or between a
    circle and the mean of its repeats, if it exceeds the usual repeatability of the build; otherwise None.
    `unrepeated_um`: rms deviation of targets from the calibrated model if no target was visited twice and usual scatter
    is smaller, so that it may be scatter or an error of an unknown cause; otherwise None. `gauges_um`: rms change of
    the difference of two gauges between repeated circles, if it is larger than movements of the tool; otherwise None.
    """

    rms_um: float
    follows: tuple[Followed, ...] = ()
    scatter_um: float | None = None
    visits_um: float | None = None
    unrepeated_um: float | None = None
    gauges_um: float | None = None

    @property
    def likeliest(self) -> Followed | None:
        """The certain dependence, if any."""
        return next((followed for followed in self.follows if followed.share >= FOLLOWED), None)

    def to_dict(self) -> dict[str, Any]:
        """Return plain types."""
        return asdict(self)


def independent_um(um: float, part_um: float) -> float:
    """Return the remainder in µm of an rms after a part of it that is independent of the remainder is removed."""
    return math.sqrt(max(um**2 - part_um**2, 0.0))

"""What is left of the gap between model and readings as parts of the error are added to the model, one after the
other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from analysis.robot.kinematics.arm import Array


@dataclass(frozen=True)
class Left:
    """What a model leaves of the readings at a place, root mean square in µm, and its standard uncertainty."""

    um: float
    u_um: float


@dataclass(frozen=True)
class Step:
    """A model of the staircase. `parts` are the places of what it adds to the step before, in the budget of a diagnosis
    or among the effects of a rig file; the first step, of the model begun with, adds nothing. What it leaves is of the
    runs used, of held-out runs and of runs at a place that was not used, None where there are none."""

    parts: tuple[int, ...]
    used: Left
    held_out: Left | None = None
    unseen: Left | None = None

    def to_dict(self) -> dict[str, Any]:
        """In plain types, in µm."""
        at_places = {"used": self.used, "held_out": self.held_out, "unseen_place": self.unseen}
        return {
            "parts": self.parts,
            "left": {place: left_there and asdict(left_there) for place, left_there in at_places.items()},
        }


@dataclass(frozen=True)
class Staircase:
    """The steps, the first of the model begun with and the last of the calibrated model. `curves` are the residuals
    (steps, n, 2) µm of the two gauges of each circle at the circle angles of the curve of the diagnosis in the same
    place, and `maps` those (steps, n) µm at targets, each with the set-ups fitted."""

    steps: tuple[Step, ...]
    curves: tuple[Array, ...] = ()
    maps: tuple[Array, ...] = ()

    @property
    def places(self) -> tuple[str, ...]:
        """The places of which a step says what is left: `used`, `held_out`, `unseen`."""
        return tuple(place for place in ("used", "held_out", "unseen") if getattr(self.steps[0], place) is not None)

    def to_dict(self, names: Sequence[str]) -> list[dict[str, Any]]:
        """The steps in plain types, the parts by their names."""
        return [{**step.to_dict(), "parts": [names[k] for k in step.parts]} for step in self.steps]

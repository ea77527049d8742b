"""Residual of the gap between model and readings as parts of the error are added to the model step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from analysis.robot.kinematics.arm import Array


@dataclass(frozen=True)
class ModelResidual:
    """Residual of a model at a place, root mean square in µm, with standard uncertainty."""

    um: float
    u_um: float


@dataclass(frozen=True)
class StaircaseStep:
    """A model of the staircase. `parts`: indices of the parts added in this step, in the budget of a diagnosis or
    among the effects of a rig file; empty for the initial model. The residuals refer to the runs used, to
    held-out runs, and to runs at an unseen place, None if not available.
    """

    parts: tuple[int, ...]
    used: ModelResidual
    held_out: ModelResidual | None = None
    unseen: ModelResidual | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain types, in µm."""
        at_places = {"used": self.used, "held_out": self.held_out, "unseen_place": self.unseen}
        return {
            "parts": self.parts,
            "left": {place: left_there and asdict(left_there) for place, left_there in at_places.items()},
        }


@dataclass(frozen=True)
class Staircase:
    """The steps from the initial to the calibrated model. `curves`: residuals (steps, n, 2) µm of the two gauges of
    each circle at the circle angles of the curves of the diagnosis. `maps`: residuals (steps, n) µm at targets.
    All are with fitted set-ups.
    """

    steps: tuple[StaircaseStep, ...]
    curves: tuple[Array, ...] = ()
    maps: tuple[Array, ...] = ()

    @property
    def places(self) -> tuple[str, ...]:
        """Places with residuals: `used`, `held_out`, `unseen`."""
        return tuple(place for place in ("used", "held_out", "unseen") if getattr(self.steps[0], place) is not None)

    def to_dict(self, names: Sequence[str]) -> list[dict[str, Any]]:
        """Return the steps in plain types, with part names."""
        return [{**step.to_dict(), "parts": [names[k] for k in step.parts]} for step in self.steps]

"""Effects that a diagnosis finds, with their probability, size and rivals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from analysis.diagnosis.evidence.significance import SURE_SIGMA
from analysis.diagnosis.judge.acts import Doubt
from analysis.diagnosis.judge.alternatives import Alternative
from analysis.procedures.shared.quantity import parameters_of
from rigs.effects import Effect
from rigs.schema.effect import SEATS, name_of

_DIFFERS = 0.5
"""Difference of the shares of two set-ups above which they contradict a named effect, if certain. Chosen: several times
those of true faults.
"""


@dataclass(frozen=True)
class Share:
    """Size of a named effect in a single set-up as a share of the fitted size."""

    setup: str
    value: float
    sd: float


@dataclass(frozen=True)
class Rival:
    """Alternative to a named effect, with its `probability`."""

    effect: Effect
    sd: dict[str, float]
    probability: float
    is_fault: bool = False
    """Whether the rival would be a fault: larger than in arms of the same build."""

    def to_dict(self) -> dict[str, Any]:
        return plain_effect(self.effect, self.sd, self.probability)


PRESENT: tuple[Doubt | None, ...] = (None, "usual")
"""Doubts with which an effect is nevertheless present."""


@dataclass(frozen=True)
class Named:
    """An effect missing in the model, as found by a diagnosis."""

    effect: Effect
    sd: dict[str, float]
    """Standard uncertainty of each parameter, in the unit of the parameter."""
    probability: float
    """Calibrated probability that the effect exists (docs/probability.md)."""
    rivals: tuple[Rival, ...]
    gap_without_um: float
    """RMS residual on the runs used if only this effect is removed from the model."""
    remedy: str
    contribution_um: float
    """RMS change of the readings caused by the effect, without the part that a set-up absorbs."""
    held_out_gain: float | None
    """Share of the squared residual that the effect removes on held-out runs; None if none shows it."""
    doubt: Doubt | None = None
    """Reason why the effect is not confirmed as a fault."""
    shares: tuple[Share, ...] = ()
    u_um: float = 0.0
    """Standard uncertainty of `contribution_um`."""
    times_usual: float | None = None
    """Size relative to a healthy arm; None if a healthy size is invisible."""
    alone_um: float = math.nan
    """RMS residual on the runs used if only this effect is added to the model."""
    twins: tuple[Effect, ...] = ()
    """Effects indistinguishable from this one, so only their sum is known."""
    shown: bool = True
    """False if the readings cannot identify the cause, such as a wave with fewer than two driven periods."""
    alternatives: Mapping[Alternative, float] = field(default_factory=dict)
    """Probability of each alternative; together with `probability` they sum to 1."""
    log_odds: float | None = None
    """Log odds against all alternatives before their calibration; None for a vibration."""

    @property
    def is_confirmed(self) -> bool:
        """True if the effect is confirmed as a fault."""
        return self.doubt is None

    @property
    def unknown(self) -> float:
        """Probability that a cause unknown to rig imitates this effect, alone or together with others."""
        return self.alternatives.get("unknown", 0.0) + self.alternatives.get("several", 0.0)

    @property
    def contradicted(self) -> bool:
        """True if set-ups show clearly different sizes, so that the effect imitates another cause."""
        if not self.shares:
            return False
        least, most = (of(self.shares, key=lambda share: share.value) for of in (min, max))
        return most.value - least.value > max(_DIFFERS, SURE_SIGMA * math.hypot(least.sd, most.sd))

    def to_dict(self) -> dict[str, Any]:
        """Plain types, including the rivals."""
        return {
            **plain_effect(self.effect, self.sd, self.probability),
            "rivals": [rival.to_dict() for rival in self.rivals],
            "worth_um": self.contribution_um,
            "u_um": self.u_um,
            "times_usual": self.times_usual,
            "stands": self.is_confirmed,
            "doubt": self.doubt,
            "log_odds": self.log_odds,
            "alternatives": dict(self.alternatives),
            "alone_um": self.alone_um,
            "twins": [name_of(twin) for twin in self.twins],
            "held_out_gain": self.held_out_gain,
            "contradicted": self.contradicted,
            "shares": {share.setup: {"value": share.value, "sd": share.sd} for share in self.shares},
            "gap_without_um": self.gap_without_um,
            "remedy": self.remedy,
        }


def plain_effect(effect: Effect, sd: Mapping[str, float], posterior: float) -> dict[str, Any]:
    return {
        "effect": effect.effect,
        **{key: getattr(effect, key) for key in SEATS if hasattr(effect, key)},
        "name": name_of(effect),
        "parameters": {field: {"value": value, "sd": sd.get(field)} for field, value in parameters_of(effect).items()},
        "posterior": posterior,
    }

"""The answer of a diagnosis as values: the condition of the arm, its accuracy, and the budget of its error.

Words are made of them at the edge, for a screen, a page or another language; nothing decides by comparing words.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from rigs.schema.effect import PartKind
from rigs.schema.limits import Standing

Condition = Literal[
    "named", "ambiguous", "outside_library", "undecided", "uncalibrated", "nothing_unusual", "not_testable_here"
]
"""Whether something is worn, loose or shifted: effects are named; they are, but a rival may be meant; what explains the
readings is in no library; the runs are too few to decide it; many usual errors that a calibration was shown to remove;
nothing unusual; or the runs cannot show it."""
Rank = Literal["unusual", "usual", "undecided"]
"""Whether an effect is larger than healthy arms, and this arm elsewhere, show."""
Doubt = Literal["usual", "healthy_shows_it", "rival", "held_out", "unsure", "contradicted", "series", "no_better"]
"""Why the diagnosis does not stand by an effect: it is no larger than elsewhere in this arm or in healthy ones; a
healthy arm may show it by chance; a rival is likelier; it makes held-out runs worse; what it does is not known to half
of itself; set-ups show different shares of it; it is one of more waves than a joint has; or the model explains the runs
no better with it."""
Place = Literal["unseen", "held_out", "used"]
"""Where a figure was found: at another place, on held-out runs, or on the runs used."""


@dataclass(frozen=True)
class BudgetPart:
    """A part of the gap. `kind` is `effect` for a fitted effect, `scatter` for what differs from run to run,
    `unexplained`, or the kind of what many small terms make together; `axis` is their joint where they have one.

    `um` is its root mean square in the readings in µm, with set-ups fitted, and `u_um` the standard uncertainty of that
    change. `share` is its share of the gap's energy: shares add up to 1, and of what two parts have in common each has
    half, so that parts that cancel each other have negative shares. `times_usual` is how many times as much it does as
    a healthy arm shows, None where that has no meaning. `odds`, `held_out_gain` and `doubt` are those of a fitted
    effect, and `name` its name.
    """

    kind: PartKind | Literal["effect", "scatter", "unexplained"]
    um: float
    u_um: float
    share: float
    axis: int | None = None
    name: str = ""
    times_usual: float | None = None
    rank: Rank | None = None
    odds: float | None = None
    held_out_gain: float | None = None
    doubt: Doubt | None = None
    index: int | None = None
    """The index of the fitted effect among the effects of the diagnosis."""

    @property
    def sigma(self) -> float:
        """How many standard uncertainties it is away from nothing."""
        return self.um / self.u_um if self.u_um > 0 else float("inf")

    def to_dict(self) -> dict[str, Any]:
        """In plain types."""
        return {**asdict(self), "class": self.rank}


@dataclass(frozen=True)
class Accuracy:
    """The error of the arm now and after calibration, in µm of the readings.

    `standing` judges the error now against the limits of the rig file, a tolerance or the data sheet (`limit`), and is
    None where there is none. `now_um` and `now_largest_um` are of the runs used. `calibrated_um` is what the calibrated
    model left at the `place`: at places or runs that had no part in it, where there are any.
    """

    standing: Standing | None
    limit: Literal["tolerance", "rig_file", "data_sheet"] | None
    now_um: float
    now_largest_um: float
    calibrated_um: float
    before_there_um: float
    place: Place

    def to_dict(self) -> dict[str, Any]:
        """In plain types."""
        return {**asdict(self), "standing": self.standing or "not_judged"}

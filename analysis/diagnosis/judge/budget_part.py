"""Parts of the error of an arm: effects, groups of small terms, scatter, and the unexplained error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from analysis.diagnosis.evidence.significance import SURE_SIGMA
from analysis.diagnosis.judge.acts import Doubt
from analysis.diagnosis.judge.named import plain_effect
from analysis.diagnosis.judge.probability import CONFIRMED
from rigs.effects import Effect
from rigs.schema.effect import PartKind, size_field

Rank = Literal["unusual", "usual", "undecided", "difference"]
"""Whether an effect is larger than in healthy arms and than others in this arm. A `difference` is a link constant that
differs from the data sheet: no fault, at any size.
"""


LARGE_SHARE = 1 / 3
"""Share of the error from which the first sentence mentions a part, and a group lists its possible causes."""


_DOMINANT = 0.5
"""Share of a group above which a member may explain more than all others together."""


@dataclass(frozen=True)
class GroupMember:
    """A candidate effect for a group of small terms: fitted size, rms in µm within the group, and odds of being the
    dominant effect.
    """

    effect: Effect
    um: float
    odds: float
    u_um: float = 0.0
    share: float = 1.0
    """Share of the mean square of the group that the effect explains at its best size: alike small terms divide it."""

    @property
    def is_dominant(self) -> bool:
        """True if it may explain more than all others together; a certain small member does not cause the error."""
        return self.share > _DOMINANT

    @property
    def sd(self) -> dict[str, float]:
        """Standard uncertainty of the size, in proportion to that of the rms; empty if unknown."""
        field = size_field(self.effect)
        return {field: abs(getattr(self.effect, field)) * self.u_um / self.um} if self.um > 0 else {}

    def to_dict(self) -> dict[str, Any]:
        return plain_effect(self.effect, self.sd, self.odds) | {"um": self.um, "u_um": self.u_um, "share": self.share}


@dataclass(frozen=True)
class BudgetPart:
    """A part of the gap: a fitted `effect`, `scatter` between runs, `unexplained`, or a group of small terms."""

    kind: PartKind | Literal["effect", "scatter", "unexplained"]
    um: float
    """Root mean square in the readings with set-ups fitted."""
    u_um: float
    share: float
    """Share of the energy of the gap. Shares add up to 1 and are never negative; two parts divide a common
    contribution equally, and a part that cancels another is counted with it.
    """
    axis: int | None = None
    """Joint of an effect or a group, if it has one."""
    name: str = ""
    times_usual: float | None = None
    """Ratio to a healthy arm; None if undefined."""
    rank: Rank | None = None
    odds: float | None = None
    held_out_gain: float | None = None
    doubt: Doubt | None = None
    index: int | None = None
    """Index of the fitted effect among the effects of the diagnosis."""
    members: tuple[GroupMember, ...] = ()
    """Candidate effects of a group with more than a third of the gap, likeliest first."""
    together: tuple[BudgetPart, ...] = ()
    """Parts that partly cancel each other and are counted together, each with the individual size, this part first."""

    @property
    def cancelled(self) -> tuple[str, ...]:
        return tuple(part.label for part in self.together[1:])

    @property
    def shown_together(self) -> tuple[BudgetPart, ...]:
        """This part and the parts that cancel over 5 % of it and over twice their uncertainty; empty without any."""
        large = [part for part in self.together[1:] if part.um > max(2 * part.u_um, self.together[0].um / 20)]
        return (self.together[0], *large) if large else ()

    @property
    def label(self) -> str:
        return self.name or (f"{self.kind} {self.axis}" if self.axis else self.kind)

    @property
    def cause(self) -> GroupMember | None:
        """The certain member of a group: the only dominant effect, with known contribution."""
        likeliest = self.likeliest
        is_cause = likeliest and likeliest.odds >= CONFIRMED and likeliest.um > SURE_SIGMA * likeliest.u_um
        return likeliest if is_cause else None

    @property
    def likeliest(self) -> GroupMember | None:
        """The likeliest member of a group, if it dominates the group."""
        likeliest = next(iter(self.members), None)
        return likeliest if likeliest and likeliest.is_dominant else None

    @property
    def sigma(self) -> float:
        return self.um / self.u_um if self.u_um > 0 else float("inf")

    def to_dict(self) -> dict[str, Any]:
        parts = {name: [part.to_dict() for part in getattr(self, name)] for name in ("together", "members")}
        return {**vars(self), **parts, "class": self.rank, "cancelled": self.cancelled}

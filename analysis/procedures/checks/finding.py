"""Conventions, and findings of data that contradict them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from analysis.runs.loading import Measured
from analysis.runs.tabular import for_json

Strength = Literal["impossible", "decisive", "likely"]
"""impossible: no robot produces such data as labelled, and import refuses them. decisive: another meaning fits and
the labelled meaning does not; the figures are reported with a doubt, and no fault is named from them. likely: a
doubt."""


@dataclass(frozen=True)
class Misfit:
    """Residual of the readings, rms in mm, as labelled and as possibly meant, and the difference of the
    log-likelihoods in nats."""

    as_labelled_mm: float
    as_meant_mm: float
    log_likelihood: float


@dataclass(frozen=True)
class Finding:
    """An interpretation of the data that fits although the labelled interpretation does not.

    runs: names of the affected runs; columns: of the table; meant: possible content of those columns; what: the fact in
    words; remedy: the action; misfit: None if the fact is a count or a label.
    """

    convention: str
    strength: Strength
    columns: tuple[str, ...]
    meant: str
    what: str
    remedy: str
    misfit: Misfit | None = None
    runs: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """The fact and the remedy in a line."""
        return f"{self.what}; {self.remedy}"

    def to_dict(self) -> dict[str, Any]:
        """Plain types, None for unknown values."""
        plain: dict[str, Any] = for_json(
            {
                "convention": self.convention,
                "strength": self.strength,
                "runs": list(self.runs),
                "columns": list(self.columns),
                "meant": self.meant,
                "what": self.what,
                "remedy": self.remedy,
                "misfit": None if self.misfit is None else dict(vars(self.misfit)),
            }
        )
        return plain


@dataclass(frozen=True)
class Convention:
    """A convention checked against data.

    name: a word or two; asks: the question, in words; cannot: the reason why these runs cannot answer it, empty if they
    can.
    """

    name: str
    asks: str
    cannot: Callable[[Sequence[Measured]], str]

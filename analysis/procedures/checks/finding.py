"""What a convention is, and what is found where data speak against one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from analysis.runs.loading import Measured
from analysis.runs.tabular import for_json

Strength = Literal["impossible", "decisive", "likely"]
"""impossible: no robot gives such data as they are labelled, and import refuses them. decisive: another meaning fits
and the labelled one does not; the figures are given with a doubt, and no fault is named from them. likely: a doubt."""


@dataclass(frozen=True)
class Misfit:
    """What is left of the readings, rms in mm, as labelled and as they may have been meant, and by how much the latter
    is likelier: the difference of the log-likelihoods, in nats."""

    as_labelled_mm: float
    as_meant_mm: float
    log_likelihood: float


@dataclass(frozen=True)
class Finding:
    """One reading of the data that fits where the labelled one does not.

    runs: names of the runs that it is about; columns: of the table; meant: what those columns may hold; what: the fact
    in words; remedy: what to do; misfit: None where the fact is a count or a label.
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
        """The fact and what to do, in one line."""
        return f"{self.what}; {self.remedy}"

    def to_dict(self) -> dict[str, Any]:
        """In plain types, None for what is not known."""
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
    """A convention that data are held against.

    name: one word or two; asks: the question, in words; cannot: why these runs cannot answer it, empty where they can.
    """

    name: str
    asks: str
    cannot: Callable[[Sequence[Measured]], str]

"""Conventions, and findings of data that contradict them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from analysis.runs.loading import Measured
from analysis.runs.tabular import for_json

Strength = Literal["impossible", "decisive", "likely"]
"""Certainty of a finding.

impossible: no robot produces such data with this label; import refuses them. decisive: the labelled meaning does not
fit; figures are reported with a doubt, and no fault is derived from them. likely: a doubt.
"""


@dataclass(frozen=True)
class Misfit:
    """Residuals of the readings, rms in mm, with the labelled and with the alternative meaning, and the difference
    of the log-likelihoods in nats.
    """

    as_labelled_mm: float
    as_meant_mm: float
    log_likelihood: float


@dataclass(frozen=True)
class Finding:
    """Evidence that the data have a different meaning from the labelled one.

    runs: names of the affected runs. columns: affected columns of the table. meant: probable content of these columns.
    what: observation as text. remedy: action. misfit: residuals; None if the observation is a count or a label.
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
        """Return the observation and the remedy in one line."""
        return f"{self.what}; {self.remedy}"

    def to_dict(self) -> dict[str, Any]:
        """Return plain types, with None for unknown values."""
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

    name: one or two words. asks: the question as text. cannot: reason why these runs cannot answer it; empty if they
    can.
    """

    name: str
    asks: str
    cannot: Callable[[Sequence[Measured]], str]

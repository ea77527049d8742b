"""Conventions, findings of data that contradict them, and outliers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from analysis.procedures.facts import labels_of
from analysis.robot.kinematics.arm import Array, Mask
from analysis.runs.loading import Measured
from analysis.runs.tables import Table
from analysis.runs.tabular import for_json
from rigs.text import listed

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
        return f"{self.what}; {self.remedy}"

    def to_dict(self) -> dict[str, Any]:
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


MOST_LISTED_ROWS = 40
"""Largest number of outliers that a message lists."""


@dataclass(frozen=True)
class Outliers:
    """Poses (n,) far from the arm, with their distances in mm (n,).

    They are excluded if they are accidents of the instrument, and kept if they are errors of the arm or of the labels.
    """

    far: Mask
    far_mm: Array
    by_accident: bool

    @property
    def wild(self) -> Mask:
        return self.far if self.by_accident else np.zeros_like(self.far)

    def words(self, table: Table) -> str:
        if self.by_accident or not self.far.any():
            return ""
        labels, rows = labels_of(table.test), listed(table.rows[self.far].tolist(), MOST_LISTED_ROWS)
        far = length_in_words(self.far_mm[self.far].max())
        fact = f"{self.far.sum()} of {len(self.far)} {labels.rows} are up to {far} {labels.distance_from}"
        return (
            f"{fact} (rows {rows}). They were kept, because so "
            "many, or all in one range of a joint, are not outliers; check that the robot was at rest, that instrument "
            "and base did not move, and the signs, order and zeros of the joints"
        )


def length_in_words(mm: float) -> str:
    return f"{mm / 1000:.2g} m" if mm >= 1000 else f"{mm:.3g} mm"

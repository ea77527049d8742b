"""A constant stated in the rig file that the readings contradict, as reported by a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.procedures.shared.quantity import Quantity


@dataclass(frozen=True)
class Contradiction:
    """A constant of the rig file, named by its key and the parts it belongs to, and the same according to the readings.

    The fit does not use it.
    """

    key: str
    names: tuple[str, ...]
    stated: Quantity
    by_readings: Quantity

    @property
    def difference(self) -> float:
        """The value according to the readings minus the stated value."""
        return self.by_readings.value - self.stated.value

    @property
    def sigma(self) -> float:
        """The difference in standard uncertainties."""
        return abs(self.difference) / float(np.hypot(self.by_readings.u, self.stated.u))

    def to_dict(self) -> dict[str, Any]:
        """Return plain types for JSON."""
        return {
            "key": self.key, "names": self.names, "unit": self.stated.unit, "sigma": self.sigma,
            "stated": {"value": self.stated.value, "u": self.stated.u},
            "by_readings": {"value": self.by_readings.value, "u": self.by_readings.u},
        }  # fmt: skip

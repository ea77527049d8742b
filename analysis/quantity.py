"""A figure and how well it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array

_SIGNS = {"deg": "°"}


@dataclass(frozen=True)
class Quantity:
    """value ± u, u the standard uncertainty (JCGM 100); unit as in the names of files and flags: mm, deg."""

    value: float
    u: float
    unit: str

    def __str__(self) -> str:
        """Rounded to two digits of the uncertainty: `0.33022 ± 0.00092 °`."""
        return f"{self.rounded(self.value)} ± {self.rounded(self.u)} {_SIGNS.get(self.unit, self.unit)}"

    def rounded(self, value: float) -> str:
        """A value to the digits that this figure's uncertainty leaves."""
        digits = 4 if not 0 < self.u < np.inf else max(0, 1 - int(np.floor(np.log10(self.u))))
        return f"{value:.{digits}f}"


def from_draws(value: float, draws: Array, unit: str) -> Quantity:
    """A figure whose uncertainty is the spread of Monte Carlo draws (m,) of it (JCGM 101)."""
    return Quantity(float(value), float(np.std(draws, ddof=1)), unit)

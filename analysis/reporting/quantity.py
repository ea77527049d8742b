"""A figure and how well it is known."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array
from analysis.noise.cell import NoiseSource

_SIGNS = {"deg": "°", "deg/Nm": "°/Nm", "hz": "Hz"}
_EXCESS_SHARE = 0.2


@dataclass(frozen=True)
class Quantity:
    """value ± u, u the standard uncertainty (JCGM 100); unit as in the names of files and flags: mm, deg.

    samples: how many readings are behind it, 0 where nobody counted; noise: where the noise in u comes from.
    """

    value: float
    u: float
    unit: str
    samples: int = 0
    noise: NoiseSource = "measured"

    def __str__(self) -> str:
        """Rounded to two digits of the uncertainty: `0.33022 ± 0.00092 °`."""
        return f"{self.rounded(self.value)} ± {self.rounded(self.u)} {self.sign}".rstrip()

    @property
    def sign(self) -> str:
        """The unit as people write it."""
        return _SIGNS.get(self.unit, self.unit)

    def rounded(self, value: float) -> str:
        """A value to the digits that this figure's uncertainty leaves."""
        digits = 4 if not 0 < self.u < np.inf else max(0, 1 - int(np.floor(np.log10(self.u))))
        return f"{value:.{digits}f}"


def from_draws(value: float, draws: Array, unit: str, samples: int = 0) -> Quantity:
    """A figure whose uncertainty is the spread of Monte Carlo draws (m,) of it (JCGM 101)."""
    u = float(np.std(draws, ddof=1))
    return Quantity(float(value), 0.0 if u <= 1e-12 * abs(value) else u, unit, samples)


def figures_of(
    values: Mapping[str, float | Array],
    draws: Mapping[str, Array],
    samples: int,
    noisy: Mapping[str, float] | None = None,
) -> dict[str, Quantity]:
    """Figures by name, which ends in the unit, from their values and Monte Carlo draws (m,).

    noisy: for a maximum or a range, which noise makes too large, its mean over the same draws without their noise.
    By how much the draws lie above it on average, the value is lowered; that correction is taken as known
    to a fifth of itself, since the noise-free curve that it starts from is not known either. Names in `_at_deg` are
    places on a circle: 359° lies 2° from 1°.
    """
    figures = {}
    for name, plain in values.items():
        value = float(plain)
        spread = draws[name]
        if name.endswith("_at_deg"):
            spread = (spread - value + 180.0) % 360.0 - 180.0
            u = float(np.std(spread, ddof=1))
            figures[name] = Quantity(value, u, "deg", samples)
            continue
        excess = float(spread.mean()) - noisy[name] if noisy and name in noisy else 0.0
        figure = from_draws(value - excess, spread, name.rsplit("_", 1)[1], samples)
        u = float(np.hypot(figure.u, _EXCESS_SHARE * excess))
        figures[name] = dataclasses.replace(figure, u=u)
    return figures

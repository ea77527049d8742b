"""A value with its uncertainty: a figure, or a parameter of an effect."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.cell_noise import NoiseSource
from rigs.effects import Effect
from rigs.schema.effect import SEATS, label_of, size_field

_TWO_SIGMA = 0.9545
"""Probability within two standard deviations of a normal distribution."""
_EXACT = 1e-9
"""Above the rounding error of a logarithm, so that 0.1 counts as 10⁻¹."""
_FINEST_MM = 4
"""Decimals of a displayed length: 0.1 um, the finest gauge step known to rig (docs/rig-file.md)."""
_FINEST_DEG = 5
"""Decimals of a displayed angle, and digits above 1 degree: 0.00001 degrees are 0.2 um at 1 m, and positions on the
circle are relevant to 0.01 degrees."""
_WITHOUT_U = 4
"""Decimals of a figure with unknown uncertainty."""
PLACE = "_at_deg"
"""Suffix of the names of circle positions."""
_SIGNS = {"a": "A", "c": "°C", "deg": "°", "deg/Nm": "°/Nm", "hz": "Hz"}


@dataclass(frozen=True)
class Quantity:
    """A value with its standard uncertainty u (JCGM 100).

    unit: unit of value and u, written as in file names and options, such as mm or deg.
    samples: number of readings, 0 if not counted.
    noise: origin of the noise included in u.
    """

    value: float
    u: float
    unit: str
    samples: int = 0
    noise: NoiseSource = "measured"

    def __str__(self) -> str:
        """Format the value with two digits of the uncertainty: `0.33022 ± 0.00092 °`. Digits finer than any
        instrument are omitted, and so is an unknown uncertainty.
        """
        if not np.isfinite(self.u):
            return f"{self.rounded(self.value)} {self.sign}".rstrip()
        return f"{self.rounded(self.value)} ± {self.rounded_u} {self.sign}".rstrip()

    @property
    def sign(self) -> str:
        """Unit as displayed, for example ° for deg."""
        return _SIGNS.get(self.unit, self.unit)

    def rounded(self, value: float) -> str:
        """A value with the digits of this figure."""
        digits = self._digits
        return f"{round(value, digits) + 0.0:.{max(0, digits)}f}"  # adding 0 turns −0 into 0

    @property
    def rounded_u(self) -> str:
        """The uncertainty with the digits of the value, rounded up if they show fewer than two (JCGM 100, 7.2.6)."""
        digits = self._digits
        if 0 < self.u < np.inf and digits < self._digits_of_u:
            return self.rounded(float(np.ceil(self.u * 10**digits - _EXACT)) / 10**digits)
        return self.rounded(self.u)

    def rounded_size(self, size: float) -> str:
        """A non-zero size with the digits of this figure, or as `< 0.0001` below the last digit."""
        digits = max(0, self._digits)
        return f"< {10.0**-digits:.{digits}f}" if 0 < abs(size) < 0.5 * 10.0**-digits else self.rounded(size)

    @property
    def _digits(self) -> int:
        if not 0 < self.u < np.inf:
            return _WITHOUT_U
        if self.unit == "mm":
            return min(self._digits_of_u, _FINEST_MM)
        if self.unit == "deg":
            whole = len(str(int(abs(self.value)))) if 1 <= abs(self.value) < np.inf else 0
            return min(self._digits_of_u, _FINEST_DEG - whole)
        return self._digits_of_u

    @property
    def _digits_of_u(self) -> int:
        two_digits = float(f"{self.u:.1e}")  # 0.0998 is 0.10, with its last digit one place further up
        return 1 - int(np.floor(np.log10(two_digits) + _EXACT))


def from_draws(value: float, draws: Array, unit: str, samples: int = 0, noise: NoiseSource = "measured") -> Quantity:
    """A figure with an uncertainty from Monte Carlo draws (m,) in any unit (JCGM 101).

    u is half of the symmetric interval containing 95.45 % of the draws, so that 2 u is correct for heavy tails too.
    """
    low, high = np.quantile(draws, ((1 - _TWO_SIGMA) / 2, (1 + _TWO_SIGMA) / 2))
    u = float(high - low) / 4
    return Quantity(float(value), 0.0 if u <= 1e-12 * abs(value) else u, unit, samples, noise)


def student_factor(freedom: float) -> float:
    """Ratio of the standard uncertainty of a mean to its standard deviation, for degrees of freedom.

    It is half of the 95.45 % quantile of Student's distribution, so that 2 u is correct for few runs.
    """
    from scipy.special import stdtrit  # noqa: PLC0415 - slow to import

    return float(stdtrit(freedom, (1 + _TWO_SIGMA) / 2)) / 2


def is_around_circle(name: str) -> bool:
    """True if a figure is an angle around the circle, where 359° is 2° from 1°: a position or a phase."""
    return name.endswith((PLACE, "shift_deg"))


def half_turns(angles_deg: Array) -> Array:
    return np.asarray((angles_deg + 180.0) % 360.0 - 180.0)


def figures_of(
    values: Mapping[str, float | Array],
    draws: Mapping[str, Array],
    samples: int,
    excess: Mapping[str, float] | None = None,
    excess_u: float = 0.0,
    noise: NoiseSource = "measured",
) -> dict[str, Quantity]:
    """Figures by name, ending in the unit, from values and Monte Carlo draws (m,).

    excess: mean noise bias of a range or maximum, by which the value is lowered, to zero at least; excess_u: relative
    uncertainty of this correction.
    """
    figures = {}
    for name, plain in values.items():
        value, spread = float(plain), draws[name]
        if is_around_circle(name):
            spread = value + half_turns(spread - value)
        if name.endswith(PLACE):
            u = float(np.quantile(np.abs(spread - value), _TWO_SIGMA)) / 2
            figures[name] = Quantity(value, u, "deg", samples, noise)
            continue
        figure = from_draws(value, spread, name.rsplit("_", 1)[1], samples, noise)
        if excess and name in excess:
            u = float(np.hypot(figure.u, excess_u * excess[name]))
            figure = dataclasses.replace(figure, value=max(value - excess[name], 0.0), u=u)
        figures[name] = figure
    return figures


def quantity_of(effect: Effect, field: str, sd: Mapping[str, float]) -> Quantity:
    """A parameter of an effect; the standard uncertainty is 0 if unknown."""
    return Quantity(float(getattr(effect, field)), sd.get(field, 0.0), effect.unit(field))


def parameters_of(effect: Effect) -> dict[str, float]:
    return {key: value for key, value in effect if key not in SEATS and isinstance(value, int | float)}


def parameter_label(effect: Effect, field: str) -> str:
    return label_of(effect) if field == size_field(effect) else f"{label_of(effect)} {field}"

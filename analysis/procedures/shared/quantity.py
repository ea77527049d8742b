"""A figure, or a parameter of an effect, and how well it is known."""

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
"""Probability within two standard deviations of the normal law."""
_EXACT = 1e-9
"""Above the rounding error of a logarithm, so that 0.1 counts as 10⁻¹."""
_FINEST_MM = 4
"""Decimals of a length that a reader uses: 0.1 um, the finest step of the gauges that rig knows (docs/rig-file.md)."""
_FINEST_DEG = 5
"""Decimals of an angle that a reader uses, and digits of one above 1 degree: 0.00001 degrees are 0.2 um at 1 m, and no
place on the circle is looked for more closely than 0.01 degrees."""
_WITHOUT_U = 4
"""Decimals of a figure whose uncertainty is not known."""
PLACE = "_at_deg"
"""Ending of the names of places on the circle."""
_SIGNS = {"a": "A", "c": "°C", "deg": "°", "deg/Nm": "°/Nm", "hz": "Hz"}


@dataclass(frozen=True)
class Quantity:
    """value ± u, u the standard uncertainty (JCGM 100); unit as in the names of files and flags: mm, deg.

    samples: how many readings are behind it, 0 where they were not counted; noise: where the noise in u comes from.
    """

    value: float
    u: float
    unit: str
    samples: int = 0
    noise: NoiseSource = "measured"

    def __str__(self) -> str:
        """Rounded to two digits of the uncertainty: `0.33022 ± 0.00092 °`; to fewer where no reader uses them, and
        without one that is not known."""
        if not np.isfinite(self.u):
            return f"{self.rounded(self.value)} {self.sign}".rstrip()
        return f"{self.rounded(self.value)} ± {self.rounded_u} {self.sign}".rstrip()

    @property
    def sign(self) -> str:
        """The unit as people write it."""
        return _SIGNS.get(self.unit, self.unit)

    def rounded(self, value: float) -> str:
        """A value to the digits that this figure's uncertainty, and its reader, leave."""
        digits = self._digits
        return f"{round(value, digits) + 0.0:.{max(0, digits)}f}"  # adding 0 turns −0 into 0

    @property
    def rounded_u(self) -> str:
        """The uncertainty to the same digits; upwards where these are too few for it (JCGM 100, 7.2.6)."""
        digits = self._digits
        if 0 < self.u < np.inf and digits < self._digits_of_u:
            return self.rounded(float(np.ceil(self.u * 10**digits - _EXACT)) / 10**digits)
        return self.rounded(self.u)

    def rounded_size(self, size: float) -> str:
        """A size that is not zero to the same digits: `< 0.0001` where these do not show it."""
        digits = max(0, self._digits)
        return f"< {10.0**-digits:.{digits}f}" if 0 < abs(size) < 0.5 * 10.0**-digits else self.rounded(size)

    @property
    def _digits(self) -> int:
        """Decimals with which this figure is written, negative for tens and hundreds."""
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
        """Decimals that show two digits of the uncertainty."""
        two_digits = float(f"{self.u:.1e}")  # 0.0998 is 0.10, with its last digit one place further up
        return 1 - int(np.floor(np.log10(two_digits) + _EXACT))


def from_draws(value: float, draws: Array, unit: str, samples: int = 0, noise: NoiseSource = "measured") -> Quantity:
    """A figure whose uncertainty is the spread of Monte Carlo draws (m,) of it (JCGM 101).

    It is half of what reaches 95.45 % of them to either side, so that 2 u does what it says for tails heavier than the
    normal law's too.
    """
    low, high = np.quantile(draws, ((1 - _TWO_SIGMA) / 2, (1 + _TWO_SIGMA) / 2))
    u = float(high - low) / 4
    return Quantity(float(value), 0.0 if u <= 1e-12 * abs(value) else u, unit, samples, noise)


def student_factor(freedom: float) -> float:
    """Return how many standard deviations of a mean its standard uncertainty is, for degrees of freedom: half of what
    reaches 95.45 % of Student's law to either side, so that 2 u does what it says of few runs."""
    from scipy.special import stdtrit  # noqa: PLC0415 - slow to import

    return float(stdtrit(freedom, (1 + _TWO_SIGMA) / 2)) / 2


def is_around_circle(name: str) -> bool:
    """Return whether a figure is an angle around the circle, where 359° lies 2° from 1°: a place or a phase."""
    return name.endswith((PLACE, "shift_deg"))


def half_turns(angles_deg: Array) -> Array:
    """Return angles (...,) in degrees as the same angles between -180 and 180."""
    return np.asarray((angles_deg + 180.0) % 360.0 - 180.0)


def figures_of(
    values: Mapping[str, float | Array],
    draws: Mapping[str, Array],
    samples: int,
    excess: Mapping[str, float] | None = None,
    excess_u: float = 0.0,
    noise: NoiseSource = "measured",
) -> dict[str, Quantity]:
    """Figures by name, which ends in the unit, from their values and Monte Carlo draws (m,).

    excess: by how much noise makes a range or a maximum too large on average; the value is lowered by it, never below
    zero, and the correction counts as known to excess_u of itself.
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
    """A parameter of an effect; its standard uncertainty is 0 where it is unknown."""
    return Quantity(float(getattr(effect, field)), sd.get(field, 0.0), effect.unit(field))


def parameters_of(effect: Effect) -> dict[str, float]:
    """Its numbers: sizes and shapes, and what it needs to be given, such as the order of a gear."""
    return {key: value for key, value in effect if key not in SEATS and isinstance(value, int | float)}


def parameter_label(effect: Effect, field: str) -> str:
    """The label of an effect, with the field where it is not its size."""
    return label_of(effect) if field == size_field(effect) else f"{label_of(effect)} {field}"

"""Signed readings that were read as unsigned: where a gauge passes zero, its value jumps by all counts of its type.

Of 16 bits and 0.001 mm a count, -0.019 mm is read as 65.517 mm.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_BITS = (8, 12, 16, 24, 32)
"""Widths of registers and of converters."""
_DECIMALS = range(7)
"""Counts of 1 mm to 1 nm. A gauge in other units states its scale."""
_MOST_SHARE = 0.1
"""Share of all counts that readings span at most once they are read as signed. Chosen: a gauge that travels further
passes many counts in between, and its readings leave no such gap."""
_FEWEST = 2
"""Different readings on either side: a single one may be an outlier."""
_EXACT = 1e-3
"""Tolerance of a jump in shares of the readings' span."""


@dataclass(frozen=True)
class UnsignedReadings:
    """Readings (n,) whose larger values are negative ones: the bits of the type, and where those values begin."""

    bits: int
    jump: float
    largest: float
    meant: float

    @property
    def words(self) -> str:
        """What happened, with the largest value and what it means."""
        return (
            f"a signed value was read as unsigned: readings jump by 2^{self.bits} counts ({self.jump:.6g}), so that "
            f"{self.largest:.6g} is {self.meant:.6g}"
        )

    @property
    def remedy(self) -> str:
        """The type to set in the rig file."""
        return f"set `type: int{self.bits}`"


def unsigned_readings(values: NDArray[np.float64], scales: Iterable[float] = ()) -> UnsignedReadings | None:
    """Return what readings (n,) show of a signed value that was read as unsigned; None if they do not. scales: counts
    in the unit of the readings, in addition to decimal ones."""
    seen = np.unique(values[np.isfinite(values)])
    if len(seen) < 2 * _FEWEST:
        return None
    gaps = np.diff(seen)
    edge = int(np.argmax(gaps))
    lower, upper = seen[: edge + 1], seen[edge + 1 :]
    if min(len(lower), len(upper)) < _FEWEST:
        return None
    for bits in _BITS:
        for scale in (*(abs(scale) for scale in scales), *(10.0**-digits for digits in _DECIMALS)):
            jump = scale * 2**bits
            if _is_wrapped(lower, upper, jump, scale):
                return UnsignedReadings(bits, jump, float(upper[-1]), float(upper[-1] - jump))
    return None


def _is_wrapped(lower: NDArray[np.float64], upper: NDArray[np.float64], jump: float, count: float) -> bool:
    """Return whether the upper readings, less a jump, continue the lower ones below zero."""
    back = upper - jump
    span = max(float(lower[-1]), float(back[-1])) - min(float(lower[0]), float(back[0]))
    meets = float(lower[0]) - float(back[-1])
    steps = np.concatenate([np.diff(lower), np.diff(upper)])
    near = max(10 * float(np.median(steps)) if len(steps) else 0.0, 10 * count)
    return 0 < span <= _MOST_SHARE * jump and -_EXACT * span <= meets <= near and float(lower[0]) > -near

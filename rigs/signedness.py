"""Signed readings that were decoded as unsigned: when a gauge passes zero, the value jumps by the full range of the
type.

With 16 bits and 0.001 mm per count, -0.019 mm is read as 65.517 mm.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

_BITS = (8, 12, 16, 24, 32)
"""Widths of registers and of converters."""
_MODBUS_BITS = (16, 32)
"""Those that a rig file names as `type`."""
_DECIMALS = range(7)
"""Decimal digits of a count: 1 mm to 1 nm. A gauge in other units has a scale in the rig file."""
_MOST_SHARE = 0.1
"""Maximum span of the signed readings as a share of the full range: beyond it a gauge also reads in between."""
_FEWEST = 2
"""Minimum number of different readings on either side. A single reading may be an outlier."""
_EXACT = 1e-3
"""Tolerance of a jump as a share of the span of the readings."""


def unsigned_readings(values: NDArray[np.float64], scales: Iterable[float] = ()) -> tuple[str, str] | None:
    """Fact and remedy if readings (n,) contain signed values decoded as unsigned.

    scales: sizes of a count in the unit of the readings, in addition to decimal sizes.
    """
    values = values[np.isfinite(values)]
    if len(values) and (np.abs(values - (values.min() + values.max()) / 2) < _MOST_SHARE * np.ptp(values)).any():
        return None  # the two sides are far apart, so no reading lies in the middle; sorting is slow
    seen = np.unique(values)
    if len(seen) < 2 * _FEWEST:
        return None
    gaps = np.diff(seen)
    edge = int(np.argmax(gaps))
    lower, upper = seen[: edge + 1], seen[edge + 1 :]
    if min(len(lower), len(upper)) < _FEWEST:
        return None
    step = float(np.median(np.concatenate([np.diff(lower), np.diff(upper)])))
    for bits in _BITS:
        for scale in (*(abs(scale) for scale in scales), *(10.0**-digits for digits in _DECIMALS)):
            jump = scale * 2**bits
            if _is_wrapped(lower, upper, jump, 10 * max(step, scale)):
                fact = (
                    f"a signed value was read as unsigned: readings jump by 2^{bits} counts ({jump:.6g}), "
                    f"so {upper[-1]:.6g} means {upper[-1] - jump:.6g}"
                )
                modbus = f" (Modbus: `type: int{bits}`)" if bits in _MODBUS_BITS else ""
                return fact, f"decode it as a signed integer of {bits} bits{modbus}"
    return None


def _is_wrapped(lower: NDArray[np.float64], upper: NDArray[np.float64], jump: float, near: float) -> bool:
    first, last = float(upper[0] - jump), float(upper[-1] - jump)
    span = max(float(lower[-1]), last) - min(float(lower[0]), first)
    meets = float(lower[0]) - last
    return 0 < span <= _MOST_SHARE * jump and -_EXACT * span <= meets <= near and float(lower[0]) > -near

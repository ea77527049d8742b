"""Detection of gauge displays that show a wrong number.

Each number is plausible, and the proof is in their sequence: on a circle the distance changes smoothly.

- A *lost sign*: many instruments print the sign with the integer part, and -0.4 becomes 0.4. The readings are then
  reflected at zero: none lies between -1 and 0, and each crossing of zero is a kink with its corner at zero.
- *Saturation*: the readings arrive at the end of the range at full speed and stay there.
- A value that *sticks* in the middle of the range in the same way, and a later jump.
- A counter that *wraps*: jumps from one end of the range to the other, in the middle of a motion.
- A value that is *repeated* in place of a new one, between steps of the usual size. Figures hardly change by that.

The slopes decide: no smooth curve stops at full speed or turns in a corner. A reversal of a joint with play makes a
step or a corner too, but not at zero, and not one at each crossing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.procedures.shared.test_kind import Finding
from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.loading import Measured
from analysis.runs.noise.readings import robust_sd
from analysis.runs.tables import format_of
from rigs.text import first_of

DISPLAY = "display"
_WIDTH = 8
"""Smallest number of readings on each side that determine a slope. Chosen: a few degrees of a lap of 500 readings."""
_WIDTHS = 24
"""Largest number of widths that are tried, in a geometric series up to a twentieth of the readings. Chosen: a million
readings are tried in steps of 1.5, and 500 readings in steps of 1 or 2.
"""
_SAMPLE = 20_000
"""Number of readings from which the move over a width is estimated. Chosen: a median to 1 %."""
_CLEAR_SLOPE = 10.0
"""Change of the reading over the width of a slope, in standard deviations of a reading. Chosen: slopes to 10 %."""
_SHOWN = 2.0
"""Noise in steps of the display from which equal readings in succession are no accident: five have odds of 1e-4."""
_STEEP = 3.0
"""Slope, in steps of the display per reading, that no smooth curve has next to a standstill. Chosen: a parabola that
stays within one step for five readings has left it by at most one step a reading.
"""
_PLATEAU = 5
"""Smallest number of equal readings of a plateau."""
_CORNERS = 2
"""Corners at zero that prove a lost sign: a lap crosses zero at least twice, if at all."""
_SURE = 8.0
"""Standard deviations by which the slopes of a corner differ. Chosen: four corners in 1e4 readings of noise have 4."""
_WRAPPED = 0.9
"""Share of the range that a wrap jumps: the rest lies between two readings."""
_REPEATED = 0.2
"""Share of readings equal to the one before from which a gauge is read too often. Chosen: a lap has few at its ends."""
_MOST_LISTED = 3
_FEWEST = 60
"""Smallest number of readings in which a sequence is a curve: a lap read every six degrees."""


@dataclass(frozen=True)
class _Series:
    """Readings g_mm (n,) of a gauge in order of time, with their differences (n - 1,).

    step_mm: resolution, the smallest difference. usual_mm: median size of a difference. noise_mm: of a reading. width:
    number of readings from which a slope is determined.
    """

    g_mm: Array
    d_mm: Array
    step_mm: float
    usual_mm: float
    noise_mm: float
    width: int

    @classmethod
    def of(cls, g_mm: Array) -> _Series | None:
        d_mm = np.diff(g_mm)
        sizes = np.abs(d_mm[d_mm != 0])
        if len(g_mm) < _FEWEST or len(sizes) < _FEWEST // 2 or not np.isfinite(g_mm).all():
            return None
        noise_mm = robust_sd(np.abs(np.diff(d_mm))) / np.sqrt(6)
        most = max(_WIDTH, len(g_mm) // 20)
        widths = np.unique(np.geomspace(_WIDTH, most, _WIDTHS).round().astype(int)).tolist()
        some = max(1, len(g_mm) // _SAMPLE)
        moves = ((width, np.median(np.abs(g_mm[width::some] - g_mm[:-width:some]))) for width in widths)
        width = next((width for width, move in moves if move > _CLEAR_SLOPE * noise_mm), most)
        return cls(g_mm, d_mm, float(sizes.min()), float(np.median(sizes)), noise_mm, width)

    @property
    def repeated_share(self) -> float:
        """Share of the readings that repeat the one before although the display resolves the steps; 0 if usual."""
        share = float(np.mean(self.d_mm == 0))
        return share if share > _REPEATED and self.usual_mm > _STEEP * self.step_mm else 0.0

    def slope(self, first: int, last: int) -> float:
        """Slope in mm per reading of the readings first … last, at least two of them."""
        part = self.g_mm[max(first, 0) : last + 1]
        x = np.arange(len(part)) - (len(part) - 1) / 2
        return float(x @ part / (x @ x)) if len(part) > 1 else 0.0


def display_findings(run: Measured) -> Iterator[Finding]:
    if not run.table.swept:
        return
    for name, column in zip(format_of(run.table.test).gauges, run.table.readings.T, strict=False):
        series = _Series.of(column)
        if series is None:
            continue
        if share := series.repeated_share:
            fact = f"{name}_mm: {share:.0%} of the readings repeat the one before while the robot moves"
            remedy = "read the gauge at its own rate, or remove the repeated rows"
            yield Finding(DISPLAY, "likely", (f"{name}_mm",), "an earlier value", fact, remedy)
        for what, rows, remedy in _faults(series):
            fact = f"{name}_mm: {what} in {rows}"
            yield Finding(DISPLAY, "decisive", (f"{name}_mm",), "another value", fact, remedy)


def _faults(series: _Series) -> Iterator[tuple[str, str, str]]:
    """Each display fault with its rows and the remedy. A wrap or a lost sign explains what else is odd."""
    if len(wraps := _wraps(series)):
        size_mm = float(np.median(np.abs(series.d_mm[wraps])))
        counts = size_mm / series.step_mm
        power = f", 2^{round(np.log2(counts))} steps of the display" if _is_power_of_two(counts) else ""
        rows = _rows(wraps + 1, wraps + 1)
        remedy = "set the type of the value in the rig file, or zero the gauge, and repeat the run"
        yield f"the reading wraps by {size_mm:.6g} mm{power}", rows, remedy
        return
    if len(corners := _corners_at_zero(series)) >= _CORNERS:
        remedy = "zero the gauge so that it stays above 1 mm, or read it by another protocol, and repeat the run"
        yield (
            "the minus sign between -1 and 0 is lost: readings are reflected at 0",
            _rows(corners, corners),
            remedy,
        )
        return
    ends = (series.g_mm.min(), series.g_mm.max())
    begins, lasts = _plateaus(series)
    at_end = np.isin(series.g_mm[begins], ends)
    if at_end.any():
        rows = _rows(begins[at_end], lasts[at_end])
        remedy = "set the plunger to the middle of its range, and repeat the run"
        yield "the reading stays at the end of its range", rows, remedy
    if (~at_end).any():
        rows = _rows(begins[~at_end], lasts[~at_end])
        yield (
            "the reading sticks while the robot moves",
            rows,
            "clean the plunger, check the cable, and repeat the run",
        )


def _wraps(series: _Series) -> Integers:
    """Indices of jumps across the whole range, of which there are at least two.

    A reading that rises to the end of the range goes on rising from the other end. Reversals of play make steps of one
    size as well, but not from end to end, or the reading is nearly constant between them.
    """
    jumps = np.flatnonzero(np.abs(series.d_mm) > _WRAPPED * np.ptp(series.g_mm))
    if len(jumps) < 2 or len(jumps) > 0.1 * len(series.d_mm):
        return jumps[:0]
    for k in jumps.tolist():
        slopes = np.array([series.slope(k - series.width, k), series.slope(k + 1, k + 1 + series.width)])
        if not (-np.sign(series.d_mm[k]) * slopes > series.usual_mm / _WIDTH).all():
            return jumps[:0]
    return jumps


def _is_power_of_two(counts: float) -> bool:
    power = round(np.log2(counts)) if counts > 1 else 0
    return power >= 8 and abs(counts / 2.0**power - 1) < 0.01


def _corners_at_zero(series: _Series) -> Integers:
    """Indices of corners at zero, with all readings near zero on one side of it; otherwise empty.

    A reading below -1 shows its sign, and the step from 0.99 to -1.00 is a corner as well.
    """
    near_zero = series.g_mm[np.abs(series.g_mm) < 1]
    sign = -1.0 if len(near_zero) and np.median(near_zero) < 0 else 1.0  # negative with `counts: towards`
    g_mm, found = sign * series.g_mm, list[int]()
    if not len(near_zero) or ((g_mm < -3 * series.noise_mm - series.step_mm) & (g_mm > -1)).any():
        return np.empty(0, dtype=np.int64)
    width, n = series.width, len(g_mm)
    low = np.flatnonzero((g_mm[1:-1] <= g_mm[:-2]) & (g_mm[1:-1] <= g_mm[2:]) & (g_mm[1:-1] >= 0)) + 1
    near = low[g_mm[low] <= 2 * max(series.usual_mm, series.step_mm) + 3 * series.noise_mm]
    sd = max(series.noise_mm, series.step_mm / np.sqrt(12)) * np.sqrt(2 * 12 / width**3)
    for k in near.tolist():
        if k < 3 * width or k + 3 * width >= n or (found and k - found[-1] < width):
            continue
        before, after = (sign * series.slope(*ends) for ends in ((k - width, k - 1), (k + 1, k + width)))
        is_mirrored = before < 0 < after and abs(before + after) < 0.5 * (after - before)
        far = [sign * series.slope(k + side * 3 * width - width, k + side * 3 * width) for side in (-1, 1)]
        # In a smooth minimum the slope is nearly zero, and grows with the distance. In a corner it is not.
        is_corner = before < 0.6 * far[0] or after > 0.6 * far[1]
        if is_mirrored and is_corner and after - before > _SURE * sd:
            found.append(k)
    steps = np.flatnonzero((g_mm[:-1] > 0.9) & (g_mm[1:] < -0.9))
    return np.array(sorted({*found, *steps.tolist()}), dtype=np.int64)


def _plateaus(series: _Series) -> tuple[Integers, Integers]:
    """First and last indices of stretches of equal readings that no smooth curve has.

    They begin and end at full speed, or the noise would change the reading. If most readings are equal to the one
    before, the gauge was only read more often than it measures.
    """
    edges = np.flatnonzero(series.d_mm != 0)
    if len(edges) < len(series.d_mm) / 2:
        return edges[:0], edges[:0]
    begins, lasts = np.append(0, edges + 1), np.append(edges, len(series.g_mm) - 1)
    long = (lasts - begins + 1 >= _PLATEAU) & (begins >= _WIDTH) & (lasts + _WIDTH < len(series.g_mm))
    begins, lasts = begins[long], lasts[long]
    if series.noise_mm > _SHOWN * series.step_mm:
        return begins, lasts
    least = _STEEP * series.step_mm + 3 * series.noise_mm
    # Short slopes: a curve that bends into a minimum is slow over the last readings before it.
    entry = np.array([abs(series.slope(k - 3, k - 1)) for k in begins])
    leave = np.array([abs(series.slope(k + 1, k + 3)) for k in lasts])
    stops = np.minimum(entry, leave) > least
    return begins[stops], lasts[stops]


def _rows(begins: Integers, lasts: Integers) -> str:
    pairs = zip(begins.tolist(), lasts.tolist(), strict=True)
    return "rows " + first_of([f"{a + 1}" if a == b else f"{a + 1} to {b + 1}" for a, b in pairs], _MOST_LISTED)

"""The noise of real robot cells, as ranges assumed if a measurement does not determine the noise.

A range is a `LogUniform`: a standard deviation that is equally likely anywhere between two bounds on a logarithmic
scale. Robots: data-sheet repeatability after ISO 9283 (RP ± 10 µm of small arms, ± 20 to 50 µm of others; RT of paths
20 to 130 µm); two visits of a UR10 22 to 49 µm apart (Landgraf et al., CASE 2021); an ABB IRB 1600 up to 37 µm
(Slamani, Nubiola and Bonev, Robotica 2012); 0.261 mm of range in Oh 2019. Gauges: makers' data sheets.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

NoiseSource = Literal["measured", "borrowed", "assumed"]
"""The source of a noise level: measured from repeats in this run, borrowed from another run of the cell, or assumed
from this table."""


def least_known(sources: Iterable[NoiseSource]) -> NoiseSource:
    """Least certain of several sources, which applies to a figure based on all of them."""
    return max(sources, key=get_args(NoiseSource).index)


@dataclass(frozen=True)
class LogUniform:
    """A standard deviation that is log-uniform between `low` and `high`."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        return math.sqrt(self.low * self.high)

    @property
    def rms(self) -> float:
        return math.sqrt((self.high**2 - self.low**2) / (2 * math.log(self.high / self.low)))


WHITE_MM = LogUniform(0.0002, 0.003)
"""White noise of a gauge: probe, cable and mounting. The level differs between gauges and between runs."""
SLOW_MM = LogUniform(0.0005, 0.020)
"""Slow noise along a lap, for common and separate noise of the gauges: servo ripple, vibration, path repeatability
of data sheets."""
JOINT_DEG = LogUniform(0.0003, 0.005)
"""Scatter of the position of a joint between runs, from repeatability and the resolution of encoders."""
BALL_MM = LogUniform(0.001, 0.020)
"""Scatter of the position of the ball between runs, along each axis, from clamping and temperature."""
BALL_ELSEWHERE_MM = 3 * BALL_MM.high
"""Displacement of the ball between runs from which it must have been touched or remounted."""
TARGET_MM = LogUniform(0.003, 0.060)
"""Scatter between stops at a target, from ISO 9283 repeatability. Each target has a separate scatter, with heavy
tails."""
REPEATABILITY_MM = 0.1
"""Pose repeatability RP (ISO 9283) in data sheets of collaborative arms: Panda, and UR10 of the CB series. Those of
industrial arms state 0.02 to 0.08."""
RP_PER_SD = 3.6
"""RP per standard deviation of a coordinate: mean plus three standard deviations of the distance from the barycentre,
1.60 + 3 · 0.67 for equal scatter in three directions."""
SEAT_MM = 0.01
"""Standard uncertainty of a coordinate of a ball held by a magnet in a cone or on three balls. Kinematic seats
repeat to some micrometres; dust and oil contribute a hundredth of a millimetre."""
TIP_MM = 0.09
"""Standard deviation of a coordinate of a pointer guided into a punch mark by eye: the eye resolves one minute of arc,
0.09 mm at 300 mm."""
TRACKER_U_MM = 0.02
"""Standard uncertainty of a coordinate measured by a laser tracker at some metres, if a table does not state it."""
TRACKER_MM = 0.01
"""Standard deviation of the noise of a coordinate measured by a laser tracker at some metres."""
DRIFT_MM_PER_S = 0.020 / 600.0
"""Largest drift in either direction, from temperature and clamping: 20 µm in ten minutes."""
LEVELS_APART = 4.0
"""Largest ratio between the noise levels of two runs, or of two gauges, of a cell: 1 to 4 in real cells."""

"""The noise of real robot cells, as ranges: what is assumed where a measurement does not show its own.

A width is a `Between`: the standard deviation of some noise, equally likely anywhere between two bounds on a
logarithmic scale. Robots: data-sheet repeatability after ISO 9283 (RP ± 10 µm of small arms, ± 20 to 50 µm of others;
RT of paths 20 to 130 µm); two visits of a UR10 22 to 49 µm apart (Landgraf et al., CASE 2021); an ABB IRB 1600 up to 37
µm (Slamani, Nubiola and Bonev, Robotica 2012); 0.261 mm of range in Oh 2019. Gauges: makers' data sheets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

NoiseSource = Literal["measured", "borrowed", "assumed"]
"""Where a noise level comes from: from what this run repeats, from another run of the cell, or from this table."""


@dataclass(frozen=True)
class Between:
    """A standard deviation that is log-uniform between `low` and `high`."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        """Geometric mean of the bounds."""
        return math.sqrt(self.low * self.high)

    @property
    def rms(self) -> float:
        """Root of the mean variance, which is what counts for an uncertainty."""
        return math.sqrt((self.high**2 - self.low**2) / (2 * math.log(self.high / self.low)))


WHITE_MM = Between(0.0002, 0.003)
"""White noise of one gauge: probe, cable, mounting. Each gauge and each run has its own level."""
SLOW_MM = Between(0.0005, 0.020)
"""Slow noise along a lap, of both gauges and of each: servo ripple, vibration, path repeatability."""
JOINT_DEG = Between(0.0003, 0.005)
"""Where a joint lies from run to run."""
BALL_MM = Between(0.001, 0.020)
"""Where the ball lies from run to run, along each axis."""
TARGET_MM = Between(0.003, 0.060)
"""From stop to stop at one target; each target has its own, with heavy tails."""
DRIFT_MM_PER_S = 0.020 / 600.0
"""At most, either way: 20 µm in ten minutes, of temperature and clamping."""
LEVELS_APART = 4.0
"""Largest ratio between the noise levels of two runs, or of two gauges, of one cell."""

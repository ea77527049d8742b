"""The error around the circle as it grows: one curve for each direction, over 720 circle angles.

The error is what is left of the angle (of the distance, with one gauge) without its least-squares sine, as in
`analysis.measures.link_angle`. Before a lap is whole the sine is fitted to what there is; over less than half a lap it
would take the error with it, and only the mean is taken off.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from analysis.kinematics.arm import Array, Mask
from analysis.measures.lap_curve import at_resolution
from analysis.measures.link_angle import Sine, sine_of
from analysis.measures.reduction import PHI
from analysis.noise.spectrum import NODES

_WIDEST_RAD = float(np.radians(10.0))
"""A gap that is wider is not bridged: `rig analyse` accepts no wider one."""
_HALF = np.pi


@dataclass(frozen=True)
class ErrorCurve:
    """phi (n,) rad in order and error (n,) in rad or mm there. is_whole: over a whole lap, and then at the stated
    resolution; less_sine: whether the sine is off, else the mean alone; band: largest less smallest error, 0 where
    there is no curve."""

    phi: Array
    error: Array
    is_whole: bool
    less_sine: bool
    band: float


NO_CURVE = ErrorCurve(np.empty(0), np.empty(0), False, False, 0.0)


@dataclass(frozen=True)
class Sweep:
    """last (NODES,): what was measured last at each circle angle since the curve was begun, nan where nothing was."""

    last: Array = field(default_factory=lambda: np.full(NODES, np.nan))

    def after(self, phi: Array, values: Array) -> Sweep:
        """Return the sweep with newer values (n,) at circle angles phi (n,) rad, which take the place of older ones."""
        good: Mask = np.isfinite(phi) & np.isfinite(values)
        if not good.any():
            return self
        last = self.last.copy()
        last[(phi[good] / (2 * np.pi) * NODES).astype(np.int64) % NODES] = values[good]
        return replace(self, last=last)

    def curve(self) -> ErrorCurve:
        """Return the error over the circle angles that were measured."""
        measured = np.isfinite(self.last)
        if measured.sum() < 2:
            return NO_CURVE
        phi, values = PHI[measured] + np.pi / NODES, self.last[measured]
        gaps = np.diff(phi, append=phi[0] + 2 * np.pi)
        if gaps.max() <= _WIDEST_RAD:
            nodes = np.interp(PHI, phi, values, period=2 * np.pi)
            sine = Sine(*(float(part) for part in sine_of(nodes)))
            error = at_resolution(nodes - sine(PHI))
            return ErrorCurve(PHI, error, True, True, float(np.ptp(error)))
        less_sine = bool(gaps[gaps <= _WIDEST_RAD].sum() > _HALF)
        design = np.stack([np.ones_like(phi), np.sin(phi), np.cos(phi)], axis=1)[:, : 3 if less_sine else 1]
        error = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
        return ErrorCurve(phi, error, False, less_sine, float(np.ptp(error)))


def pieces(curve: ErrorCurve) -> list[slice]:
    """Return the stretches of a curve without gaps, in order; one that spans phi = 0 comes as two."""
    ends = [*(np.flatnonzero(np.diff(curve.phi) > _WIDEST_RAD) + 1).tolist(), len(curve.phi)]
    begins = [0, *ends[:-1]]
    return [slice(begin, end) for begin, end in zip(begins, ends, strict=True) if end - begin > 1]

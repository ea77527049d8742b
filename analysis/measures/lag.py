"""The lag of the gauges behind the robot's feedback, as an acw and a cw run of one circle show it.

Gauges stamped late show at each moment what was true a lag before: the curve is dragged along with the motion, forwards
in one direction and backwards in the other, so acw - cw holds twice the lag times the speed times the curve's
slope. Plays and friction reverse with the direction too, and their first harmonic cannot be distinguished from a
lag. What they leave in the others shows how large it may be: it is taken for a random part that falls with the
harmonic's number, as that of a step does, and it makes the uncertainty. So does the robot, which is never at quite the
same places in two runs. One direction alone shows nothing of it: there a lag turns the curve as another
place of the ball would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Array
from analysis.measures.lap_curve import LapCurve
from analysis.measures.quantity import Quantity
from analysis.noise.cell import BALL_MM, JOINT_DEG
from analysis.noise.spectrum import NODES

Complex = NDArray[np.complex128]
_HARMONICS = np.arange(1, 9)
_ROUNDS = 10
_MOVED_MM = float(np.hypot(BALL_MM.middle, 1000.0 * np.radians(JOINT_DEG.middle)))
"""How far a circle moves between runs: its ball, and a joint at the end of an arm of a metre."""


@dataclass(frozen=True)
class _Evidence:
    """One kind of curve: harmonics (h,) of acw - cw, and of what a lag of one second would put there; noise: the
    variance (h,) of their real and of their imaginary part without any play."""

    between: Complex
    of_lag: Complex
    noise: Array


def lag_of(pairs: Sequence[tuple[LapCurve, LapCurve]], radii_mm: Sequence[float], samples: int) -> Quantity:
    """The lag in ms, from curves of an acw and a cw run; several kinds (angle, distance) together determine it better.

    radii_mm: of each kind, what turns a move of the ball into its unit: 1 for a distance, the circle's for an angle.
    """
    kinds = []
    for (acw, cw), radius_mm in zip(pairs, radii_mm, strict=True):
        forth, back = _harmonics(acw.y), _harmonics(cw.y)
        speed, moved = abs(acw.rate) + abs(cw.rate), _MOVED_MM / radius_mm
        drawn = sum(np.mean(np.abs(_harmonics(curve.errors)) ** 2, axis=0) / 2 for curve in (acw, cw))
        of_lag = -speed * 1j * _HARMONICS * (forth + back) / 2
        kinds.append(_Evidence(forth - back, of_lag, (moved / _HARMONICS) ** 2 + drawn))
    spreads = [0.0] * len(kinds)
    value_s = u_s = 0.0
    for _ in range(_ROUNDS):
        weights = [1 / (spread / _HARMONICS**2 + kind.noise) for kind, spread in zip(kinds, spreads, strict=True)]
        information = sum(float(w @ np.abs(k.of_lag) ** 2) for w, k in zip(weights, kinds, strict=True))
        pull = sum(float(w @ (k.of_lag.conj() * k.between).real) for w, k in zip(weights, kinds, strict=True))
        if not information > 0:
            return Quantity(0.0, float("inf"), "ms", samples)
        value_s, u_s = pull / information, information**-0.5
        # The variance of the first harmonic of what reverses without being a lag.
        beyond = [np.abs(kind.between - value_s * kind.of_lag) ** 2 / 2 - kind.noise for kind in kinds]
        spreads = [float((np.maximum(power, 0.0) * _HARMONICS**2).mean()) for power in beyond]
    return Quantity(1e3 * value_s, 1e3 * u_s, "ms", samples)


def _harmonics(y: Array) -> Complex:
    """(..., h) complex of curves (..., NODES): y = sum of their real parts, each times exp(i h phi)."""
    both: Complex = 2 * np.fft.rfft(y)[..., _HARMONICS] / NODES
    return both

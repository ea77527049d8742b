"""Joint curves: the error of each joint as a function of its angle, visible in poses.

A curve is a sum of waves. The amplitudes of joint j have the standard deviation width_j · k^−decay for each whole order
k. Widths and decay maximise the likelihood of the readings (type-II maximum likelihood: MacKay, Neural Computation 4,
1992), with

d log p(readings) / d log v_i = ½ ((m_i − mean_i)² + A_ii) / v_i − ½

for a coefficient with prior variance v_i, posterior mean m_i and variance A_ii.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect
from rigs.schema.effect import is_wave, size_field
from rigs.schema.vocabulary import MOST_AXES

_WIDTH, _WIDTH_SPREAD = 0.5, 2.0
"""Prior width of a curve, in healthy sizes of a gear error, and the standard deviation of its logarithm. Chosen: a
tenth to four times a healthy gear is likely (UR10: ten times, with a decay of 1.0 to 1.1).
"""
_DECAY, _DECAY_SPREAD = 1.0, 0.5
"""Prior decay and its standard deviation: a self-similar curve has a decay of 1."""
_WIDTHS, _DECAYS = (1e-3, 20.0), (0.3, 2.0)
"""Bounds of widths and decay: otherwise the widths of the lowest orders, which resemble zeros and set-ups, diverge."""
_PIECE, _MOST_OF_A_PIECE = 0.25, 1.0
"""Share of a wave below which a joint shows only a zero and a slope, and the largest standard deviation of such a wave,
in healthy sizes: otherwise a zero became a curve.
"""
_WIDTH_OF_A_KIND, _MOST_OF_A_KIND = 1.0, 5.0
"""Expected and largest width of constants of the same kind, in healthy sizes: a larger constant is a fault."""
_OTHER_WIDTHS = (0.5, 2.0, 4.0, 8.0)
"""Ratios to the likeliest width of a curve over which the covariance is averaged."""
_ENOUGH, _MOST_FITS = 0.5, 40
"""Log likelihood required of a step for continuing the search, and the largest number of likelihoods."""


LogLikelihood = Callable[["JointCurves", Array], tuple[float, Array, Array]]
"""Function of curves and noise strengths (b,): log likelihood of the readings, and its derivatives by the logarithms of
the prior variances (c,) and of the strengths.
"""


def is_of_curve(effect: Effect) -> bool:
    return is_wave(effect) and effect.STAGE == "joint"


@dataclass(frozen=True)
class JointCurves:
    """Sizes of joint curves: widths in healthy sizes of a gear error, and decay of the amplitudes with the order.
    Widths of kinds of arm constants, if separate, follow those of the joints.
    """

    widths: tuple[float, ...]
    decay: float = _DECAY

    def others(self) -> Iterator[list[tuple[float, JointCurves]]]:
        """For each width, the curves with that width changed and their log prior relative to these curves."""
        for k, width in enumerate(self.widths):
            expected = np.log(_WIDTH_OF_A_KIND if k >= MOST_AXES else _WIDTH)
            away = np.log([width, *(width * ratio for ratio in _OTHER_WIDTHS)]) - expected
            log_prior = 0.5 * (away[0] ** 2 - away[1:] ** 2) / _WIDTH_SPREAD**2
            changed = [(*self.widths[:k], ratio * width, *self.widths[k + 1 :]) for ratio in _OTHER_WIDTHS]
            yield [(float(p), replace(self, widths=w)) for p, w in zip(log_prior, changed, strict=True)]


@dataclass(frozen=True, eq=False)
class CurveColumns:
    """Columns of joint curves: indices, joints from 0, orders, number of whole orders represented, and largest prior
    variances, each (c,).

    Constants with a separate width are waves of order 1 of additional joints, a joint per kind.
    """

    columns: NDArray[np.int64]
    joint: NDArray[np.int64]
    order: Array
    among: Array
    most: Array

    @property
    def count(self) -> int:
        return int(self.joint.max(initial=-1)) + 1

    def variance(self, curves: JointCurves) -> Array:
        return np.minimum(self._unbounded(curves), self.most)

    def _unbounded(self, curves: JointCurves) -> Array:
        return np.array(curves.widths)[self.joint] ** 2 * self.order ** (-2 * curves.decay) * self.among

    def fitted(
        self, start: JointCurves, strength: Array, limits: Array, log_likelihood: LogLikelihood
    ) -> tuple[JointCurves, Array]:
        """The likeliest curves and noise strengths (b,) within `limits` (2, b).

        Both are searched together: errors beyond small curves look like noise, which then keeps the curves small.
        """
        from scipy.optimize import minimize  # noqa: PLC0415 - slow to import

        joints = len(start.widths)
        kinds = np.arange(joints) >= MOST_AXES
        expected = np.append(np.log(np.where(kinds, _WIDTH_OF_A_KIND, _WIDTH)), _DECAY)
        spread = np.array([_WIDTH_SPREAD] * joints + [_DECAY_SPREAD])

        def cost(x: Array) -> tuple[float, Array]:
            curves = _curves(x[: joints + 1])
            likely, by_variance, by_strength = log_likelihood(curves, np.exp(x[joints + 1 :]))
            by_variance = np.where(self._unbounded(curves) < self.most, by_variance, 0.0)
            slope = np.append(np.bincount(self.joint, 2 * by_variance, joints), -2 * np.log(self.order) @ by_variance)
            away = (x[: joints + 1] - expected) / spread
            return 0.5 * float(away @ away) - likely, np.append(away / spread - slope, -by_strength)

        begin = np.concatenate([np.log(start.widths), [start.decay], np.log(strength)])
        widths = [(_WIDTHS[0], _MOST_OF_A_KIND if kind else _WIDTHS[1]) for kind in kinds]
        bounds = [*np.log(widths), _DECAYS, *np.log(limits.T)]
        enough = _ENOUGH / max(abs(cost(begin)[0]), 1.0)
        optimum = minimize(
            cost, begin, jac=True, method="L-BFGS-B", bounds=bounds, options={"ftol": enough, "maxfun": _MOST_FITS}
        )
        return _curves(optimum.x[: joints + 1]), np.exp(optimum.x[joints + 1 :])


def curve_columns(effects: Sequence[Effect], turned: Sequence[float] = (), *, apart: bool = False) -> CurveColumns:
    """Columns of joint curves among effects, for joints with ranges `turned` (axes) in turns. apart: include the arm's
    constants with separate widths.
    """
    indices = np.array([k for k, effect in enumerate(effects) if is_of_curve(effect)], dtype=np.int64)
    joint = np.array([getattr(effects[k], "axis", 1) - 1 for k in indices.tolist()], dtype=np.int64)
    order = np.array([float(getattr(effects[k], "order", 1.0)) for k in indices.tolist()])
    among = np.ones(len(indices))
    for j in np.unique(joint).tolist():
        orders = np.unique(order[joint == j])
        if len(orders) > 1:
            among[joint == j] = np.interp(order[joint == j], orders, np.gradient(orders))
    piece = [k < len(turned) and n * turned[k] < _PIECE for k, n in zip(joint.tolist(), order.tolist(), strict=True)]
    most = np.where(piece, _MOST_OF_A_PIECE**2, np.inf)
    if apart:
        # Angles, lengths and compliances each share a width: 0, 1 and 2.
        kinds: dict[int, int] = {}
        for k, effect in enumerate(effects):
            if effect.part == "gravity" and effect.STAGE == "joint":
                kinds[k] = 2
            elif effect.compensation().constant is not None:
                kinds[k] = int(effect.unit(size_field(effect)) == "mm")
        place = np.array(list(kinds), dtype=np.int64)
        indices = np.concatenate([indices, place])
        joint = np.concatenate([joint, MOST_AXES + np.array(list(kinds.values()), dtype=np.int64)])
        order, among = np.append(order, np.ones(len(place))), np.append(among, np.ones(len(place)))
        most = np.append(most, np.full(len(place), np.inf))
    return CurveColumns(indices, joint, order, among, most)


def _curves(x: Array) -> JointCurves:
    return JointCurves(tuple(np.exp(x[:-1]).tolist()), float(x[-1]))

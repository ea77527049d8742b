"""A parameter out of range: the error is larger than the limits of the search.

A search that cannot set a length to -30 mm sets it to -24 mm, and explains the rest by other, correct parameters. If
any size reaches the limit, or a constant comes near, each candidate is therefore fitted separately without a limit. If
such a fit explains the readings better than all the effects found within their limits, that parameter is wrong, and no
other effect is named. Waves are not candidates: they imitate any error of a joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.evidence.setups import FittedRuns
from analysis.diagnosis.fit.refine import ended_at_limit, size_limits
from analysis.diagnosis.fit.search import SearchResult
from rigs.effects import Effect, size_field
from rigs.schema.effect import identity, is_wave, name_of

_CANDIDATES = 4
"""Number of arm constants fitted separately: those with columns most similar to the residual. Chosen: in 13 simulated
cells the wrong constant was among the first two.
"""
_LARGE = 0.25
"""Share of the limit from which a constant is checked again: several large constants may share the response of one
beyond it.
"""
_EXPLAINS = 0.5
"""Largest share of the initial error that the parameter by itself may leave. Chosen: a zero wrong by 8° leaves 3 of
7000 µm; without this bound, a height hardly shown by a circle was named for 6 µm.
"""
_ALIKE = 1.05
"""Ratio of the residuals of two parameters up to which the readings do not distinguish them. Chosen."""
_TOLERANCE = 1e-3
"""Relative tolerance of a size at this stage; the later fit with all other terms determines it."""


@dataclass(frozen=True)
class OutOfRange:
    """The parameter out of range, with its estimated size, and its `twins`, which would explain the readings equally
    well.
    """

    effect: Effect
    twins: tuple[Effect, ...] = ()

    @property
    def name(self) -> str:
        return name_of(self.effect)


def find_out_of_range(result: SearchResult, runs: Sequence[ObservedRun]) -> OutOfRange | None:
    """Find the parameter that, beyond its limit, explains runs better than all effects found within their limits."""
    at_limit = [effect for effect in result.effects if ended_at_limit(effect)]
    large = [
        effect
        for effect in filter(_is_constant, result.effects)
        if abs(getattr(effect, size_field(effect))) > _LARGE * max(map(abs, size_limits(effect)))
    ]
    if not at_limit and not large:
        return None
    fitted = FittedRuns(runs)
    candidates = {name_of(effect): effect for effect in (*_likely_constants(result), *at_limit) if not is_wave(effect)}
    fits = [_fitted_alone(fitted, effect) for effect in candidates.values()]
    fits = sorted((fit for fit in fits if ended_at_limit(fit[1])), key=lambda fit: fit[0])
    most_um = min(fitted.residual_um(result.effects), _EXPLAINS * fitted.residual_um(()))
    if not fits or fits[0][0] >= most_um:
        return None
    alike = [effect for um, effect in fits if um <= _ALIKE * fits[0][0]]
    # A play of many degrees that always rests on one flank is a zero.
    best, *twins = list(filter(_is_constant, alike)) or alike
    return OutOfRange(best, tuple(twins))


def _is_constant(effect: Effect) -> bool:
    return effect.compensation().constant is not None


def _likely_constants(result: SearchResult) -> list[Effect]:
    """Constants of the arm with columns most similar to the residual of the initial model."""
    linear, gains = result.linear, list[tuple[float, Effect]]()
    residual = linear.without_set_up(linear.residual(()))
    for form in result.columns.forms:
        if _is_constant(form.effect):
            column = linear.without_set_up(result.columns.X[:, form.columns[0]])
            gains.append((float(column @ residual) ** 2 / max(float(column @ column), 1e-12), form.effect))
    gains.sort(key=lambda gain: -gain[0])
    return [identity(effect) for _, effect in gains[:_CANDIDATES]]


def _fitted_alone(fitted: FittedRuns, effect: Effect) -> tuple[float, Effect]:
    """RMS residual in µm with a single effect of the best size, unlimited, and that effect."""
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - slow to import

    field, (low, high) = size_field(effect), size_limits(effect)

    def of_size(size: float) -> tuple[float, Effect]:
        sized = effect.model_copy(update={field: float(size)})
        return fitted.residual_um([sized]), sized

    best = minimize_scalar(lambda size: of_size(size)[0], bracket=(min(low, 0.0), high), tol=_TOLERANCE)
    return of_size(max(float(best.x), 0.0) if low == 0 else float(best.x))

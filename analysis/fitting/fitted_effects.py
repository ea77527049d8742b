"""Fitted effects with their uncertainties and correlations, as a rig file stores them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.fitting.identifiability import parameter_label
from rigs.effects import Effect
from rigs.schema.effect import identity

if TYPE_CHECKING:
    from analysis.fitting.calibration import Calibration

_ANY_PHASE_DEG = 180.0 / np.sqrt(3)
"""Standard uncertainty of an unknown phase: a uniform distribution over a turn."""
_CORRELATED = 0.05
"""Smallest correlation that is stored. Chosen: a smaller one changes the uncertainty of a sum by less than 5 %."""


@dataclass(frozen=True)
class Fitted:
    """A fitted effect, with the standard uncertainty of each parameter in its own unit, the correlation of its size
    with those of others, and the parameters with the same response, by name. Correlations of waves are not stored."""

    effect: Effect
    sd: dict[str, float]
    correlation: dict[str, float]
    together: tuple[str, ...]


def fitted_effects(calibration: Calibration) -> tuple[Fitted, ...]:
    """Return the fitted effects of a calibration, with the two halves of a wave combined as amplitude and phase. The
    covariance of the calibration is (p, p)."""
    after = calibration.after
    places = {one.effect: k for k, one in enumerate(after.free)}
    found: list[Fitted] = []
    waves: dict[Effect, list[int]] = {}
    for effect, k in places.items():
        one = after.free[k]
        if one.signed:
            waves.setdefault(identity(after.model.effects[effect]), []).append(effect)
        else:
            sd = {one.field: float(np.sqrt(calibration.covariance[k, k]))}
            name = parameter_label(after.model.effects[effect], one.field)
            like = next((mix.like for mix in calibration.weak_parameters if mix.what == name), ())
            found.append(Fitted(after.model.effects[effect], sd, _correlation(calibration, k), like))
    return (*found, *(_whole(calibration, halves, places) for halves in waves.values()))


def _correlation(calibration: Calibration, k: int) -> dict[str, float]:
    """Return the correlations of one parameter with the others that are large enough to store."""
    after, sd = calibration.after, np.sqrt(np.diag(calibration.covariance))
    return {
        parameter_label(after.model.effects[one.effect], one.field): float(share)
        for j, (one, share) in enumerate(zip(after.free, calibration.covariance[k] / (sd[k] * sd), strict=True))
        if j != k and not one.signed and abs(share) > _CORRELATED
    }


def _whole(calibration: Calibration, halves: Sequence[int], places: dict[int, int]) -> Fitted:
    """Return A sin(x) + B cos(x) as amplitude and phase, by linear propagation; a single half keeps its phase."""
    after = calibration.after
    effects: list[Any] = [after.model.effects[k] for k in halves]
    rows = [places[k] for k in halves]
    angle = np.radians([effect.phase_deg for effect in effects])
    field = after.free[rows[0]].field
    part = np.array([getattr(effect, field) for effect in effects])
    sine, cosine = float(part @ np.cos(angle)), float(part @ np.sin(angle))
    amplitude = float(np.hypot(sine, cosine))
    to_parts = np.stack([np.cos(angle), np.sin(angle)])
    spread = to_parts @ calibration.covariance[np.ix_(rows, rows)] @ to_parts.T
    along = np.array([sine, cosine]) / max(amplitude, 1e-300)
    across = np.array([-along[1], along[0]])
    sd = {field: float(np.sqrt(along @ spread @ along))}
    if len(halves) == 2:
        turned = np.degrees(np.sqrt(across @ spread @ across) / max(amplitude, 1e-300))
        sd["phase_deg"] = float(min(turned, _ANY_PHASE_DEG))
    phase = float(np.degrees(np.arctan2(cosine, sine)))
    return Fitted(effects[0].model_copy(update={field: amplitude, "phase_deg": phase}), sd, {}, ())

"""The effects of a calibration as people know them, with uncertainties and what they are mixed with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.fitting.identify import name_of
from rigs.effects import Effect
from rigs.schema.effect import identity

if TYPE_CHECKING:
    from analysis.fitting.calibrate import Calibration

_ANY_PHASE_DEG = 180.0 / np.sqrt(3)
"""Standard uncertainty of a phase of which nothing is known."""
_CORRELATED = 0.05
"""Less is not kept."""


@dataclass(frozen=True)
class Fitted:
    """An effect as it came out, with the standard uncertainty of each parameter, in its own unit, and the correlation
    of its size with those of others and what looks like it, by name; of waves neither is kept."""

    effect: Effect
    sd: dict[str, float]
    correlation: dict[str, float]
    together: tuple[str, ...]


def fitted_effects(calibration: Calibration) -> tuple[Fitted, ...]:
    """The effects that were fitted; the two halves of a wave as one, with amplitude and phase."""
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
            name = name_of(after.model.effects[effect], one.field)
            like = next((mix.like for mix in calibration.mixed if mix.what == name), ())
            found.append(Fitted(after.model.effects[effect], sd, _correlation(calibration, k), like))
    return (*found, *(_whole(calibration, halves, places) for halves in waves.values()))


def _correlation(calibration: Calibration, k: int) -> dict[str, float]:
    """Of one parameter with the others, as far as it matters."""
    after, sd = calibration.after, np.sqrt(np.diag(calibration.covariance))
    return {
        name_of(after.model.effects[one.effect], one.field): float(share)
        for j, (one, share) in enumerate(zip(after.free, calibration.covariance[k] / (sd[k] * sd), strict=True))
        if j != k and not one.signed and abs(share) > _CORRELATED
    }


def _whole(calibration: Calibration, halves: Sequence[int], places: dict[int, int]) -> Fitted:
    """A sin(x) + B cos(x) as amplitude and phase, by linear propagation; one half alone keeps its phase."""
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

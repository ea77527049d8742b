"""Calibration: known effects estimated from runs, judged on readings that had no part in it.

choose the effects  →  hold what the data cannot tell apart  →  fit  →  before and after, seen and unseen
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.fitting.choice import chosen
from analysis.fitting.estimate import Fit, fit, sizes
from analysis.fitting.identify import Held, name_of, separate
from analysis.fitting.observation import Observation, observe, residuals_of, rms
from analysis.fitting.split import split
from analysis.model.predict import Model, model_of
from analysis.reading.loading import Measured
from rigs.effect import identity, is_wave
from rigs.effects import Effect, size_field
from rigs.errors import FileError
from rigs.rig import Rig

_ANY_PHASE_DEG = 180.0 / np.sqrt(3)
"""Standard uncertainty of a phase of which nothing is known."""
_LOOSE = 10.0
"""Standard uncertainty, in healthy sizes, from which on a parameter is not determined by the data."""
_NOTHING_MM = 1e-5
"""What no gauge shows: by so little one of two fits that leave nothing may be worse."""


@dataclass(frozen=True)
class Calibration:
    """known: the model begun with; before_mm, after_mm: rms on the readings used and on those left out (nan: none)."""

    known: Model
    before: Fit
    after: Fit
    held: list[Held]
    before_mm: tuple[float, float]
    after_mm: tuple[float, float]


def calibrate_runs(
    rig: Rig,
    runs: Sequence[Measured],
    judges: Sequence[Measured],
    words: str,
    *,
    share: float,
    groups: bool,
    seed: int,
) -> Calibration:
    """Fit the effects that `words` choose, on top of those of the rig.

    Judged on the runs `judges` and on a share of the readings of each run. Raises FileError.
    """
    model = model_of(rig)
    used = [observe(model, run.table, str(run.path)) for run in runs]
    left_out = [observe(model, run.table, str(run.path)) for run in judges]
    if share:
        halves = [split(one, share, groups, seed) for one in used]
        used, left_out = [half[0] for half in halves], left_out + [half[1] for half in halves]
    return calibrate(rig, used, left_out, words)


def calibrate(
    rig: Rig, observations: Sequence[Observation], left_out: Sequence[Observation], words: str
) -> Calibration:
    """Fit the chosen effects on top of those in the rig file. Raises FileError where none can be fitted."""
    known = model_of(rig)
    wanted_effects = chosen(words)
    _enough(observations, len(wanted_effects))
    before = fit(known, observations)
    model = replace(known, effects=(*known.effects, *wanted_effects))
    wanted = [
        replace(one, signed=is_wave(model.effects[one.effect]))
        for one in sizes(model.effects)
        if one.effect >= len(known.effects)
    ]
    free, held = separate(model, observations, wanted, before.setups, before.rms_mm)
    if not free:
        raise FileError("--fit", "these runs show none of the chosen effects", "choose others, or measure another test")
    kept = {one.effect for one in free}
    effects = tuple(
        effect if k < len(known.effects) or k in kept else effect.model_copy(update={size_field(effect): 0.0})
        for k, effect in enumerate(model.effects)
    )
    after = fit(replace(model, effects=effects), observations, free, before.setups)
    after, loose = _tightened(after, observations, before)
    held += loose
    if after.rms_mm > before.rms_mm + _NOTHING_MM:
        raise FileError("--fit", "the fit did not converge", "choose fewer effects")
    return Calibration(
        known, before, after, held, _rms(before, observations, left_out), _rms(after, observations, left_out)
    )


def _tightened(after: Fit, observations: Sequence[Observation], before: Fit) -> tuple[Fit, list[Held]]:
    """Hold, and fit again without, what came out known many times worse than it can plausibly be large."""
    held: list[Held] = []
    while after.free:
        loose = after.sd / np.array([one.scale for one in after.free])
        worst = int(loose.argmax())
        if loose[worst] < _LOOSE:
            break
        one = after.free[worst]
        held.append(Held(name_of(after.model.effects[one.effect], one.field), ()))
        if len(after.free) == 1:
            raise FileError("--fit", f"{held[0]}", "choose others, or measure another test")
        zero = after.model.effects[one.effect].model_copy(update={one.field: 0.0})
        changed = list(after.model.effects)
        changed[one.effect] = zero
        free = [other for k, other in enumerate(after.free) if k != worst]
        after = fit(replace(after.model, effects=tuple(changed)), observations, free, before.setups)
    return after, held


def _enough(observations: Sequence[Observation], effects: int) -> None:
    readings = sum(one.values.size for one in observations)
    if readings < 3 * (effects + 5 * len({one.setup for one in observations})):
        what = f"{readings} readings are too few for {effects} effects and the set-up"
        raise FileError("--fit", what, "give more runs, leave out less, or choose fewer effects")


def _rms(found: Fit, used: Sequence[Observation], left_out: Sequence[Observation]) -> tuple[float, float]:
    """On the readings used and on those left out; the set-up of a test not used is fitted, the effects are not."""
    seen = rms(residuals_of(found.model, used, found.setups))
    if not left_out:
        return seen, float("nan")
    others = [one for one in left_out if one.setup not in found.setups]
    setups = found.setups | (fit(found.model, others).setups if others else {})
    return seen, rms(residuals_of(found.model, left_out, setups))


@dataclass(frozen=True)
class Fitted:
    """An effect as it came out, with the standard uncertainty of each parameter, in its own unit."""

    effect: Effect
    sd: dict[str, float]


def fitted_effects(calibration: Calibration) -> list[Fitted]:
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
            found.append(Fitted(after.model.effects[effect], {one.field: float(after.sd[k])}))
    return found + [_whole(calibration, halves, places) for halves in waves.values()]


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
    spread = to_parts @ after.covariance[np.ix_(rows, rows)] @ to_parts.T
    along = np.array([sine, cosine]) / max(amplitude, 1e-300)
    across = np.array([-along[1], along[0]])
    sd = {field: float(np.sqrt(along @ spread @ along))}
    if len(halves) == 2:
        turned = np.degrees(np.sqrt(across @ spread @ across) / max(amplitude, 1e-300))
        sd["phase_deg"] = float(min(turned, _ANY_PHASE_DEG))
    phase = float(np.degrees(np.arctan2(cosine, sine)))
    return Fitted(effects[0].model_copy(update={field: amplitude, "phase_deg": phase}), sd)

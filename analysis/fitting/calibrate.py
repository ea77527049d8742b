"""Calibration: known effects estimated from runs, judged on readings that had no part in it.

choose the effects  →  hold what the data cannot tell apart  →  fit  →  before and after, seen and unseen
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from analysis.fitting.estimate import Fit, Observation, fit, observe, residuals_of, rms, sizes
from analysis.fitting.identify import Held, separate
from analysis.fitting.split import split
from analysis.model.predict import Model, model_of
from analysis.reading.loading import Measured
from rigs.effects import VOCABULARY, Effect
from rigs.errors import FileError
from rigs.rig import Rig

_PER_AXIS = ("joint_offset", "backlash", "compliance", "reversal_spike", "servo_lag", "link_bending")
_FIELDS: tuple[Literal["a", "alpha", "d", "beta"], ...] = ("a", "alpha", "d")
"""Of link_geometry where no field is named; beta is one more than four parameters a joint need."""
_ORDERS = (1.0, 2.0)
"""Of transmission_error where none is named: an eccentric wheel, and twice that."""


@dataclass(frozen=True)
class Calibration:
    """known: the model begun with; before_mm, after_mm: rms on the readings used and on those left out (nan: none)."""

    known: Model
    before: Fit
    after: Fit
    held: list[Held]
    before_mm: tuple[float, float]
    after_mm: tuple[float, float]


def chosen(words: Sequence[str]) -> list[Effect]:
    """Effects of a list like `joint_offset`, `link_geometry:3.a`, `backlash:1`, `transmission_error:4:2`.

    A name alone stands for all axes. Raises FileError for what is none.
    """
    return [effect for word in words for effect in _expanded(word)]


def _expanded(word: str) -> list[Effect]:
    name, _, place = word.partition(":")
    place, _, order = place.partition(":")
    if name not in VOCABULARY:
        raise FileError(f"--fit {word}", "no such effect", f"one of {', '.join(VOCABULARY)}")
    axis, _, field = place.partition(".")
    axes = [int(axis)] if axis.isdigit() else list(range(1, 7))
    if name == "link_geometry":
        fields = [field] if field else list(_FIELDS)
        made = [{"axis": k, "field": one} for k in axes for one in fields]
    elif name == "transmission_error":
        orders = [float(order)] if order else list(_ORDERS)
        made = [{"axis": k, "order": n, "phase_deg": phase} for k in axes for n in orders for phase in (0.0, 90.0)]
    elif name in _PER_AXIS:
        made = [{"axis": k} for k in axes]
    elif "gauge" in VOCABULARY[name].model_fields:
        made = [{"gauge": place or gauge} for gauge in (["g1"] if place else ["g1", "g2"])]
    else:
        made = [{}]
    try:
        return [VOCABULARY[name].model_validate(fields) for fields in made]  # type: ignore[misc]
    except ValueError as error:
        what = str(error).splitlines()[2].strip() if len(str(error).splitlines()) > 2 else str(error)
        raise FileError(f"--fit {word}", what, "write it like backlash:1 or link_geometry:3.a") from None


def calibrate_runs(
    rig: Rig,
    runs: Sequence[Measured],
    judges: Sequence[Measured],
    words: Sequence[str],
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
    rig: Rig, observations: Sequence[Observation], left_out: Sequence[Observation], words: Sequence[str]
) -> Calibration:
    """Fit the chosen effects on top of those in the rig file. Raises FileError where none can be fitted."""
    known = model_of(rig)
    before = fit(known, observations)
    model = replace(known, effects=(*known.effects, *chosen(words)))
    wanted = [one for one in sizes(model.effects) if one.effect >= len(known.effects)]
    free, held = separate(model, observations, wanted, before.setups, before.rms_mm)
    if not free:
        raise FileError("--fit", "these runs show none of the chosen effects", "choose others, or measure another test")
    after = fit(model, observations, free, before.setups)
    judged = [one for one in left_out if one.setup in before.setups]
    return Calibration(
        known, before, after, held, _rms(before, observations, judged), _rms(after, observations, judged)
    )


def _rms(found: Fit, used: Sequence[Observation], left_out: Sequence[Observation]) -> tuple[float, float]:
    seen = rms(residuals_of(found.model, used, found.setups))
    return seen, rms(residuals_of(found.model, left_out, found.setups)) if left_out else float("nan")


def fitted_effects(calibration: Calibration) -> list[tuple[Effect, dict[str, float]]]:
    """The effects that were fitted, with what they came to, and the standard uncertainty of each parameter."""
    found: dict[int, dict[str, float]] = {}
    for one, sd in zip(calibration.after.free, calibration.after.sd, strict=True):
        found.setdefault(one.effect, {})[one.field] = float(sd)
    return [(calibration.after.model.effects[k], sd) for k, sd in sorted(found.items())]

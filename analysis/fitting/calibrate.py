"""Calibration: known effects estimated from runs, judged on readings that had no part in it.

choose the effects  →  fit and weigh by turns  →  what was told apart  →  before and after, seen and unseen
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa

from analysis.fitting.choice import chosen
from analysis.fitting.covered import JointRange, beyond, joints_covered
from analysis.fitting.estimate import Fit, Free, fit, sizes
from analysis.fitting.fitted_effects import Fitted, fitted_effects
from analysis.fitting.identify import Together, combinations, mixed, name_of, seen
from analysis.fitting.observation import Observation, residuals_of, rms
from analysis.fitting.placements import observed, parted, with_enough
from analysis.fitting.run_noise import Repeats, repeats_of
from analysis.fitting.split import split
from analysis.fitting.uncertainty import Scatter, covariance
from analysis.fitting.weighing import SOUND, Weighing, apart, begun, renewed, resolution
from analysis.frames import Tabular, for_json, table_of_rows
from analysis.kinematics.arm import Array
from analysis.measures.parameters import quantity_of
from analysis.model.predict import Model, SetUp, model_of
from analysis.traces.loading import Measured
from analysis.traces.tables import PoseTable
from rigs.effects import VOCABULARY, Effect, healthy_size, size_field
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import is_wave

_ROUNDS, _SETTLED = 8, 0.02
"""Turns of fitting and weighing, and the relative change of a level or noise that matters no more."""
_WORSE = 1.01
"""By so little a fit may be worse than none, where there is nothing to gain: each stops near its end only."""


@dataclass(frozen=True)
class SetUpNoise:
    """sd_mm: what a reading counts with; repeats: what visits of one place differ by, None where there are none."""

    sd_mm: float
    repeats: Repeats | None


@dataclass(frozen=True)
class Calibration(Tabular):
    """known: the model begun with; covariance (p, p) of the fitted parameters in their own units, with the scatter from
    run to run; weighing: noise and wild readings of each observation, levels of all parameters that were asked for;
    noise by set-up; gauges: whether any run is of gauges; told_apart: how many combinations of the parameters the
    readings tell; mixed: parameters that do not stand by themselves; covered: where the joints were in the readings
    used; doubts in words; before_mm, after_mm: rms on the sound readings used and on those left out (nan: none)."""

    known: Model
    before: Fit
    after: Fit
    covariance: Array
    scatter: Scatter
    weighing: Weighing
    noise: dict[str, SetUpNoise]
    gauges: bool
    told_apart: int
    mixed: list[Together]
    covered: tuple[JointRange, ...]
    doubts: tuple[str, ...]
    before_mm: tuple[float, float]
    after_mm: tuple[float, float]

    @cached_property
    def effects(self) -> tuple[Fitted, ...]:
        """The fitted effects with the standard uncertainties of their parameters."""
        return fitted_effects(self)

    @property
    def extended_rig(self) -> Rig:
        """The rig begun with, the fitted effects added."""
        effects = (*self.known.effects, *(one.effect for one in self.effects))
        return self.known.rig.model_copy(update={"effects": effects})

    def to_table(self) -> pa.Table:
        """The fitted parameters, a row each: effect, value, u (standard uncertainty), unit."""
        rows = [
            {"effect": name_of(one.effect, field), **asdict(quantity_of(one.effect, field, one.sd))}
            for one in self.effects
            for field in one.sd
        ]
        return table_of_rows(("effect", "value", "u", "unit"), rows)

    def to_dict(self) -> dict[str, Any]:
        """All of it in plain types, lengths in mm, angles in degrees: what `rig calibrate --json` prints."""
        rms_mm = [{"before": one, "after": other} for one, other in zip(self.before_mm, self.after_mm, strict=True)]
        plain: dict[str, Any] = for_json(
            {
                "effects": [
                    {**one.effect.model_dump(mode="json", exclude={"found"}), "sd": one.sd} for one in self.effects
                ],
                "covariance": self.covariance,
                "scatter": asdict(self.scatter),
                "noise": {setup: asdict(noise) for setup, noise in self.noise.items()},
                "told_apart": {"asked": len(self.weighing.spread), "told": self.told_apart},
                "mixed": [{"what": one.what, "like": one.like, "share": one.share} for one in self.mixed],
                "joints_deg": self.covered,
                "doubts": self.doubts,
                "rms_mm": {"used": rms_mm[0], "left_out": None if np.isnan(self.before_mm[1]) else rms_mm[1]},
            }
        )
        return plain


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

    Judged on the runs `judges` and on a share of the readings of each run. Runs that cannot be one frame have a set-up
    each, by the model begun with and, where this was too far off to say, by the one found. Raises FileError.
    """
    names = [run.run.manifest.name for run in (*runs, *judges)]
    whole, told = parted(model_of(rig), observed(rig, [*runs, *judges]), names)
    found = _halved(rig, whole, len(runs), words, share=share, groups=groups, seed=seed)
    again, more = parted(found.after.model, whole, names)
    if more:
        found = _halved(rig, again, len(runs), words, share=share, groups=groups, seed=seed)
    return replace(found, doubts=(*told, *more, *found.doubts))


def _halved(
    rig: Rig, whole: Sequence[Observation], runs: int, words: str, *, share: float, groups: bool, seed: int
) -> Calibration:
    """Calibrated with the first `runs` observations, a share of their readings and the other observations left out."""
    used, left_out = list(whole[:runs]), list(whole[runs:])
    if share:
        halves = [split(one, share, groups, seed) for one in used]
        used, left_out = [half[0] for half in halves], left_out + [half[1] for half in halves]
    return calibrate(rig, used, left_out, words)


def calibrate(
    rig: Rig, observations: Sequence[Observation], left_out: Sequence[Observation], words: str
) -> Calibration:
    """Fit the chosen effects on top of those in the rig file. Raises FileError where none can be fitted."""
    known = model_of(rig)
    wanted = chosen(words)
    enough, too_few = with_enough(observations)
    observations = [observations[k] for k in enough]
    before = fit(known, observations)
    model = replace(known, effects=(*known.effects, *wanted))
    free = [
        replace(one, signed=is_wave(model.effects[one.effect]))
        for one in sizes(model.effects)
        if one.effect >= len(known.effects)
    ]
    after, weighing = _converged(model, observations, free, before.setups)
    answer = resolution(after.design, weighing.spread)
    names = [name_of(model.effects[one.effect], one.field) for one in free]
    kept = seen(answer)
    if not kept:
        raise FileError("--fit", "these runs show none of the chosen effects", "choose others, or measure another test")
    if len(kept) < len(free):
        after = _without_the_unseen(after, weighing, observations, kept, before.setups)
    if _energy(after, weighing) > _WORSE * _energy(before, weighing):
        raise FileError("--fit", "the fit did not converge", "choose fewer effects")
    known_to, scatter = covariance(after, observations, _of(weighing, kept), _background(wanted))
    covered = joints_covered(observations)
    return Calibration(
        known=known,
        before=before,
        after=after,
        covariance=known_to,
        scatter=scatter,
        weighing=weighing,
        noise=_noise_of(observations, weighing, after),
        gauges=any(not isinstance(one.table, PoseTable) for one in observations),
        told_apart=combinations(answer),
        mixed=mixed(answer, names),
        covered=covered,
        doubts=(*too_few, *_doubts(observations, left_out, weighing, covered)),
        before_mm=(_sound_rms(before, observations, weighing), _judged(before, left_out)),
        after_mm=(_sound_rms(after, observations, weighing), _judged(after, left_out)),
    )


def _background(wanted: Sequence[Effect]) -> list[Effect]:
    """What a healthy arm has of every effect that is not among those wanted, as far as its places can be listed."""
    asked, found = {_place(one) for one in wanted}, []
    for name in VOCABULARY:
        with suppress(FileError):
            found += [one for one in chosen(name) if _place(one) not in asked]
    return [one.model_copy(update={size_field(one): healthy_size(one)}) for one in found]


def _place(effect: Effect) -> str:
    return repr(effect.model_copy(update={size_field(effect): 0.0}))


def _noise_of(observations: Sequence[Observation], weighing: Weighing, after: Fit) -> dict[str, SetUpNoise]:
    repeats = repeats_of(observations, after.residuals)
    sd_mm = {one.setup: noise for one, noise in zip(observations, weighing.noise_mm, strict=True)}
    return {setup: SetUpNoise(noise, repeats.get(setup)) for setup, noise in sd_mm.items()}


def _doubts(
    observations: Sequence[Observation],
    left_out: Sequence[Observation],
    weighing: Weighing,
    covered: Sequence[JointRange],
) -> list[str]:
    """What a person should know before the result is used."""
    wild: dict[str, tuple[int, int]] = {}
    for one, count in zip(observations, weighing.wild, strict=True):
        left, whole = wild.get(one.setup, (0, 0))
        wild[one.setup] = left + count, whole + len(one.rows)
    found = [
        f"{setup}: {count} of {whole} readings are wild and left out" for setup, (count, whole) in wild.items() if count
    ]
    if left_out:
        judged = np.concatenate([one.table.q[one.rows] for one in left_out])
        found += beyond(covered, judged, "the model")
    return found


def _converged(
    model: Model, observations: Sequence[Observation], free: Sequence[Free], setups: dict[str, SetUp]
) -> tuple[Fit, Weighing]:
    """Fitted and weighed by turns, until neither noise nor levels nor what is wild changes."""
    weighing = begun(observations, len(free))
    after = fit(model, observations, free, setups, weighing)
    for _ in range(_ROUNDS):
        better = renewed(weighing, after, observations)
        change, weighing = apart(weighing, better), better
        after = fit(model, observations, free, setups, weighing, near=after)
        if change < _SETTLED:
            break
    return after, weighing


def _without_the_unseen(
    after: Fit, weighing: Weighing, observations: Sequence[Observation], kept: Sequence[int], setups: dict[str, SetUp]
) -> Fit:
    effects: list[Any] = list(after.model.effects)
    for k, one in enumerate(after.free):
        if k not in kept:
            effects[one.effect] = effects[one.effect].model_copy(update={one.field: 0.0})
    model = replace(after.model, effects=tuple(effects))
    return fit(model, observations, [after.free[k] for k in kept], setups, _of(weighing, kept))


def _of(weighing: Weighing, kept: Sequence[int]) -> Weighing:
    """The weighing of some of the parameters."""
    return replace(weighing, spread=weighing.spread[list(kept)])


def _energy(found: Fit, weighing: Weighing) -> float:
    """Of the weighed residuals, and a little: two fits that leave nothing are alike."""
    return sum(float((part**2).sum()) for part in weighing.weighed(found.residuals)) + 1.0


def _sound_rms(found: Fit, observations: Sequence[Observation], weighing: Weighing) -> float:
    """Of the readings that are not wild."""
    return rms([
        residual[sound.min(axis=1) >= SOUND]
        for residual, sound in zip(residuals_of(found.model, observations, found.setups), weighing.sound, strict=True)
    ])  # fmt: skip


def _judged(found: Fit, left_out: Sequence[Observation]) -> float:
    """Of the readings left out; the set-up of a test not used is fitted, the effects are not."""
    if not left_out:
        return float("nan")
    others = [one for one in left_out if one.setup not in found.setups]
    setups = found.setups | (fit(found.model, others).setups if others else {})
    return rms(residuals_of(found.model, left_out, setups))

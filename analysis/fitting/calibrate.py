"""Calibration: known effects are estimated from runs and judged on readings that were not used.

choice of effects → fitting and weighting in turn → identifiability → residuals before and after, used and held out
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from analysis.fitting.calibration import Calibration, SetUpNoise
from analysis.fitting.calibration_doubts import doubts_of_readings, doubts_of_sizes
from analysis.fitting.effect_choice import parse_effects
from analysis.fitting.estimate import Fit, FreeParameter, fit, sizes
from analysis.fitting.held_out import held_out_setups, pose_setup, with_enough_to_judge
from analysis.fitting.identifiability import (
    identified,
    identified_combinations,
    parameter_label,
    weak_parameters,
)
from analysis.fitting.joint_coverage import joints_covered
from analysis.fitting.observation import Observation, residuals_of, rms
from analysis.fitting.placements import observe_runs, split_by_frame, with_enough_readings
from analysis.fitting.run_noise import repeats_of
from analysis.fitting.split import split
from analysis.fitting.uncertainty import covariance
from analysis.fitting.weighting import (
    SOUND,
    Weighting,
    initial_weighting,
    relative_change,
    resolution,
    updated_weighting,
)
from analysis.model.predict import Model, SetUp, model_of
from analysis.traces.loading import Measured
from analysis.traces.tables import PoseTable
from rigs.effects import VOCABULARY, Effect, healthy_size, size_field
from rigs.errors import FileError, UseError
from rigs.rig import Rig
from rigs.schema.effect import is_wave

_ROUNDS, _CONVERGED = 8, 0.02
"""Largest number of rounds of fitting and weighting, and the relative change of a level or noise below which they end.
Chosen: 2 % of a standard deviation changes no decision."""
_WORSE = 1.01
"""Factor by which a fit may be worse than none. Chosen: where nothing can be gained, both fits stop only near their
optimum."""


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
    """Return the calibration of the effects that `words` choose, on top of those of the rig; readings are (m, k) mm.

    It is judged on the runs `judges` and on a share of the readings of each run. Runs that cannot share one frame get a
    set-up each, first by the initial model and, where that was too inaccurate, by the fitted one. Raises UseError for
    an unknown effect, and FileError.
    """
    names = [run.run.manifest.name for run in (*runs, *judges)]
    whole, doubts = split_by_frame(model_of(rig), observe_runs(rig, [*runs, *judges]), names)
    found = _halved(rig, whole, len(runs), words, share=share, groups=groups, seed=seed)
    again, more = split_by_frame(found.after.model, whole, names)
    if more:
        found = _halved(rig, again, len(runs), words, share=share, groups=groups, seed=seed)
    return replace(found, doubts=(*doubts, *more, *found.doubts))


def _halved(
    rig: Rig, whole: Sequence[Observation], runs: int, words: str, *, share: float, groups: bool, seed: int
) -> Calibration:
    """Return the calibration from the first `runs` observations, with a share of their readings and all other
    observations held out."""
    used, left_out = list(whole[:runs]), list(whole[runs:])
    if share:
        halves = [split(one, share, groups, seed) for one in used]
        used, left_out = [half[0] for half in halves], left_out + [half[1] for half in halves]
    return calibrate(rig, used, left_out, words)


def calibrate(
    rig: Rig, observations: Sequence[Observation], left_out: Sequence[Observation], words: str
) -> Calibration:
    """Return the calibration of the chosen effects on top of those in the rig file, from readings (m, k) mm. Raises
    FileError where none can be fitted."""
    known = model_of(rig)
    wanted = parse_effects(words)
    enough, too_few = with_enough_readings(observations)
    observations = [observations[k] for k in enough]
    before = fit(known, observations)
    left_out, unjudged = with_enough_to_judge(left_out, before.setups, pose_setup(observations, before.setups))
    model = replace(known, effects=(*known.effects, *wanted))
    free = [
        replace(one, signed=is_wave(model.effects[one.effect]))
        for one in sizes(model.effects)
        if one.effect >= len(known.effects)
    ]
    after, weighting = _converged(model, observations, free, before.setups)
    answer = resolution(after.design, weighting.spread)
    names = [parameter_label(model.effects[one.effect], one.field) for one in free]
    kept = identified(answer)
    if not kept:
        raise FileError("--fit", "these runs do not show any of the chosen effects", "choose others or another test")
    if len(kept) < len(free):
        after = _without_the_unseen(after, weighting, observations, kept, before.setups)
    if _energy(after, weighting) > _WORSE * _energy(before, weighting):
        raise FileError("--fit", "the fit did not converge", "choose fewer effects")
    known_to, scatter = covariance(after, observations, _of(weighting, kept), _background(wanted))
    covered = joints_covered(observations)
    return Calibration(
        known=known,
        before=before,
        after=after,
        covariance=known_to,
        scatter=scatter,
        weighting=weighting,
        noise=_noise_of(observations, weighting, after),
        gauges=any(not isinstance(one.table, PoseTable) for one in observations),
        identified_combinations=identified_combinations(answer),
        weak_parameters=weak_parameters(answer, names),
        covered=covered,
        doubts=(
            *doubts_of_sizes(after),
            *too_few,
            *unjudged,
            *doubts_of_readings(observations, left_out, weighting, covered),
        ),
        before_mm=(_sound_rms(before, observations, weighting), _judged(before, observations, left_out)),
        after_mm=(_sound_rms(after, observations, weighting), _judged(after, observations, left_out)),
    )


def _background(wanted: Sequence[Effect]) -> list[Effect]:
    """Return every effect that is not requested at its healthy size, as far as its places can be listed."""
    asked, found = {_place(one) for one in wanted}, []
    for name in VOCABULARY:
        with suppress(UseError):
            found += [one for one in parse_effects(name) if _place(one) not in asked]
    return [one.model_copy(update={size_field(one): healthy_size(one)}) for one in found]


def _place(effect: Effect) -> str:
    return repr(effect.model_copy(update={size_field(effect): 0.0}))


def _noise_of(observations: Sequence[Observation], weighting: Weighting, after: Fit) -> dict[str, SetUpNoise]:
    repeats = repeats_of(observations, after.residuals)
    sd_mm = {one.setup: noise for one, noise in zip(observations, weighting.noise_mm, strict=True)}
    return {setup: SetUpNoise(noise, repeats.get(setup)) for setup, noise in sd_mm.items()}


def _converged(
    model: Model, observations: Sequence[Observation], free: Sequence[FreeParameter], setups: dict[str, SetUp]
) -> tuple[Fit, Weighting]:
    """Return the fit and the weighting that follow from each other, found in turn until neither the noise, the levels
    nor the wild readings change."""
    weighting = initial_weighting(observations, len(free))
    after = fit(model, observations, free, setups, weighting)
    for _ in range(_ROUNDS):
        better = updated_weighting(weighting, after, observations)
        change, weighting = relative_change(weighting, better), better
        after = fit(model, observations, free, setups, weighting, near=after)
        if change < _CONVERGED:
            break
    return after, weighting


def _without_the_unseen(
    after: Fit, weighting: Weighting, observations: Sequence[Observation], kept: Sequence[int], setups: dict[str, SetUp]
) -> Fit:
    """Return the fit of the identified parameters alone, with all others at zero."""
    effects: list[Any] = list(after.model.effects)
    for k, one in enumerate(after.free):
        if k not in kept:
            effects[one.effect] = effects[one.effect].model_copy(update={one.field: 0.0})
    model = replace(after.model, effects=tuple(effects))
    return fit(model, observations, [after.free[k] for k in kept], setups, _of(weighting, kept))


def _of(weighting: Weighting, kept: Sequence[int]) -> Weighting:
    """Return the weighting of some of the parameters."""
    return replace(weighting, spread=weighting.spread[list(kept)])


def _energy(found: Fit, weighting: Weighting) -> float:
    """Return the energy of the weighted residuals plus one, so that two fits without residual compare as equal."""
    return sum(float((part**2).sum()) for part in weighting.weighted(found.residuals)) + 1.0


def _sound_rms(found: Fit, observations: Sequence[Observation], weighting: Weighting) -> float:
    """Return the rms in mm of the readings that are not wild."""
    return rms([
        residual[sound.min(axis=1) >= SOUND]
        for residual, sound in zip(residuals_of(found.model, observations, found.setups), weighting.sound, strict=True)
    ])  # fmt: skip


def _judged(found: Fit, observations: Sequence[Observation], left_out: Sequence[Observation]) -> float:
    """Return the rms in mm of held-out readings; the set-up of a test that was not used is fitted, the effects
    are not."""
    if not left_out:
        return float("nan")
    setups = held_out_setups(found.model, left_out, found.setups, pose_setup(observations, found.setups))
    return rms(residuals_of(found.model, left_out, setups))

"""Calibration: given effects are estimated from runs and judged on readings that were not used."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import pyarrow as pa

from analysis.frames import Tabular, for_json, table_of_rows
from analysis.inference.estimate import (
    SOUND,
    Fit,
    FreeParameter,
    Repeats,
    Weighting,
    fit,
    initial_weighting,
    relative_change,
    repeats_of,
    resolution,
    sizes,
    updated_weighting,
)
from analysis.inference.observation import JointRange, Observation, joints_covered, outside_coverage, residuals_of, rms
from analysis.inference.setups import (
    FRAME_TERMS,
    TO_SPARE,
    at_instrument,
    observe_runs,
    split,
    split_by_frame,
    terms_of,
    with_enough_readings,
)
from analysis.inference.uncertainty import (
    RunScatter,
    WeakParameter,
    covariance,
    identified,
    identified_combinations,
    parameter_label,
    weak_parameters,
)
from analysis.kinematics.arm import Array
from analysis.measures.parameters import quantity_of
from analysis.model.predict import Model, SetUp, model_of
from analysis.traces.loading import Measured
from analysis.traces.tables import PoseTable
from rigs.effects import VOCABULARY, Effect, bounds, healthy_size, one_sided, size_field
from rigs.errors import FileError, UseError
from rigs.rig import Rig
from rigs.schema.effect import healthy, identity, is_wave, label_of, phases, scaled

# ----------------------------------------------------------------------------------------------------------------------
# The effects that a user asks to be fitted: names with places, as NAME:PLACE,NAME:PLACE, and names alone.
#
# A name alone stands for all axes, or for both gauges. Waves are fitted as a sine and a cosine, so that every phase
# can be reached. Each effect defines how its place is written.


def parse_effects(words: str) -> list[Effect]:
    """Return the effects of a list, each once, bounded ones at half a healthy size. Raises UseError for an unknown
    effect or place."""
    found = [effect for word in filter(None, map(str.strip, words.split(","))) for effect in _expanded(word)]
    if not found:
        raise UseError("--fit", "names no effect", f"write some of {', '.join(VOCABULARY)}")
    return list(dict.fromkeys(found))


def given_effects(words: str) -> list[Effect]:
    """Return the effects of a list, each once, a wave with the phase at which its fit begins. Raises UseError as
    `parse_effects` does."""
    quarters = {other for effect in parse_effects(words) for other in phases(effect)[1:]}
    return [effect for effect in parse_effects(words) if effect not in quarters or not is_wave(effect)]


def _expanded(word: str) -> list[Effect]:
    name, _, place = word.partition(":")
    if name not in VOCABULARY:
        raise UseError(f"--fit {word}", "no such effect", f"one of {', '.join(VOCABULARY)}")
    written = VOCABULARY[name].PLACE
    match = re.fullmatch(written.pattern, place, re.ASCII)
    if not match:
        example = f"{name}:{written.example}" if written.example else name
        raise UseError(f"--fit {word}", f"{name} has no place {place!r}", f"write {example}")
    keys = {key: (value,) if value is not None else written.every[key] for key, value in match.groupdict().items()}
    starts = [_starting_effect(word, name, dict(zip(keys, values, strict=True))) for values in product(*keys.values())]
    return [half for effect in starts for half in phases(effect)]


def _starting_effect(word: str, name: str, keys: dict[str, str]) -> Effect:
    """Return an effect with its starting size: zero or, where it cannot be negative, half a healthy size."""
    try:
        effect = VOCABULARY[name].model_validate(keys)
    except ValueError:
        raise UseError(f"--fit {word}", f"outside what {name} can be", "see docs/simulation.md") from None
    return scaled(healthy(effect), 0.5 if one_sided(effect) else 0.0)


# ----------------------------------------------------------------------------------------------------------------------
# Fitted effects with their uncertainties and correlations, as a rig file stores them.

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


# ----------------------------------------------------------------------------------------------------------------------
# The result of a calibration: fitted effects, what identified them, and residuals before and after.


@dataclass(frozen=True)
class SetUpNoise:
    """The noise of a set-up: `sd_mm` is the standard deviation that weights a reading, `repeats` the scatter of visits
    of one place, None where there are none."""

    sd_mm: float
    repeats: Repeats | None


@dataclass(frozen=True)
class Calibration(Tabular):
    """The result of a calibration.

    `known` is the initial model. `covariance` (p, p) of the fitted parameters is in their own units and includes the
    scatter between runs. `weighting` has the noise and wild readings of each observation and the levels of all
    requested parameters; `noise` is listed by set-up. `gauges` states whether any run has gauges.
    `identified_combinations` counts the combinations of parameters that the readings determine, and `weak_parameters`
    lists parameters that they do not determine by themselves. `covered` has the range of each joint in the readings
    used. `before_mm` and `after_mm` are the rms on the sound readings used and on those held out (NaN where there are
    none).
    """

    known: Model
    before: Fit
    after: Fit
    covariance: Array
    scatter: RunScatter
    weighting: Weighting
    noise: dict[str, SetUpNoise]
    gauges: bool
    identified_combinations: int
    weak_parameters: list[WeakParameter]
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
            {"effect": parameter_label(one.effect, field), **asdict(quantity_of(one.effect, field, one.sd))}
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
                "told_apart": {"asked": len(self.weighting.spread), "told": self.identified_combinations},
                "mixed": [{"what": one.what, "like": one.like, "share": one.share} for one in self.weak_parameters],
                "joints_deg": self.covered,
                "doubts": self.doubts,
                "rms_mm": {"used": rms_mm[0], "left_out": None if np.isnan(self.before_mm[1]) else rms_mm[1]},
            }
        )
        return plain


# ----------------------------------------------------------------------------------------------------------------------
# What a person should know before a calibration is used: sizes at their bounds, shapes that were not fitted, wild
# readings, and joints beyond the ranges that were covered.

_AT_BOUND = 1e-3
"""Share of a bound within which a size ends there. Chosen: an optimizer that stays inside of its bounds stops just
before them."""


def doubts_of_sizes(after: Fit) -> list[str]:
    """Return a message for each size that ends at a bound, and for each shape that was not fitted with its size."""
    return [*_at_bounds(after), *_held(after)]


def _at_bounds(after: Fit) -> list[str]:
    """Return a message for each size that ends at the bound of a rig file: the robot may err by more, and the sizes of
    other effects then take up what is left."""
    found = []
    for one in after.free:
        effect = after.model.effects[one.effect]
        value, low, high = float(getattr(effect, one.field)), *bounds(effect, one.field)
        # Zero is no limit of what a robot does: a play is zero where there is none.
        ended = [bound for bound in (low, high) if bound and abs(value - bound) < _AT_BOUND * abs(bound)]
        found += [
            f"{parameter_label(effect, one.field)} ends at the limit of a rig file, {bound:g} "
            f"{effect.unit(one.field)}: the robot may err by more, and other sizes are then wrong as well; correct "
            "it in the model first"
            for bound in ended
        ]
    return found


def _held(after: Fit) -> list[str]:
    """Return a message for each shape that was held at its default, on which the fitted size depends."""
    effects = [after.model.effects[k] for k in dict.fromkeys(one.effect for one in after.free)]
    return [
        f"{label_of(effect)}: its {shape.field} was held at {getattr(effect, shape.field):g}, on which its size "
        "depends; rig diagnose fits both"
        for effect in effects
        for shape in effect.STRETCHED
        if shape.field not in re.compile(effect.PLACE.pattern).groupindex
    ]


def doubts_of_readings(
    observations: Sequence[Observation],
    left_out: Sequence[Observation],
    weighting: Weighting,
    covered: Sequence[JointRange],
) -> list[str]:
    """Return a message for each set-up with wild readings, and for each joint that the readings (m, k) mm that were
    left out turn beyond where the effects were determined."""
    wild: dict[str, tuple[int, int]] = {}
    for one, count in zip(observations, weighting.wild, strict=True):
        left, whole = wild.get(one.setup, (0, 0))
        wild[one.setup] = left + count, whole + len(one.rows)
    found = [
        f"{setup}: {count} of {whole} readings are wild and left out" for setup, (count, whole) in wild.items() if count
    ]
    if left_out:
        judged = np.concatenate([one.table.q[one.rows] for one in left_out])
        found += outside_coverage(covered, judged, "the model")
    return found


# ----------------------------------------------------------------------------------------------------------------------
# Held-out readings: their set-ups are fitted to a frozen model, and a set-up must not absorb what it is to judge.


def pose_setup(observations: Sequence[Observation], setups: Mapping[str, SetUp]) -> SetUp | None:
    """Return one of the set-ups of poses, whose tool all placements share, or None where no poses, of (m, 3) mm, were
    used."""
    return next((setups[one.setup] for one in observations if isinstance(one.table, PoseTable)), None)


def with_enough_to_judge(
    observations: Sequence[Observation], setups: Mapping[str, SetUp], poses: SetUp | None
) -> tuple[list[Observation], list[str]]:
    """Return the held-out observations whose readings (m, k) mm are more than the terms of a set-up of their own, and
    messages about the others. `setups` are those of the readings used, and `poses` one of them or None."""
    reasons: dict[str, str] = {}
    for setup, own in _by_setup(observations, setups).items():
        readings = sum(one.values.size for one in own)
        terms = FRAME_TERMS if poses and isinstance(own[0].table, PoseTable) else terms_of(own[0].table)
        if readings <= terms:
            reasons[setup] = f"its {readings} readings are too few for the {terms} terms of the set-up alone"
    messages = [f"{setup} is not judged: {why}" for setup, why in reasons.items()]
    return [one for one in observations if one.setup not in reasons], messages


def held_out_setups(
    model: Model, observations: Sequence[Observation], setups: Mapping[str, SetUp], poses: SetUp | None
) -> dict[str, SetUp]:
    """Return all set-ups, those of held-out observations of (m, k) mm fitted to the model. A placement of few poses
    has the tool of `poses`, because with one of its own it would absorb its readings."""
    found, others = dict(setups), list[Observation]()
    for setup, own in _by_setup(observations, setups).items():
        spare = sum(one.values.size for one in own) - terms_of(own[0].table)
        if poses and isinstance(own[0].table, PoseTable) and spare < TO_SPARE:
            found[setup] = at_instrument(poses, [(model, one) for one in own])
        else:
            others += own
    return found | (fit(model, others).setups if others else {})


def _by_setup(observations: Sequence[Observation], known: Mapping[str, SetUp]) -> dict[str, list[Observation]]:
    """Return the observations of each set-up that is not known."""
    found: dict[str, list[Observation]] = {}
    for one in observations:
        if one.setup not in known:
            found.setdefault(one.setup, []).append(one)
    return found


# ----------------------------------------------------------------------------------------------------------------------
# Calibration: known effects are estimated from runs and judged on readings that were not used.
#
# choice of effects → fitting and weighting in turn → identifiability → residuals before and after, used and held out

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

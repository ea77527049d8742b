"""The verdict: the worth of each name, whether it is material, what remains, and the conclusion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.diagnosis import ODDS, Gap, Named, Remainder, Rival, Verdict
from analysis.diagnosis.free_forms import best_free_form, free_forms_of
from analysis.diagnosis.link_swing import FoundVibration
from analysis.diagnosis.observed_run import ObservedRun
from analysis.diagnosis.residual_bands import bands_above_noise
from analysis.diagnosis.rivals import RivalOdds
from analysis.diagnosis.search import SearchResult
from analysis.diagnosis.selection_state import series_among
from analysis.diagnosis.shares import sizes_by_setup
from analysis.diagnosis.validation import gap_without_um
from analysis.diagnosis.worth import LEAST_MATERIAL_UM, Worth, plain_worth, worth
from analysis.kinematics.arm import Array
from analysis.traces.tables import PoseTable
from rigs.schema.effect import label_of, name_of, size_field

_MOST = 0.5
"""Share of the gap's energy above which what remains is larger than what names explain: they have the rest at most."""
_ENOUGH = 3
"""Smallest number of readings per set-up term with which anything can be tested. Chosen: with fewer the set-up absorbs
a third of the readings."""
_HEALTHY = 0.05
"""Odds that a healthy arm shows the same, above which an effect is not reported as a fault: one case in twenty."""
_LIKELY = 0.2
"""Odds among rivals below which a name is not material: three names with the same response have a third each, so each
of them stays above it."""
_SIGMA = 2.0
"""Uncertainties of its size up to which a name is not material. With gauges that were exchanged in all runs a length of
-23 ± 23 mm had odds above 99.9 %."""
_HEALTHY_SIZE = "no larger than healthy arms show"
_SMALL = "changes readings by less than one run scatters, or than --tolerance-um"
"""Reasons why an effect does not matter. A name that is dismissed for any other reason is doubtful."""
_CERTAIN = ODDS / (1 + ODDS)
"""Odds among rivals below which a name is ambiguous."""


def ambiguous_names(found: Sequence[Named]) -> list[Named]:
    """Return the material names whose rivals cannot be dismissed."""
    return [one for one in found if one.material and one.posterior < _CERTAIN]


def named_effects(
    result: SearchResult, runs: Sequence[ObservedRun], gains: Sequence[float | None], limits: Array
) -> list[Named]:
    """Return the names of a search result. `gains` has the gain of each on held-out runs, and `limits` (b,) µm are the
    changes from which they are material."""
    effects = result.state.refined.effects
    found = [_named(result, k, gain, limits, gap_without_um(runs, effects, k)) for k, gain in enumerate(gains)]
    series = series_among(effects)
    return [
        replace(one, material=False, is_term=True, dismissed="one of more waves than a joint has")
        if name_of(one.effect) in series
        else one
        for one in found
    ]


def without_useless(found: Sequence[Named], train: Gap) -> list[Named]:
    """Return names, none of them material where the calibrated model explains the runs used no better than without
    them: they stand for something that is no effect, such as exchanged gauges."""
    if train.calibrated_um < train.before_um:
        return list(found)
    words = "the model explains these runs no better with it"
    return [replace(one, material=False, dismissed=words) if one.material else one for one in found]


def _named(result: SearchResult, k: int, gain: float | None, limits: Array, gap_without_um: float) -> Named:
    """Return one name with its worth, and why it is not material, if it is not."""
    effects, own_odds = result.state.refined.effects, result.rival_odds[k]
    own = worth(result.linear, result.contributions[k])
    sizes = sizes_by_setup(result, k, limits)
    ratio = sizes.birge_ratio()
    sd = {field: ratio * one for field, one in result.state.refined.sd(k).items()}
    dismissed = _dismissed(result, k, own, limits, gain)
    # Effects that depend on more than the posture may differ from run to run, or from day to day.
    by_posture = effects[k].compensation().use != "none"
    found = Named(
        effects[k], sd, own_odds.odds, _rivals(own_odds), gap_without_um, effects[k].remedy(),
        own.whole_um, not dismissed, gain, sizes.shares() if not dismissed and by_posture else (), dismissed,
    )  # fmt: skip
    if found.contradicted:
        return replace(found, material=False, dismissed="set-ups show different shares of it")
    field = size_field(effects[k])
    if found.material and abs(getattr(effects[k], field)) <= _SIGMA * sd[field]:
        return replace(found, material=False, dismissed="its size is not known to half of itself")
    return found


def _dismissed(result: SearchResult, k: int, own: Worth, limits: Array, gain: float | None) -> str:
    """Return why a name is not material, whatever its size and its set-ups, or nothing if it is."""
    odds = result.rival_odds[k]
    reasons = (
        (not result.state.is_fault(k), _HEALTHY_SIZE),
        (not own.is_material(limits), _SMALL),
        (gain is not None and gain <= 0, "makes held-out runs worse"),
        (odds.healthy_odds >= _HEALTHY, "a healthy arm may show it"),
        (odds.odds <= _LIKELY, "a rival is likelier"),
    )
    return next((words for holds, words in reasons if holds), "")


def _rivals(own_odds: RivalOdds) -> tuple[Rival, ...]:
    found = []
    for tried, odds in own_odds.rivals:
        effects = tried.refined.effects
        found.append(Rival(effects[-1], tried.refined.sd(len(effects) - 1), odds))
    return tuple(rival for rival in found if rival.posterior > 1e-4)


def named_vibration(found: FoundVibration, limits: Array, gap_um: float) -> list[Named]:
    """Return a vibration of the link as a name, if its worth exceeds a limit (b,) µm and the odds of any vibration are
    at least 20 to 1. Its phase is new in each run, so that no model removes it from the readings."""
    if found.gain < np.log(ODDS):
        return []
    moves = Worth(np.full(len(limits), 1e3 * found.amplitude_mm / np.sqrt(2)))
    if not moves.is_material(limits):
        return []
    odds = 1 / (1 + float(np.exp(-min(found.gain, 50.0))))
    return [Named(found.effect, found.sd, odds, (), gap_um, found.effect.remedy(), moves.whole_um, True, None)]


def remainder_of(result: SearchResult, found: Sequence[Named], limits: Array, most_um: float) -> tuple[Remainder, bool]:
    """Return what remains beyond the noise, at most the gap `most_um`, and whether it exceeds the limits (b,) µm of a
    material name. What a name explains that a set-up contradicts remains too."""
    imitating = [one for one in found if one.contradicted]
    effects = result.state.refined.effects
    imitated = sum(
        (result.contributions[effects.index(one.effect)] for one in imitating), np.zeros_like(result.linear.y)
    )
    linear, posterior = result.linear, result.posterior
    strength = result.state.strength[result.selection.columns.band]
    beyond = np.sqrt(np.clip(1 - 1 / np.maximum(strength, 1.0), 0.0, 1.0))
    left = plain_worth(linear, beyond * posterior.residual + result.free_share + linear.without_set_up(imitated))
    gap_um = worth(linear, result.initial_residual).whole_um
    share = min(1.0, (left.whole_um / gap_um) ** 2) if gap_um else 0.0
    healthy = worth(linear, posterior.healthy_share)
    is_material = left.is_material(np.maximum(limits, LEAST_MATERIAL_UM))
    words = (
        _in_words(result, imitating) if is_material else "no more than the noise, the scatter and a healthy arm explain"
    )
    return Remainder(min(left.whole_um, most_um), share, words, healthy.whole_um), is_material


def _in_words(result: SearchResult, imitating: Sequence[Named]) -> str:
    first = bands_above_noise(result.linear.blocks, result.posterior.residual)[:1]
    where = [f"{one.test}{f' {one.direction}' * bool(one.direction)}, {one.part}: {one.words}" for one in first]
    forms = [*result.state.free_forms, best_free_form(tuple(free_forms_of(result.linear)), result.posterior)]
    seen = [f"it looks like {one.form.words}" for one in forms if one.gain > 0]
    alike = [
        f"{label_of(one.effect)} resembles it, but {_shares_in_words(one)}" for one in imitating if not one.is_term
    ]
    series = Counter(name_of(one.effect) for one in imitating if one.is_term)
    alike += [f"{count} waves of {name} together resemble it, as they do any error" for name, count in series.items()]
    return "; ".join([*where, seen[0] if seen else "it has no simple form", *alike])


def _shares_in_words(one: Named) -> str:
    shown = [f"{share.value:.2f} ± {share.sd:.2f} of it in {share.setup}" for share in one.shares]
    return f"the readings show {' and '.join(shown)}"


def verdict_of(
    result: SearchResult, found: Sequence[Named], left: Remainder, limits: Array, *, is_material: bool, early: bool
) -> tuple[Verdict, str]:
    """Return the verdict on names and remainder, and the reason. `limits` (b,) µm are the changes from which names are
    material, and `early` states whether poses were read before the joints came to rest."""
    terms = result.linear.U.shape[1]
    if len(result.linear.y) < _ENOUGH * terms or not result.selection.columns.forms:
        return "not_testable_here", "these runs have too few readings to distinguish an effect from the set-up"
    material = [one for one in found if one.material]
    poses_alone = all(isinstance(block.one.table, PoseTable) for block in result.linear.blocks)
    # Names that cancel each other in part may be worth more than they explain: no more than the rest of the energy.
    is_outside = is_material and (left.um > _explained_um(result, material) or left.share > _MOST)
    # Names that leave most of such a gap stand for the early readings too.
    unnamed = is_outside or not material
    if early and poses_alone and unnamed and worth(result.linear, result.initial_residual).is_material(limits):
        return "not_testable_here", "the poses were read before the joints came to rest: measure them again"
    could_gain = left.healthy_um > float(result.scatter_limits_um.min())
    gain = f"; a calibration could gain {left.healthy_um:.0f} µm" * could_gain
    if is_outside:
        beside = " beside the names listed" * bool(material)
        return "outside_library", f"{left.um:.0f} µm{beside} remain that no effect explains; {left.words}{gain}"
    if not material:
        doubtful = [label_of(one.effect) for one in found if one.dismissed not in (_HEALTHY_SIZE, _SMALL)]
        words = "no effect exceeds the scatter and the errors of a healthy arm"
        if doubtful:
            words = f"no effect is certain enough to be named; doubtful, for the reasons listed: {', '.join(doubtful)}"
        return "within_tolerance", words + gain
    if unsure := ambiguous_names(found):
        name = name_of(unsure[0].effect)
        rivals = f"these tests cannot distinguish {name} from its rivals"
        return "ambiguous", rivals if unsure[0].rivals else f"{name} is likely but not certain"
    return "named", "each name explains readings that no other effect explains"


def _explained_um(result: SearchResult, names: Sequence[Named]) -> float:
    """Return the worth in µm of names together: those that cancel each other in part explain less than each alone."""
    effects, moved = result.state.refined.effects, [one.effect for one in names]
    rest = [effect for effect in effects if effect not in moved]
    together = worth(result.linear, result.linear.residual(rest) - result.state.refined.residual).whole_um
    apart = [one.worth_um for one in names if one.effect not in effects]
    return float(np.hypot(together, np.linalg.norm(apart)))

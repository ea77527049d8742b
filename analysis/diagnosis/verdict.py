"""What names are worth, whether they are material, what remains beside them, and the verdict on all of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.diagnosis import ODDS, Named, Remainder, Rival, Verdict
from analysis.diagnosis.freeforms import free_forms, strangest
from analysis.diagnosis.leftover import leftovers
from analysis.diagnosis.look import Look
from analysis.diagnosis.observed import Seen
from analysis.diagnosis.proof import without
from analysis.diagnosis.rivalry import Rivalry
from analysis.diagnosis.swing import Swing
from analysis.diagnosis.worth import Worth, limits_um, plain_worth, worth
from analysis.kinematics.arm import Array
from rigs.schema.effect import name_of

_ENOUGH = 3
"""Readings for each set-up term, at least, without which nothing can be told."""
_HEALTHY = 0.05
"""Odds that a healthy arm shows it anyway, from which on nothing is reported as a fault."""
_LIKELY = 0.2
"""Odds among rivals from which on a name is told at all: three that do the same have a third each."""
_CERTAIN = ODDS / (1 + ODDS)
"""Odds among rivals below which a name is ambiguous."""


def doubtful(found: Sequence[Named]) -> list[Named]:
    """Material names with rivals that cannot be dismissed."""
    return [one for one in found if one.material and one.posterior < _CERTAIN]


def names_of(look: Look, runs: Sequence[Seen], gains: Sequence[float | None], limits: Array) -> list[Named]:
    """The names of a look at runs; gains: of each on runs left out; limits (b,) µm: from which on they are material."""
    effects, setups = look.state.refined.effects, look.linear.setups
    return [_named(look, k, gain, limits, without(runs, effects, k, setups)) for k, gain in enumerate(gains)]


def _named(look: Look, k: int, gain: float | None, limits: Array, gap_without_um: float) -> Named:
    """One name with what it is worth; one that makes runs left out worse, or that is no larger than arms like this one
    show of it, is not material, whatever it moves."""
    effects, rivalry = look.state.refined.effects, look.rivalries[k]
    own = worth(look.linear, look.changes[k])
    likely = rivalry.odds > _LIKELY and rivalry.nothing < _HEALTHY
    material = look.state.is_fault(k) and own.is_material(limits) and (gain is None or gain > 0) and likely
    return Named(
        effects[k], look.state.refined.sd(k), rivalry.odds, _rivals(rivalry), gap_without_um, effects[k].remedy(),
        own.whole_um, material, gain,
    )  # fmt: skip


def _rivals(rivalry: Rivalry) -> tuple[Rival, ...]:
    found = []
    for tried, odds in rivalry.rivals:
        effects = tried.refined.effects
        found.append(Rival(effects[-1], tried.refined.sd(len(effects) - 1), odds))
    return tuple(rival for rival in found if rival.posterior > 1e-4)


def swinging(found: Swing | None, limits: Array, gap_um: float) -> list[Named]:
    """A swing of the link, where it is material: its phase is new in each run, so no model takes it out of the
    readings."""
    if found is None or found.gain <= 0:
        return []
    moves = Worth(np.full(len(limits), 1e3 * found.amplitude_mm / np.sqrt(2)))
    if not moves.is_material(limits):
        return []
    odds = 1 / (1 + float(np.exp(-min(found.gain, 50.0))))
    return [Named(found.effect, found.sd, odds, (), gap_um, found.effect.remedy(), moves.whole_um, True, None)]


def remainder_of(look: Look, limits: Array) -> tuple[Remainder, bool]:
    """What is left beyond the noise, and whether readings move by it as by a material name."""
    linear, posterior = look.linear, look.posterior
    strength = look.state.strength[look.naming.columns.band]
    beyond = np.sqrt(np.clip(1 - 1 / np.maximum(strength, 1.0), 0.0, 1.0))
    free = look.state.refined.free
    share_of_free = free @ posterior.known[len(posterior.known) - free.shape[1] :]
    left = plain_worth(linear, beyond * posterior.left + share_of_free)
    gap_um = worth(linear, look.first).whole_um
    share = min(1.0, (left.whole_um / gap_um) ** 2) if gap_um else 0.0
    healthy = worth(linear, posterior.healthy_share)
    is_material = left.is_material(limits)
    words = _in_words(look) if is_material else "no more than noise, scatter and a healthy arm give"
    return Remainder(left.whole_um, share, words, healthy.whole_um), is_material


def _in_words(look: Look) -> str:
    first = leftovers(look.linear.blocks, look.posterior.left)[:1]
    where = [f"{one.test}{f' {one.direction}' * bool(one.direction)}, {one.part}: {one.words}" for one in first]
    forms = [*look.state.strangers, strangest(tuple(free_forms(look.linear)), look.posterior)]
    seen = [f"it looks like {one.form.words}" for one in forms if one.gain > 0]
    return "; ".join([*where, seen[0] if seen else "it has no simple form"])


def verdict_of(look: Look, found: Sequence[Named], left: Remainder, *, is_material: bool) -> tuple[Verdict, str]:
    """The verdict on names and remainder, and why."""
    terms = look.linear.U.shape[1]
    if len(look.linear.y) < _ENOUGH * terms or not look.naming.columns.forms:
        return "not_testable_here", "these runs leave no reading free that could tell one effect from the set-up"
    material = [one for one in found if one.material]
    explained_um = float(np.sqrt(sum(one.worth_um**2 for one in material)))
    if is_material and left.um > explained_um:
        beside = " beside the names listed" * bool(material)
        return "outside_library", f"{left.um:.0f} µm{beside} are left that no effect explains; {left.words}"
    if not material:
        least = float(limits_um(look.linear, None).min())
        gain = f"; a calibration could gain {left.healthy_um:.0f} µm" if left.healthy_um > least else ""
        return "within_tolerance", f"nothing stands out of the scatter and of what a healthy arm shows anyway{gain}"
    if unsure := doubtful(found):
        name = name_of(unsure[0].effect)
        rivals = f"these tests do not tell {name} from its rivals"
        return "ambiguous", rivals if unsure[0].rivals else f"{name} is likely, and not certain"
    return "named", "each name explains what no other does"

"""From runs to a diagnosis: find the disagreement, name the missing effect, add it, prove that the gap shrinks.

runs → blocks with their noise → names by evidence, refined on the simulator → what each is worth → verdict and proof
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from analysis.diagnose.curves import curves_of, maps_of
from analysis.diagnose.diagnosis import Diagnosis, Named, NextTest, Remainder, Rival, Verdict
from analysis.diagnose.doubts import doubts_of_rig, doubts_of_runs
from analysis.diagnose.freeforms import strangest
from analysis.diagnose.leftover import leftovers
from analysis.diagnose.locate import places
from analysis.diagnose.look import Look, looked
from analysis.diagnose.naming import Rivalry
from analysis.diagnose.neighbourhoods import parted
from analysis.diagnose.observed import Seen
from analysis.diagnose.parting import parting
from analysis.diagnose.proof import gain_of_each, gap, without
from analysis.diagnose.runs import about
from analysis.diagnose.settle import grown
from analysis.diagnose.signatures import parts
from analysis.diagnose.swing import Swing, swing
from analysis.diagnose.worth import Worth, limits_um, plain_worth, worth
from analysis.fitting.setups import terms_of
from analysis.kinematics.arm import Array
from analysis.reading.loading import Measured
from rigs.effect import healthy_size, name_of, size_field
from rigs.errors import FileError
from rigs.rig import Rig

_ENOUGH = 3
"""Readings for each set-up term, at least, without which nothing can be told."""
FAULT = 5.0
"""Healthy sizes, at the level of the arm at hand, from which on an effect is a fault."""
LIKELY = 0.2
"""Odds among rivals from which on a name is told at all: three that do the same have a third each."""
CERTAIN = 20.0 / 21.0
"""Odds of 20 to 1 among rivals, below which a name is ambiguous."""


def diagnose(
    rig: Rig,
    used: Sequence[Measured],
    held_out: Sequence[Measured],
    unseen: Sequence[Measured],
    progress: Callable[[str], None],
    tolerance_um: float | None = None,
) -> Diagnosis:
    """Diagnose runs of one robot beside the model of a rig; judge on runs left out and at an unseen place.

    tolerance_um: from which on a name is material; the scatter of one run where None. Of poses, where no run is held
    out, a fifth of their neighbourhoods in joint space is. Raises FileError for runs of
    another robot, or that cannot be read as what they say.
    """
    begin_s = time.perf_counter()
    progress("reading the runs")
    runs, judges = about(rig, used), about(rig, held_out)
    if not judges:
        runs, judges = parted(runs)
    _hold_enough(runs)
    look = looked(runs, progress)
    progress("proving it on runs left out")
    kept = look.state.refined.effects
    train = gap(runs, look, _names(used))
    outside = [
        gap(them, look, names) if them else None
        for them, names in ((judges, _names(held_out or used)), (about(rig, unseen), _names(unseen)))
    ]
    gains = gain_of_each(look, judges)
    limits = limits_um(look.linear, tolerance_um)
    whole = [_named(look, k, limits, gains[k], without(runs, kept, k, look.linear.setups)) for k in range(len(kept))]
    shaken = swing(grown(runs, kept), look.linear.setups)
    if shaken and shaken.gain > 0 and (swinging := _swinging(shaken, limits, train.after_um)).material:
        whole.append(swinging)
    remainder, is_material = _remainder(look, limits)
    verdict, why = _verdict(look, whole, remainder, is_material=is_material)
    named = tuple(sorted(whole, key=lambda one: (not one.material, -one.worth_um)))
    doubts = [*doubts_of_runs(look.linear.blocks), *doubts_of_rig(rig, runs)]
    next_test = None
    if verdict == "ambiguous":
        progress("which test would part the rivals")
        next_test, doubt = _next_test(rig, named, used)
        doubts += doubt
    linear, before = look.linear, look.linear.in_mm(look.first)
    after = linear.in_mm(look.left)
    return Diagnosis(
        verdict=verdict,
        why=why,
        rig=rig,
        runs=train.runs,
        where=places(linear.blocks, before),
        effects=() if verdict == "not_testable_here" else named,
        remainder=remainder,
        train=train,
        held_out=outside[0],
        unseen=outside[1],
        left=leftovers(linear.blocks, look.posterior.left),
        setups=linear.setups,
        groups=tuple(_group(one) for one in named if one.material and one.posterior < CERTAIN and one.rivals),
        not_testable=look.naming.not_testable(look.state, look.posterior),
        next_test=next_test,
        repeated=all(block.measured for block in linear.blocks),
        level=look.state.level,
        doubts=tuple(doubts),
        curves=curves_of(linear.blocks, before, after),
        maps=maps_of(linear.blocks, before, after),
        seconds=time.perf_counter() - begin_s,
    )


def _hold_enough(runs: Sequence[Seen]) -> None:
    """Raises FileError where there are fewer readings than terms of the set-ups."""
    terms = sum({run.one.setup: terms_of(run.one.table) for run in runs}.values())
    if (count := sum(run.one.values.size for run in runs)) < terms:
        raise FileError("RUN…", f"{count} readings are fewer than the {terms} terms of the set-up", "give more runs")


def _names(runs: Sequence[Measured]) -> list[str]:
    return [run.run.manifest.name for run in runs]


def _named(look: Look, k: int, limits: Array, gain: float | None, gap_without_um: float) -> Named:
    """One name with what it is worth; one that makes runs left out worse, or that is no larger than arms like this one
    show of it, is not material, whatever it moves."""
    effects, rivalry = look.state.refined.effects, look.rivalries[k]
    rest = [effect for other, effect in enumerate(effects) if other != k]
    own = worth(look.linear, look.linear.left(rest) - look.state.refined.left)
    size = abs(float(getattr(effects[k], size_field(effects[k])))) / healthy_size(effects[k])
    fault = size > FAULT * look.state.level
    material = fault and own.is_material(limits) and (gain is None or gain > 0) and rivalry.odds > LIKELY
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


def _swinging(found: Swing, limits: Array, gap_um: float) -> Named:
    """A swing of the link: its phase is new in each run, so no model takes it out of the readings."""
    moves = Worth(np.full(len(limits), 1e3 * found.amplitude_mm / np.sqrt(2)))
    odds = 1 / (1 + float(np.exp(-min(found.gain, 50.0))))
    return Named(
        found.effect, found.sd, odds, (), gap_um, found.effect.remedy(), moves.whole_um, moves.is_material(limits), None
    )


def _remainder(look: Look, limits: Array) -> tuple[Remainder, bool]:
    """What is left beyond the noise, and whether readings move by it as by a material name."""
    linear, posterior = look.linear, look.posterior
    strength = look.state.strength[look.naming.columns.band]
    beyond = np.sqrt(np.clip(1 - 1 / np.maximum(strength, 1.0), 0.0, 1.0))
    left = plain_worth(linear, beyond * posterior.left)
    gap_um = worth(linear, look.first).whole_um
    share = min(1.0, (left.whole_um / gap_um) ** 2) if gap_um else 0.0
    healthy = worth(linear, posterior.healthy_share)
    is_material = left.is_material(limits)
    words = _in_words(look) if is_material else "no more than noise, scatter and a healthy arm give"
    return Remainder(left.whole_um, share, words, healthy.whole_um), is_material


def _in_words(look: Look) -> str:
    first = leftovers(look.linear.blocks, look.posterior.left)[:1]
    where = [f"{one.test}{f' {one.direction}' * bool(one.direction)}, {one.part}: {one.words}" for one in first]
    form = strangest(look.linear, look.posterior)
    return "; ".join([*where, f"it looks like {form.words}" if form.gain > 0 else "it has no simple form"])


def _verdict(look: Look, found: Sequence[Named], left: Remainder, *, is_material: bool) -> tuple[Verdict, str]:
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
    doubtful = [one for one in material if one.posterior < CERTAIN]
    if doubtful:
        name = name_of(doubtful[0].effect)
        rivals = f"these tests do not tell {name} from its rivals"
        return "ambiguous", rivals if doubtful[0].rivals else f"{name} is likely, and not certain"
    return "named", "each name explains what no other does"


def _next_test(rig: Rig, named: Sequence[Named], used: Sequence[Measured]) -> tuple[NextTest | None, list[str]]:
    """The test that parts the first doubtful name from its nearest rival best; a doubt where there is none."""
    one = next((one for one in named if one.material and one.posterior < CERTAIN and one.rivals), None)
    if one is None:
        return None, []
    tests = tuple(dict.fromkeys(run.run.manifest.test for run in used))
    try:
        further = parting(rig, (one.effect, one.rivals[0].effect), tests)
    except FileError as error:
        return None, [f"no further test could be tried on this rig file: {error}"]
    if not further or not parts(further[0].sigma):
        return None, [f"no other test parts {name_of(one.effect)} from its rivals: their corrections do the same"]
    return NextTest(further[0].test, further[0].why, further[0].sigma), []


def _group(one: Named) -> tuple[str, ...]:
    return (name_of(one.effect), *(name_of(rival.effect) for rival in one.rivals))

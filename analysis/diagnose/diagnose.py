"""From runs to a diagnosis: find the disagreement, name the missing effect, add it, prove that the gap shrinks.

runs → blocks (whitened) → names by evidence, defended on the simulator → verdict, proof, what to do
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from analysis.diagnose.candidates import name_of
from analysis.diagnose.curves import curves_of, maps_of
from analysis.diagnose.diagnosis import Diagnosis, Gap, Named, NextTest, Verdict
from analysis.diagnose.doubts import doubts_of_rig, doubts_of_runs
from analysis.diagnose.explain import Explained
from analysis.diagnose.leftover import leftovers
from analysis.diagnose.locate import places
from analysis.diagnose.look import Look, looked
from analysis.diagnose.observed import Seen
from analysis.diagnose.parting import parting
from analysis.diagnose.proof import gap, judged, without
from analysis.diagnose.runs import about
from analysis.diagnose.signatures import parts
from analysis.reading.loading import Measured
from rigs.effects import Effect
from rigs.rig import Rig

_GROWN = 1.02
"""A gap that grows by more than this with its names is none that they explain."""
_ENOUGH = 3
"""Readings for each set-up term, at least, without which nothing can be told."""


def diagnose(
    rig: Rig,
    used: Sequence[Measured],
    held_out: Sequence[Measured],
    unseen: Sequence[Measured],
    progress: Callable[[str], None],
) -> Diagnosis:
    """Diagnose runs of one robot beside the model of a rig; judge on runs left out and at an unseen place.

    Raises FileError for runs of another robot, or that cannot be read as what they say.
    """
    begin_s = time.perf_counter()
    progress("reading the runs")
    runs = about(rig, used)
    look = looked(runs, progress)
    progress("proving it on runs left out")
    decided = _decided(look, runs, [run.run.manifest.name for run in used])
    others = [judged(rig, them, decided.kept, look.linear.blocks) for them in (held_out, unseen)]
    if decided.verdict == "ambiguous":
        progress("which test would part the rivals")
        decided = _with_next_test(decided, rig, look.found, used)
    doubts = (*doubts_of_runs(look), *doubts_of_rig(rig, runs))
    return _told(rig, runs, look, decided, others, doubts, begin_s)


@dataclass(frozen=True)
class _Decided:
    """The verdict and why; the effects that stand by it; the gap on the runs used; the test that would part rivals."""

    verdict: Verdict
    why: str
    kept: tuple[Effect, ...]
    train: Gap
    next_test: NextTest | None = None


def _decided(look: Look, runs: Sequence[Seen], names: Sequence[str]) -> _Decided:
    """The verdict on what was found, which the gap may withdraw."""
    verdict, why = _verdict(look)
    kept = look.found.refined.effects if verdict in ("named", "ambiguous") else ()
    train = gap(runs, kept, look.linear.blocks, names)
    if train.after_um <= _GROWN * train.before_um:
        return _Decided(verdict, why, kept, train)
    grows = "with the names found the gap grows instead of shrinking"
    return _Decided("outside_library", grows, (), gap(runs, (), look.linear.blocks, names))


def _told(
    rig: Rig,
    runs: Sequence[Seen],
    look: Look,
    decided: _Decided,
    others: Sequence[Gap | None],
    doubts: tuple[str, ...],
    begin_s: float,
) -> Diagnosis:
    """All that was found; others: the gap on runs left out and at an unseen place."""
    linear, refined, kept = look.linear, look.found.refined, decided.kept
    named = _named(look, decided, runs)
    before = linear.in_mm(linear.y)
    after = linear.in_mm(refined.left) if kept else before
    return Diagnosis(
        verdict=decided.verdict,
        why=decided.why,
        rig=rig,
        runs=decided.train.runs,
        where=places(linear.blocks, before),
        effects=named,
        train=decided.train,
        held_out=others[0],
        unseen=others[1],
        left=leftovers(linear.blocks, refined.left, look.found.background),
        setups=refined.setups if kept else linear.setups,
        groups=tuple(_group(one) for one in named if one.rivals and decided.verdict == "ambiguous"),
        not_testable=look.search.not_testable,
        next_test=decided.next_test,
        repeated=look.repeated,
        level=look.found.level,
        doubts=doubts,
        curves=curves_of(linear.blocks, before, after),
        maps=maps_of(linear.blocks, before, after),
        seconds=time.perf_counter() - begin_s,
    )


def _verdict(look: Look) -> tuple[Verdict, str]:
    found, terms = look.found, look.linear.U.shape[1]
    if not look.search.testable.any() or len(look.linear.y) < _ENOUGH * terms:
        return "not_testable_here", "these runs leave no reading free that could tell one effect from the set-up"
    if look.foreign is not None:
        like = f"; it looks like {look.foreign}" if look.foreign else ""
        return "outside_library", f"something is there that no effect of the vocabulary explains{like}"
    if not found.names and not look.swing:
        return "within_tolerance", "nothing stands out of the noise and of what a healthy arm shows anyway"
    if found.doubtful:
        return "ambiguous", f"these tests do not tell {found.names[found.doubtful[0]]} from its rivals"
    return "named", "each name explains what no other does"


def _named(look: Look, decided: _Decided, runs: Sequence[Seen]) -> tuple[Named, ...]:
    """The names found, also those that are withdrawn, and a swing beside them."""
    found, train = look.found, decided.train
    told = () if decided.verdict == "not_testable_here" else found.refined.effects
    gaps_um = [
        without(runs, decided.kept, k, found.refined.setups) if decided.kept else train.before_um
        for k in range(len(told))
    ]
    named = [
        Named(effect, found.refined.sd(k), share, rivals, gaps_um[k], effect.remedy())
        for k, (effect, share, rivals) in enumerate(zip(told, found.posterior, found.rivals, strict=False))
    ]
    if look.swing:
        # It begins anew with every run, so no model takes it out of the readings.
        swing = look.swing
        named.append(Named(swing.effect, swing.sd, 1.0, (), train.after_um, swing.effect.remedy()))
    return tuple(named)


def _with_next_test(decided: _Decided, rig: Rig, found: Explained, used: Sequence[Measured]) -> _Decided:
    """With the test that parts the first doubtful name from its nearest rival best, or that none does."""
    place = found.doubtful[0]
    rivals = (found.refined.effects[place], found.rivals[place][0].effect)
    tests = tuple(dict.fromkeys(run.run.manifest.test for run in used))
    further = parting(rig, rivals, tests)
    if not further or not parts(further[0].sigma):
        return replace(decided, why=decided.why + "; no other test parts them either, so their corrections do the same")
    return replace(decided, next_test=NextTest(further[0].test, further[0].why, further[0].sigma))


def _group(one: Named) -> tuple[str, ...]:
    return (name_of(one.effect), *(name_of(rival.effect) for rival in one.rivals))

"""From runs to a diagnosis: find the disagreement, name the missing effect, add it, prove that the gap shrinks.

runs → blocks with their noise → names by evidence, refined on the simulator → what each is worth → verdict and proof
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from analysis.diagnosis.arrivals import early_readings
from analysis.diagnosis.curves import curves_of, maps_of
from analysis.diagnosis.diagnosis import Diagnosis, Named, NextTest
from analysis.diagnosis.doubts import doubts_of_rig, doubts_of_runs
from analysis.diagnosis.foresight import parts
from analysis.diagnosis.leftover import leftovers
from analysis.diagnosis.locate import places
from analysis.diagnosis.look import Look, looked
from analysis.diagnosis.neighbourhoods import without_a_fold
from analysis.diagnosis.observed import Seen
from analysis.diagnosis.parting import parting
from analysis.diagnosis.prepared_runs import about
from analysis.diagnosis.proof import gain_of_each, gap
from analysis.diagnosis.settle import grown
from analysis.diagnosis.swing import swing
from analysis.diagnosis.verdict import doubtful, names_of, remainder_of, swinging, verdict_of
from analysis.diagnosis.worth import limits_um
from analysis.fitting.setups import terms_of
from analysis.traces.loading import Measured
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import name_of


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
    (runs, judges, elsewhere), placed = about(rig, used, held_out, unseen)
    if not judges:
        runs, judges = without_a_fold(runs)
    _hold_enough(runs)
    look = looked(runs, progress)
    progress("proving it on runs left out")
    train = gap(runs, look, _names(used))
    outside = [
        gap(them, look, names) if them else None
        for them, names in ((judges, _names(held_out or used)), (elsewhere, _names(unseen)))
    ]
    limits = limits_um(look.linear, tolerance_um)
    named = names_of(look, runs, gain_of_each(look, judges), limits)
    circles = [block.sampling is not None for block in look.linear.blocks]
    found = swing(grown(runs, look.state.refined.effects), look.linear.setups)
    named += swinging(found, limits[circles], train.after_um)
    named.sort(key=lambda one: (not one.material, -one.worth_um))
    remainder, is_material = remainder_of(look, limits)
    verdict, why = verdict_of(look, named, remainder, is_material=is_material)
    doubts = [*placed, *early_readings(look), *doubts_of_runs(look.linear.blocks), *doubts_of_rig(rig, runs)]
    next_test = None
    if verdict == "ambiguous":
        progress("which test would part the rivals")
        next_test, doubt = _next_test(rig, named, used, look)
        doubts += doubt
    linear, before = look.linear, look.linear.in_mm(look.first)
    after = linear.in_mm(look.left)
    return Diagnosis(
        verdict=verdict,
        why=why,
        rig=rig,
        runs=train.runs,
        where=places(linear.blocks, before),
        effects=() if verdict == "not_testable_here" else tuple(named),
        remainder=remainder,
        train=train,
        held_out=outside[0],
        unseen=outside[1],
        left=leftovers(linear.blocks, look.posterior.left),
        setups=linear.setups,
        groups=tuple(_group(one) for one in doubtful(named) if one.rivals),
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


def _next_test(
    rig: Rig, named: Sequence[Named], used: Sequence[Measured], look: Look
) -> tuple[NextTest | None, list[str]]:
    """The test that, beside the runs there are, parts the first doubtful name from its nearest rival best; a doubt
    where there is none."""
    one = next((one for one in doubtful(named) if one.rivals), None)
    if one is None:
        return None, []
    tests = tuple(dict.fromkeys(run.run.manifest.test for run in used))
    rivals, linear = (one.effect, one.rivals[0].effect), look.linear
    try:
        further = parting(rig, rivals, tests, linear.blocks, linear.setups, look.state.level)
    except FileError as error:
        return None, [f"no further test could be tried on this rig file: {error}"]
    if not further:
        return None, ["no further test could be tried on this rig file"]
    if not parts(further[0].sigma):
        return None, [f"no other test parts {name_of(one.effect)} from its rivals: their corrections do the same"]
    return NextTest(further[0].test, further[0].why, further[0].sigma), []


def _group(one: Named) -> tuple[str, ...]:
    return (name_of(one.effect), *(name_of(rival.effect) for rival in one.rivals))

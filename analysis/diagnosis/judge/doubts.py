"""Doubts about a diagnosis: about the runs, about sizes at the limit of fits, and about effects of the rig file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.evidence.observation import rms
from analysis.diagnosis.evidence.setups import FittedRuns, fit_run_setups
from analysis.diagnosis.fit.refine import ended_at_limit
from analysis.diagnosis.judge.named import Named
from analysis.diagnosis.judge.verdict import shows_time
from analysis.procedures.shared.test_kind import kind_of, labels_of
from analysis.robot.kinematics.arm import rail_mm
from rigs.effect_names import name_in_words
from rigs.rig import Rig
from rigs.schema.controllers import practice_of
from rigs.schema.effect import label_of

_BETTER = 0.97
"""Ratio of the residual without an effect of the rig file to that with it, below which the effect is doubted. Chosen: a
refitted set-up gains less by chance.
"""


def doubts_of_runs(blocks: Sequence[Block]) -> tuple[str, ...]:
    doubts = []
    circles = [block for block in blocks if block.sampling]
    if circles and not circles[0].measured:
        slow = "" if shows_time(blocks) else ", and one lap cannot show slow changes such as warming"
        doubts.append(f"every circle was driven once: the noise of real cells is assumed{slow}; repeat each circle")
    if driven_once := ", ".join(block.name for block in circles if block.measured and block.count < 2):
        doubts.append(f"{driven_once} was driven once: its noise is assumed equal to that of the other circles")
    unrepeated = [block for block in blocks if not block.sampling and not block.measured]
    once = {block.name: block.shows_noise for block in unrepeated if not labels_of(block.table.test).no_repeats}
    doubts += [words for block in unrepeated if (words := labels_of(block.table.test).no_repeats)]
    for name, shows in once.items():
        scatter = "estimated from the residuals of the model" if shows else "assumed"
        doubts.append(
            f"no target of {name} was measured twice, so the scatter is {scatter}; measure some targets twice"
        )
    ways: dict[str, set[str]] = {}
    for block in blocks:
        table = block.table
        doubts += kind_of(table.test).doubts(table, block.model, block.name)
        if direction := table.driven_direction:
            ways.setdefault(table.test, set()).add(direction)
    rails = [rail_mm(block.model.arm, block.table.q) for block in blocks if block.model.arm.rail is not None]
    if rails and np.ptp(stands := np.concatenate(rails)) == 0:
        doubts.append(f"the rail was at {stands[0]:g} mm throughout, so the rail is not tested; measure along the rail")
    for test, way in [(test, next(iter(seen))) for test, seen in ways.items() if len(seen) == 1]:
        doubts.append(f"{test} was driven {way} only: effects that change with the direction cannot be detected")
    if not circles:
        sides = any(block.table.sides is not None for block in blocks)
        back = "" if sides else " or on reversals"
        doubts.append(
            f"the robot was at rest at every reading, so errors that depend on speed{back} are barely visible"
        )
    no_scale = {labels_of(block.table.test).no_scale * (not block.model.rig.tests.distances) for block in blocks}
    if len(blocks) > 1 and "" not in no_scale:
        doubts += no_scale
    return tuple(dict.fromkeys(doubts))  # each socket of a run is a separate block


def doubts_of_limits(names: Sequence[Named]) -> tuple[str, ...]:
    doubts = []
    for named in names:
        if named.is_confirmed and ended_at_limit(named.effect):
            doubts.append(
                f"the {name_in_words(label_of(named.effect))} reached the size limit and is unreliable: "
                "check the rig file, the cables of the gauges and the placements, and repeat the diagnosis"
            )
    return tuple(doubts)


def doubts_of_rig(rig: Rig, fitted: FittedRuns) -> tuple[str, ...]:
    """Doubt missing constants of a controller, and each effect of the rig file without which the model fits better."""
    doubts = []
    practice = practice_of(rig.maker or rig.robot.name)
    if practice and practice.own_constants == "always" and rig.controller == "unknown" and rig.reference.is_data_sheet:
        doubts.append(
            "a difference from the data sheet is normal for this maker: each robot has its own constants; repeat the "
            f"diagnosis with --calibration FILE: {practice.get}"
        )
    if not rig.effects:
        return tuple(doubts)
    whole = rms(fitted.fit_with_effects(())[1])
    for k, effect in enumerate(rig.effects):
        bare = (*rig.effects[:k], *rig.effects[k + 1 :])
        without = rms(fit_run_setups([replace(run, model=replace(run.model, effects=bare)) for run in fitted.runs])[1])
        if without < _BETTER * whole:
            doubts.append(
                f"the model fits better without the {name_in_words(label_of(effect))} of the rig file (error "
                f"{1e3 * without:.1f} instead of {1e3 * whole:.1f} µm): remove it and repeat the diagnosis"
            )
    return tuple(doubts)

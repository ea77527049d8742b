"""Wild readings at targets and poses, which no effect explains: they are counted, and judge no model.

Names are selected with robust weights, so that a wild reading has little influence there. An rms has no such weights: a
single pose that was 25 mm wrong among those held out made a right name one that makes them worse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.observed_run import ObservedRun
from analysis.diagnosis.run_setups import fit_run_setups, with_effects
from analysis.fitting.observation import Observation, residuals_of
from analysis.fitting.split import part
from analysis.kinematics.arm import Array, Mask
from analysis.noise.cell import TARGET_MM
from analysis.noise.wild import by_accident
from analysis.traces.tables import CircleTable, PoseTable
from rigs.effects import Effect

_SPREADS, _NEAR = 10.0, 2.5
"""Robust standard deviations from which a reading is wild, and up to which it counts while set-ups are fitted; they are
taken to be at least the largest of real cells, 0.06 mm. Chosen: as for the sphere of a radial test, and usual."""
_STEPS = 4
"""Number of fits of the set-ups, each to the readings that are near after the one before (Rousseeuw's concentration
steps): fitted to all of them, the set-up of one wild reading in nine hid them."""


def without_wild(
    runs: Sequence[ObservedRun], effects: Sequence[Effect], use: str
) -> tuple[list[ObservedRun], list[str]]:
    """Return runs without the readings (m, k) mm at targets and poses that lie far from all others beside a model with
    `effects`, those that have others, and a message for each set-up with wild ones; `use` says in it what the runs are
    for."""
    targets = [k for k, run in enumerate(runs) if not isinstance(run.one.table, CircleTable)]
    sound, far_mm, shared = list(runs), dict[str, float](), list[str]()
    away = _away(with_effects([runs[k] for k in targets], effects)) if targets else []
    kept = _no_accidents([runs[k] for k in targets], [spreads > _SPREADS for _, spreads in away])
    for k, (distance_mm, spreads) in zip(targets, away, strict=True):
        one, wild = runs[k].one, spreads > _SPREADS
        if one.setup in kept:
            if wild.any():
                shared.append(_shared(one, int(wild.sum()), float(distance_mm.max())))
            continue
        sound[k] = replace(runs[k], one=part(one, ~wild))
        if wild.any():
            far_mm[one.setup] = max(far_mm.get(one.setup, 0.0), float(distance_mm.max()))
    doubts = [_message(runs, sound, setup, most_mm, use) for setup, most_mm in far_mm.items()]
    return [run for run in sound if len(run.one.rows)], [*shared, *doubts]


def _no_accidents(runs: Sequence[ObservedRun], wild: Sequence[Mask]) -> set[str]:
    """Return the set-ups whose poses that are `wild` (m,) are too many for accidents, or have a range of a joint to
    themselves. Readings of a gauge at targets are no such: a robot that is read while it moves is wild at many."""
    poses = [k for k, run in enumerate(runs) if isinstance(run.one.table, PoseTable)]
    found = set()
    for setup in dict.fromkeys(runs[k].one.setup for k in poses):
        own = [k for k in poses if runs[k].one.setup == setup]
        angles = np.concatenate([runs[k].one.table.q[runs[k].one.rows] for k in own])
        if not by_accident(np.concatenate([wild[k] for k in own]), angles):
            found.add(setup)
    return found


def _away(runs: Sequence[ObservedRun]) -> list[tuple[Array, Array]]:
    """Return how far the readings (m,) of each run are from the model, in mm and in robust standard deviations of their
    set-up, with set-ups fitted to those that are near."""
    near: list[Mask] = [np.ones(len(run.one.rows), dtype=bool) for run in runs]
    found: list[tuple[Array, Array]] = []
    for _ in range(_STEPS):
        those = [replace(run, one=part(run.one, mask)) for run, mask in zip(runs, near, strict=True)]
        setups, _ = fit_run_setups(those)
        distances = [np.linalg.norm(residuals_of(run.model, [run.one], setups)[0], axis=1) for run in runs]
        sd_mm = {}
        for setup in setups:
            every = [mm for run, mm in zip(runs, distances, strict=True) if run.one.setup == setup]
            sd_mm[setup] = max(1.4826 * float(np.median(np.concatenate(every))), TARGET_MM.high)
        found = [(mm, mm / sd_mm[run.one.setup]) for run, mm in zip(runs, distances, strict=True)]
        near = [spreads <= _NEAR for _, spreads in found]
    return found


def _shared(one: Observation, far: int, most_mm: float) -> str:
    """Return what a person should know of readings that are far off and no accident."""
    return (
        f"{far} of {len(one.rows)} readings of {one.setup} lie far from all others, up to {most_mm:.1f} mm, and are "
        "not left out: so many, or all in one range of a joint, are no lost points; check the signs, order and zeros "
        "of the joints, and whether instrument or base moved"
    )


def _message(runs: Sequence[ObservedRun], sound: Sequence[ObservedRun], setup: str, most_mm: float, use: str) -> str:
    """Return what a person should know of the wild readings of a set-up."""
    own = [k for k, run in enumerate(runs) if run.one.setup == setup]
    count = sum(len(runs[k].one.rows) for k in own)
    wild = count - sum(len(sound[k].one.rows) for k in own)
    if isinstance(runs[own[0]].one.table, PoseTable):
        what, check = f"poses of {setup}", "check that the robot stood and that the tracker had the target"
    else:
        what = f"readings at the targets of {setup}"
        check = "check that the robot stands while it is read, that the clocks agree, and that the plunger touches"
    are = "is wild" if wild == 1 else "are wild"
    return f"{wild} of {count} {what} {are}, up to {most_mm:.1f} mm off, and not counted in the rms of {use}: {check}"

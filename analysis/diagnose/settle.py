"""Set-ups fitted to runs, the model frozen: before anything is diagnosed, and wherever a model is judged.

Gauss-Newton in short steps: a set-up is off by a millimetre or so, and readings are nearly straight in that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnose.linear import nudged, terms_of
from analysis.diagnose.observed import Seen
from analysis.fitting.estimate import first_setups
from analysis.fitting.observation import residuals_of
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from analysis.reading.tables import PoseTable
from rigs.effects import Effect

_STEP = 0.01
_ROUNDS = 12
_ENOUGH = 1e-4
_FURTHEST_MM = 1.0
"""No step of a ball goes further: at the centre of a circle its height does nothing, and the derivatives know no bound
for it. An instrument begins far off, and has nothing of the kind."""
_BALL_MM = 5.0
"""How far a ball may be off its place: decides only what readings do not, its height above a circle's plane."""
_STRAIGHT_MM = 0.2
"""A step larger than this changes the derivatives."""


def settled(
    runs: Sequence[Seen], effects: Sequence[Effect] = (), setups: Mapping[str, SetUp] | None = None
) -> tuple[dict[str, SetUp], list[Array]]:
    """Set-ups of runs with effects added to their models, and residuals (m, k) mm of each; `setups`: to begin at."""
    grown = [replace(run, model=replace(run.model, effects=(*run.model.effects, *effects))) for run in runs]
    placed = dict(setups or _first(grown))
    names = dict.fromkeys(run.one.setup for run in grown)
    for name in names:
        placed[name] = _placed([run for run in grown if run.one.setup == name], placed[name])
    return {name: placed[name] for name in names}, [_residual(run, placed[run.one.setup]) for run in grown]


def _first(runs: Sequence[Seen]) -> dict[str, SetUp]:
    found: dict[str, SetUp] = {}
    for run in runs:
        found = first_setups(run.model, [run.one]) | found
    return found


def _residual(run: Seen, setup: SetUp) -> Array:
    return residuals_of(run.model, [run.one], {run.one.setup: setup})[0]


def _placed(runs: Sequence[Seen], setup: SetUp) -> SetUp:
    poses = isinstance(runs[0].one.table, PoseTable)
    count = terms_of(setup, poses)
    start = setup
    moved = np.zeros(count)
    ball = np.array([k < 3 and not poses for k in range(count)])
    J = np.empty(0)
    change = np.zeros(count)
    for turn in range(_ROUNDS):
        r = np.concatenate([_residual(run, setup).ravel() for run in runs])
        if turn < 2 or np.abs(change).max() > _STRAIGHT_MM:
            columns = []
            for term in range(count):
                changed = nudged(setup, poses, term, _STEP)
                there = np.concatenate([_residual(run, changed).ravel() for run in runs])
                columns.append((r - there) / _STEP)
            J = np.stack(columns, axis=1)
        # A ball as far off as it may be costs as much as what is left now: far from the end it is held the firmer.
        held = np.where(ball, (r @ r) / _BALL_MM**2, 1e-12)
        change = np.linalg.solve(J.T @ J + np.diag(held), J.T @ r - held * moved)
        if not poses:
            change *= min(1.0, _FURTHEST_MM / max(float(np.abs(change).max()), 1e-12))
        moved = moved + change
        setup = start
        for term, step in enumerate(moved):
            setup = nudged(setup, poses, term, float(step))
        if np.abs(change).max() < _ENOUGH:
            break
    return setup

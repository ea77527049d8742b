"""Set-ups: what they consist of, how they are changed, and how they are fitted while a model is frozen.

A set-up's terms are numbers in mm: ball and zeros; for poses where the instrument stands, how it is turned (mm at
100 mm's distance) and where its target sits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.fitting.observation import Observation, predicted, seen
from analysis.fitting.rigid import best_rigid, moved_by
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp, moved, nominal_setup
from analysis.reading.tables import CircleTable, PoseTable, Table

_REACH_MM = 100.0
"""At which a turn of an instrument is told in mm."""
_STEP_MM = 0.01
_ROUNDS = 12
_ENOUGH_MM = 1e-4
_FURTHEST_MM = 1.0
"""No step of a ball goes further: at the centre of a circle its height does nothing, and the derivatives know no bound
for it. An instrument begins far off, and has nothing of the kind."""
BALL_MM = 5.0
"""How far a ball may be off its place: a weak prior that decides only what readings do not, such as its height above a
circle's plane, where a wrong model would push it far away."""
_STRAIGHT_MM = 0.2
"""A step larger than this changes the derivatives."""


FRAME_TERMS = 6
"""The first terms of a pose set-up, the instrument's; the others are the tool's, which all placements share."""


def terms_of(table: Table) -> int:
    """How many terms a set-up has in a table's test."""
    if isinstance(table, PoseTable):
        return 9
    return 5 if isinstance(table, CircleTable) else 4


def moved_setup(setup: SetUp, table: Table, change: Array) -> SetUp:
    """A set-up with its terms changed by (terms,) mm."""
    if isinstance(table, PoseTable):
        target = setup.T_tool_target.copy()
        target[:3, 3] += change[6:9]
        instrument = moved_by(setup.T_instrument_world, change[:3], change[3:6] / _REACH_MM)
        return replace(setup, T_instrument_world=instrument, T_tool_target=target)
    return replace(setup, ball=setup.ball + change[:3], zeros_mm=setup.zeros_mm + change[3:])


def begun(model: Model, observations: Sequence[Observation]) -> dict[str, SetUp]:
    """Set-ups to begin a fit with, each settled by itself; placements of poses have the tool of the one with most."""
    named: dict[str, list[Observation]] = {}
    for one in observations:
        named.setdefault(one.setup, []).append(one)
    count = {name: sum(one.values.size for one in own) for name, own in named.items()}
    poses = [name for name, own in named.items() if isinstance(own[0].table, PoseTable)]
    most = max(poses, key=lambda name: count[name], default=None)
    alone = [name for name in named if name == most or name not in poses]
    found = settled([(model, one) for name in alone for one in named[name]])
    for name in poses:
        if name != most and most is not None:
            bare = replace(found[most], T_instrument_world=np.eye(4))
            places = np.concatenate([predicted(model, one, bare) for one in named[name]])
            seen_there = np.concatenate([one.values for one in named[name]])
            found[name] = replace(bare, T_instrument_world=best_rigid(places, seen_there))
    return found


def settled(parts: Sequence[tuple[Model, Observation]], setups: Mapping[str, SetUp] | None = None) -> dict[str, SetUp]:
    """Set-ups fitted to observations, each with its model as it is. `setups`: where to begin.

    Gauss-Newton in short steps: a set-up is off by a millimetre or so, and readings are nearly straight in that.
    """
    named: dict[str, list[tuple[Model, Observation]]] = {}
    for model, one in parts:
        named.setdefault(one.setup, []).append((model, one))
    begun = setups or {}
    return {name: _placed(own, begun[name] if name in begun else _begun(*own[0])) for name, own in named.items()}


def _begun(model: Model, one: Observation) -> SetUp:
    """A set-up as it was meant, an instrument's place by its readings."""
    setup = nominal_setup(model.rig, one.table)
    if isinstance(one.table, PoseTable):
        return replace(setup, T_instrument_world=best_rigid(predicted(model, one, setup), one.values))
    return setup


def _placed(parts: Sequence[tuple[Model, Observation]], start: SetUp) -> SetUp:
    table = parts[0][1].table
    poses, count = isinstance(table, PoseTable), terms_of(table)
    scenes = [moved(model, one.path) for model, one in parts]

    def left(change: Array) -> Array:
        setup = moved_setup(start, table, change)
        return np.concatenate([
            (one.values - seen(model, one, scene, setup)).ravel()
            for (model, one), scene in zip(parts, scenes, strict=True)
        ])  # fmt: skip

    ball = np.arange(count) < (0 if poses else 3)
    so_far, change, J = np.zeros(count), np.zeros(count), np.empty(0)
    for turn in range(_ROUNDS):
        r = left(so_far)
        if turn < 2 or np.abs(change).max() > _STRAIGHT_MM:
            steps = so_far + _STEP_MM * np.eye(count)
            J = np.stack([(r - left(at)) / _STEP_MM for at in steps], axis=1)
        # A ball as far off as it may be costs as much as what is left now: far from the end it is held the firmer.
        held = np.where(ball, (r @ r) / BALL_MM**2, 1e-12)
        change = np.linalg.solve(J.T @ J + np.diag(held), J.T @ r - held * so_far)
        if not poses:
            change *= min(1.0, _FURTHEST_MM / max(float(np.abs(change).max()), 1e-12))
        so_far = so_far + change
        if np.abs(change).max() < _ENOUGH_MM:
            break
    return moved_setup(start, table, so_far)

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
from analysis.traces.tables import CircleTable, PoseTable, Table

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

Parts = Sequence[tuple[Model, Observation]]


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


def columns_of(tables: Mapping[str, Table]) -> dict[str, list[int]]:
    """Which unknowns are the terms of each set-up; all placements of poses share the tool's."""
    columns: dict[str, list[int]] = {}
    tool: list[int] = []
    count = 0
    for name, table in tables.items():
        poses = isinstance(table, PoseTable)
        own = list(range(count, count + (FRAME_TERMS if poses else terms_of(table))))
        count += len(own)
        if poses and not tool:
            tool = list(range(count, count + terms_of(table) - FRAME_TERMS))
            count += len(tool)
        columns[name] = own + tool * poses
    return columns


def settled(parts: Parts, setups: Mapping[str, SetUp] | None = None) -> dict[str, SetUp]:
    """Set-ups fitted to observations, each with its model as it is. `setups`: where to begin.

    Gauss-Newton in short steps: a set-up is off by a millimetre or so, and readings are nearly straight in that.
    Placements of poses are fitted together, with one tool.
    """
    named: dict[str, list[tuple[Model, Observation]]] = {}
    for model, one in parts:
        named.setdefault(one.setup, []).append((model, one))
    begun = {name: setups[name] for name in named if setups and name in setups}
    poses = [name for name, own in named.items() if isinstance(own[0][1].table, PoseTable)]
    begun |= _poses_begun({name: named[name] for name in poses}, begun)
    groups = [[name] for name in named if name not in poses] + [poses] * bool(poses)
    found: dict[str, SetUp] = {}
    for group in groups:
        starts = {
            name: begun.get(name) or nominal_setup(named[name][0][0].rig, named[name][0][1].table) for name in group
        }
        found |= _placed([part for name in group for part in named[name]], starts)
    return {name: found[name] for name in named}


def _poses_begun(named: Mapping[str, Parts], begun: Mapping[str, SetUp]) -> dict[str, SetUp]:
    """Placements of poses that nobody has placed yet: with the tool of one that is, or else of that with most poses;
    instruments where their readings have them."""
    new = [name for name in named if name not in begun]
    if not new:
        return {}
    found: dict[str, SetUp] = {}
    known = next((begun[name] for name in named if name in begun), None)
    if known is None:
        most = max(new, key=lambda name: sum(one.values.size for _, one in named[name]))
        model, one = named[most][0]
        start = _at_instrument(nominal_setup(model.rig, one.table), named[most])
        known = _placed(named[most], {most: start})[most] if len(new) > 1 else start
        found[most] = known
    return found | {name: _at_instrument(known, named[name]) for name in new if name not in found}


def _at_instrument(setup: SetUp, parts: Parts) -> SetUp:
    """A set-up with its instrument where poses were seen from."""
    bare = replace(setup, T_instrument_world=np.eye(4))
    places = np.concatenate([predicted(model, one, bare) for model, one in parts])
    seen_there = np.concatenate([one.values for _, one in parts])
    return replace(bare, T_instrument_world=best_rigid(places, seen_there))


def _placed(parts: Parts, starts: Mapping[str, SetUp]) -> dict[str, SetUp]:
    """Set-ups that share terms, fitted together from where they start."""
    tables = {one.setup: one.table for _, one in parts}
    columns = columns_of(tables)
    poses, count = isinstance(parts[0][1].table, PoseTable), 1 + max(map(max, columns.values()))
    scenes = [moved(model, one.path) for model, one in parts]

    def at(change: Array) -> dict[str, SetUp]:
        return {name: moved_setup(starts[name], table, change[columns[name]]) for name, table in tables.items()}

    def left(change: Array) -> Array:
        placed = at(change)
        return np.concatenate([
            (one.values - seen(model, one, scene, placed[one.setup])).ravel()
            for (model, one), scene in zip(parts, scenes, strict=True)
        ])  # fmt: skip

    ball = np.arange(count) < (0 if poses else 3)
    so_far, change, J = np.zeros(count), np.zeros(count), np.empty(0)
    for turn in range(_ROUNDS):
        r = left(so_far)
        if turn < 2 or np.abs(change).max() > _STRAIGHT_MM:
            J = np.stack([(r - left(step)) / _STEP_MM for step in so_far + _STEP_MM * np.eye(count)], axis=1)
        # A ball as far off as it may be costs as much as what is left now: far from the end it is held the firmer.
        held = np.where(ball, (r @ r) / BALL_MM**2, 1e-12)
        change = np.linalg.solve(J.T @ J + np.diag(held), J.T @ r - held * so_far)
        if not poses:
            change *= min(1.0, _FURTHEST_MM / max(float(np.abs(change).max()), 1e-12))
        so_far = so_far + change
        if np.abs(change).max() < _ENOUGH_MM:
            break
    return at(so_far)

"""Set-ups: their terms, how they are changed, and how they are fitted while a model is frozen.

The terms of a set-up are numbers in mm: the ball's position and the zeros of the gauges; for poses the position of the
instrument, its rotation (in mm at a distance of 100 mm) and the position of its target.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from analysis.fitting.observation import Observation, predicted, predicted_in_scene
from analysis.geometry.rigid import best_rigid, moved_by
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp, moved, nominal_setup
from analysis.model.scene import Scene
from analysis.traces.tables import CircleTable, PoseTable, Table

_REACH_MM = 100.0
"""Distance at which the rotation of an instrument is expressed in mm. It scales the unknowns and has no effect on the
result."""
_STEP_MM = 0.01
"""Step of the derivatives by a set-up term. Readings are linear over such a step."""
_ROUNDS = 30
"""Largest number of Gauss-Newton steps. Chosen: a set-up 20 mm off needs twenty steps of 1 mm."""
_ENOUGH_MM = 1e-4
"""Change below which a set-up has converged: a tenth of a micrometre, below the resolution of any gauge."""
_FURTHEST_MM = 1.0
"""Longest step of a ball. Its height at the centre of a circle has no effect, so the derivatives do not bound it.
Instruments start far off and have no such term."""
BALL_MM = 5.0
"""Prior standard deviation of a ball's position: a weak prior that decides only what the readings do not determine,
such as the height above the plane of a circle, where a wrong model would move it far."""
_STRAIGHT_MM = 0.2
"""Step above which the derivatives are computed again. Chosen: a change of 0.2 mm turns the link by 0.2° at most."""


FRAME_TERMS = 6
"""Number of the first terms of a pose set-up, those of the instrument; the others are those of the tool, which all
placements share."""

Parts = Sequence[tuple[Model, Observation]]


def terms_of(table: Table) -> int:
    """Return the number of terms that a set-up of a table's test has."""
    if isinstance(table, PoseTable):
        return 9
    return 5 if isinstance(table, CircleTable) else 4


def moved_setup(setup: SetUp, table: Table, change: Array) -> SetUp:
    """Return a set-up with its terms changed by (terms,) mm."""
    if isinstance(table, PoseTable):
        target = setup.T_tool_target.copy()
        target[:3, 3] += change[6:9]
        instrument = moved_by(setup.T_instrument_world, change[:3], change[3:6] / _REACH_MM)
        return replace(setup, T_instrument_world=instrument, T_tool_target=target)
    return replace(setup, ball=setup.ball + change[:3], zeros_mm=setup.zeros_mm + change[3:])


def columns_of(tables: Mapping[str, Table]) -> dict[str, list[int]]:
    """Return the indices of the unknowns that are the terms of each set-up; all placements of poses share those of the
    tool."""
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


def tool_shift(one: Observation, before: Scene, after: Scene) -> Array:
    """Return how far (3,) mm the tool moves at the readings of an observation, on the mean, from one scene to another.

    The ball of a circle or hemisphere moves with it, because people set a ball up where the tool really goes round it.
    """
    rows = one.rows if one.path.alone else one.samples
    shift: Array = (after.T[rows, :3, 3] - before.T[rows, :3, 3]).mean(axis=0)
    return shift


def _starting_setups(parts: Parts) -> list[SetUp]:
    """Return where the ball of a circle or hemisphere may have been set up: moved as far as the model's effects move
    the tool, or at its nominal place, where it still is after a collision and in simulated runs.

    A fit could not find this by itself: a ball along the normal of its circle hardly shows, but where it stands decides
    how steep the link is. A zero that is wrong by 1.6° moved the circle by 18 mm.
    """
    model, one = parts[0]
    nominal = nominal_setup(model.rig, one.table)
    if not model.effects:
        return [nominal]
    shift = tool_shift(one, moved(replace(model, effects=()), one.path), moved(model, one.path))
    there = replace(nominal, ball=nominal.ball + shift)
    return [there, nominal] if np.abs(shift).max() > _FURTHEST_MM else [there]


def fit_setups(parts: Parts, setups: Mapping[str, SetUp] | None = None) -> dict[str, SetUp]:
    """Return set-ups fitted to observations of (m, k) mm, each with its model unchanged, starting from `setups` where
    given.

    The method is Gauss-Newton in short steps, since readings are nearly linear over a millimetre. Placements of poses
    are fitted together, with one tool.
    """
    named: dict[str, list[tuple[Model, Observation]]] = {}
    for model, one in parts:
        named.setdefault(one.setup, []).append((model, one))
    starting = {name: setups[name] for name in named if setups and name in setups}
    poses = [name for name, own in named.items() if isinstance(own[0][1].table, PoseTable)]
    starting |= _starting_pose_setups({name: named[name] for name in poses}, starting)
    found: dict[str, SetUp] = {}
    for name, own in named.items():
        if name not in poses:
            starts = [starting[name]] if name in starting else _starting_setups(own)
            fits = [_placed(own, {name: start})[name] for start in starts]
            found[name] = min(fits, key=partial(_energy, own)) if len(fits) > 1 else fits[0]
    if poses:
        together = [part for name in poses for part in named[name]]
        found |= _placed(together, {name: starting[name] for name in poses})
    return {name: found[name] for name in named}


def _energy(parts: Parts, setup: SetUp) -> float:
    """Return the sum of squares in mm² of what a set-up leaves of its observations."""
    return sum(float(np.sum((one.values - predicted(model, one, setup)) ** 2)) for model, one in parts)


def _starting_pose_setups(named: Mapping[str, Parts], starting: Mapping[str, SetUp]) -> dict[str, SetUp]:
    """Return starting set-ups for placements of poses without one: with the tool of a placement that has one, or else
    of that with most poses, and instruments where their readings place them."""
    new = [name for name in named if name not in starting]
    if not new:
        return {}
    found: dict[str, SetUp] = {}
    known = next((starting[name] for name in named if name in starting), None)
    if known is None:
        most = max(new, key=lambda name: sum(one.values.size for _, one in named[name]))
        model, one = named[most][0]
        start = at_instrument(nominal_setup(model.rig, one.table), named[most])
        known = _placed(named[most], {most: start})[most] if len(new) > 1 else start
        found[most] = known
    return found | {name: at_instrument(known, named[name]) for name in new if name not in found}


def at_instrument(setup: SetUp, parts: Parts) -> SetUp:
    """Return a set-up with its instrument at the place from which the poses, of (m, 3) mm, were measured: the best
    rigid motion, with the tool as it is."""
    bare = replace(setup, T_instrument_world=np.eye(4))
    places = np.concatenate([predicted(model, one, bare) for model, one in parts])
    seen_there = np.concatenate([one.values for _, one in parts])
    return replace(bare, T_instrument_world=best_rigid(places, seen_there))


def _placed(parts: Parts, starts: Mapping[str, SetUp]) -> dict[str, SetUp]:
    """Return set-ups that share terms, fitted together from their starting values."""
    tables = {one.setup: one.table for _, one in parts}
    columns = columns_of(tables)
    poses, count = isinstance(parts[0][1].table, PoseTable), 1 + max(map(max, columns.values()))
    scenes = [moved(model, one.path) for model, one in parts]

    def at(change: Array) -> dict[str, SetUp]:
        return {name: moved_setup(starts[name], table, change[columns[name]]) for name, table in tables.items()}

    def left(change: Array) -> Array:
        placed = at(change)
        return np.concatenate([
            (one.values - predicted_in_scene(model, one, scene, placed[one.setup])).ravel()
            for (model, one), scene in zip(parts, scenes, strict=True)
        ])  # fmt: skip

    ball = np.arange(count) < (0 if poses else 3)
    so_far, change, J = np.zeros(count), np.zeros(count), np.empty(0)
    for turn in range(_ROUNDS):
        r = left(so_far)
        if turn == 0 or np.abs(change).max() > _STRAIGHT_MM:
            J = np.stack([(r - left(step)) / _STEP_MM for step in so_far + _STEP_MM * np.eye(count)], axis=1)
        # A ball at the limit of its prior costs as much as what set-ups cannot fit. With all of the residual in place
        # of that, a ball that is a centimetre off would stay there.
        kept = r - J @ np.linalg.lstsq(J, r)[0]
        held = np.where(ball, (kept @ kept) / BALL_MM**2, 1e-12)
        change = np.linalg.solve(J.T @ J + np.diag(held), J.T @ r - held * so_far)
        if not poses:
            change *= min(1.0, _FURTHEST_MM / max(float(np.abs(change).max()), 1e-12))
        so_far = so_far + change
        if np.abs(change).max() < _ENOUGH_MM:
            break
    return at(so_far)

"""Movements among the runs of a diagnosis, and removal of the affected rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from analysis.diagnosis.evidence.movements import Movement
from analysis.diagnosis.evidence.observation import ObservedRun, by_socket
from analysis.diagnosis.evidence.placements import observe_runs
from analysis.diagnosis.judge.act_list import MOVED
from analysis.diagnosis.judge.result import Diagnosis
from analysis.movement.cause_odds import odds_of
from analysis.movement.causes import look_alike
from analysis.movement.changes import MovementStep, find_step
from analysis.procedures.checks.check_runs import findings_of, why_no_measurement
from analysis.procedures.facts import facts_of, shows_joints
from analysis.robot.kinematics.arm import Mask
from analysis.runs.loading import Measured
from rigs.errors import FileError
from rigs.rig import Rig

_FRAMES = ("base", "instrument", "socket", "target")
"""Causes that move a set-up but not the arm. The runs before and after then get separate set-ups."""


def observed(rig: Rig, runs: Sequence[Measured]) -> list[ObservedRun]:
    """Return observations of the runs with joint angles, with the model of a rig and touches split by socket.

    Raises FileError for a run of a different robot, and for a table that does not fit the arm.
    """
    for finding in findings_of(runs):
        if finding.strength != "likely":
            raise FileError(", ".join(finding.runs), finding.what, finding.remedy)
    with_joints = [run for run in runs if shows_joints(run.table.test)]
    return [part for run in observe_runs(rig, with_joints) for part in by_socket(run)]


def without_moved(rig: Rig, runs: Sequence[Measured]) -> tuple[list[Measured], list[Movement], list[str]]:
    """Remove the rows of runs of places that a movement affects.

    Return the remaining runs, the movements, and a message for each shortened or removed run.
    """
    kept, movements, doubts = list(runs), list[Movement](), list[str]()
    groups: dict[tuple[str, str], list[int]] = {}
    for k, run in enumerate(runs):
        if facts_of(run.table.test).of_places and not why_no_measurement(run):  # the diagnosis ignores the others
            groups.setdefault((run.table.test, run.run.manifest.placement), []).append(k)
    dropped: set[int] = set()
    pending = list(groups.values())
    for numbers in pending:  # which grows by the runs after each movement
        movement, masks, after = _of_group(rig, [kept[k] for k in numbers])
        if movement is None:
            continue
        movements.append(movement)
        if after is not None:
            doubts.append(f"{movement.to} and later runs were fitted as a separate placement, after the movement")
            pending.append(numbers[after:])
            for k in numbers[after:]:
                kept[k] = _with_placement(runs[k], movement.to)
        for k, mask in zip(numbers, masks, strict=True):
            if not mask.all():
                name = runs[k].run.manifest.name
                rows = f"{np.count_nonzero(~mask)} of {len(mask)} rows of {name} are ignored"
                doubts.append(f"{rows}: they lie on the other side of the movement")
                kept[k] = replace(kept[k], table=_shortened(kept[k].table, mask))
                dropped |= {k} if not mask.any() else set()
    return [run for k, run in enumerate(kept) if k not in dropped], movements, doubts


def with_movements(diagnosis: Diagnosis, movements: Sequence[Movement], doubts: Sequence[str]) -> Diagnosis:
    """Return a diagnosis of the remaining runs with the movements, messages about dropped rows, and the action that
    the movements require, which comes first."""
    acts = diagnosis.acts
    if movements and not diagnosis.given:
        acts = (MOVED, *(act for act in acts if act.why != "sound"))
    return replace(diagnosis, movements=tuple(movements), doubts=(*doubts, *diagnosis.doubts), acts=acts)


def _of_group(rig: Rig, runs: Sequence[Measured]) -> tuple[Movement | None, list[Mask], int | None]:
    """Return the movement among runs of a placement, masks of the rows that a diagnosis may use, and the first run of
    a placement of its own: None unless a frame moved between two runs."""
    whole = [np.ones(len(run.table.q), dtype=bool) for run in runs]
    parts = [(k, piece) for k, run in enumerate(runs) for piece in observed(rig, [run])]
    begins = np.cumsum([0, *(len(run.table.q) for run in runs)])
    order = np.concatenate([begins[k] + piece.rows for k, piece in parts])
    step = find_step([piece for _, piece in parts], order)
    if step is None:
        return None, whole, None
    where = int(np.searchsorted(begins, step.first, side="right")) - 1
    row = step.first - int(begins[where])
    movement = _movement(runs, where, row, step, parts[0][1])
    if row == 0 and step.found.what in _FRAMES:
        return movement, whole, where
    masks = [np.arange(len(mask)) + begins[k] < step.first for k, mask in enumerate(whole)]
    before = sum(int(mask.sum()) for mask in masks)
    if 2 * before < begins[-1]:
        masks = [~mask for mask in masks]
    return movement, masks, None


def _with_placement(run: Measured, first: str) -> Measured:
    """Return a run at the part of the labelled placement that begins with the run `first`."""
    placement = f"{run.run.manifest.placement} from {first}".lstrip()
    return replace(run, run=replace(run.run, manifest=run.run.manifest.model_copy(update={"placement": placement})))


def _movement(runs: Sequence[Measured], where: int, row: int, step: MovementStep, piece: ObservedRun) -> Movement:
    found, names = step.found, [run.run.manifest.name for run in runs]
    rows = runs[where].table.rows
    from_, to = (
        (names[where - 1], names[where]) if row == 0 else (f"{names[where]} row {rows[k]}" for k in (row - 1, row))
    )
    assert found.what in ("base", "instrument", "socket", "target", "tool", "zero")  # noqa: S101 - by find_step
    u_mm, u_deg = (None, found.u) if found.what == "zero" else (found.u, None)
    return Movement(
        from_=from_,
        to=to,
        what=found.what,
        odds=odds_of(found.posterior),
        axis=found.cause.axis,
        name=found.name,
        translation_mm=found.translation_mm,
        rotation_deg=found.rotation_deg,
        size_deg=found.size_deg,
        u_mm=u_mm,
        u_deg=u_deg,
        u_rotation_deg=found.u_rotation_deg,
        run=names[where],
        row=None if row == 0 else int(rows[row]),
        alike=look_alike(found.cause, piece.model.arm.axes, of_tracker=facts_of(piece.table.test).of_tracker),
    )


def _shortened(table: Any, keep: Mask) -> Any:
    """Return the rows of a table selected by a mask (n,), with their row numbers in the file."""
    columns = {name: value[keep] for name, value in vars(table).items() if isinstance(value, np.ndarray)}
    return replace(table, **columns | {"row": table.rows[keep]})

"""Movements among the runs of a diagnosis: their detection, and removal of the affected rows.

For each cause and each reading of a placement, in time order, the evidence of a step from that reading on is computed
together with the arm constants and the set-ups. The likeliest step is then examined like the new readings of `rig
moved`, with the readings before it as reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, by_socket
from analysis.diagnosis.evidence.placements import observe_runs
from analysis.diagnosis.judge.act_list import MOVED
from analysis.diagnosis.judge.result import Diagnosis, Movement
from analysis.movement.cause_odds import CauseOdds, odds_of
from analysis.movement.causes import look_alike
from analysis.movement.step_search import find_step
from analysis.procedures.checks.check_runs import findings_of, why_no_measurement
from analysis.procedures.shared.test_kind import facts_of, shows_joints
from analysis.robot.kinematics.arm import Mask
from analysis.runs.loading import Measured
from rigs.errors import FileError
from rigs.rig import Rig

_FRAMES = ("base", "instrument", "socket", "target")
"""Causes that move a set-up but not the arm: the runs before and after get separate set-ups."""


def observed(rig: Rig, runs: Sequence[Measured]) -> list[ObservedRun]:
    """Observe the runs with joint angles, with the model of a rig and touches split by socket. Raises FileError for a
    run of a different robot, and for a table that does not fit the arm.
    """
    for finding in findings_of(runs):
        if finding.strength != "likely":
            raise FileError(", ".join(finding.runs), finding.what, finding.remedy, code="readings.unsuitable")
    with_joints = [run for run in runs if shows_joints(run.table.test)]
    return [part for run in observe_runs(rig, with_joints) for part in by_socket(run)]


def without_moved(
    rig: Rig, runs: Sequence[Measured], *, latest: bool = False
) -> tuple[list[Measured], list[Movement], list[str]]:
    """Reduce the runs of each placement to one state of the arm: the one with most readings, the newest of equal ones.

    latest: keep the last state instead, in which no set-up moved either. Also return the movements, and a message for
    each shortened, removed or relabelled run.
    """
    kept, movements, doubts = dict(enumerate(runs)), list[Movement](), list[str]()
    groups: dict[tuple[str, str], dict[int, Measured]] = {}
    for k, run in enumerate(runs):
        if facts_of(run.table.test).of_places and not why_no_measurement(run):  # the diagnosis ignores the others
            groups.setdefault((run.table.test, run.run.manifest.placement), {})[k] = run
    for (_, placement), group in groups.items():
        states, found, relabelled = _states(rig, group, placement, _FRAMES if not latest else ())
        movements += found
        doubts += relabelled
        most = max(reversed(states), key=lambda state: sum(map(_rows, state.values())))
        state = states[-1] if latest else most
        for k, run in group.items():
            remaining = _rows(state[k]) if k in state else 0
            if remaining < _rows(run):
                rows = f"{_rows(run) - remaining} of {_rows(run)} rows of {run.run.manifest.name} are ignored"
                doubts.append(f"{rows}: they lie on the other side of the movement")
            del kept[k]
        kept |= state
    return [kept[k] for k in sorted(kept)], movements, doubts


def _rows(run: Measured) -> int:
    return len(run.table.q)


def with_movements(diagnosis: Diagnosis, movements: Sequence[Movement], doubts: Sequence[str]) -> Diagnosis:
    """Add the movements, messages about dropped rows, and the action that the movements require, which comes first."""
    acts = diagnosis.acts
    if movements and not diagnosis.given:
        acts = (MOVED, *(act for act in acts if act.why != "sound"))
    return replace(diagnosis, movements=tuple(movements), doubts=(*doubts, *diagnosis.doubts), acts=acts)


def _states(
    rig: Rig, runs: dict[int, Measured], placement: str, frames: Sequence[str]
) -> tuple[list[dict[int, Measured]], list[Movement], list[str]]:
    """Split numbered runs of a placement, in time order, at each movement.

    One of the `frames` that moved between two runs leaves the state as it is: the runs after it get a placement of
    their own.
    """
    states, movements, doubts = [dict[int, Measured]()], list[Movement](), list[str]()
    rest = runs
    while (found := _first_step(rig, list(rest.values()))) is not None:
        where, row, of_step = found
        movements += of_step
        before = dict(list(rest.items())[:where])
        k, run = list(rest.items())[where]
        rest = dict(list(rest.items())[where:])
        if row:
            is_before = np.arange(_rows(run)) < row
            before[k] = replace(run, table=_shortened(run.table, is_before))
            rest[k] = replace(run, table=_shortened(run.table, ~is_before))
        states[-1] |= before
        if row == 0 and all(movement.what in frames for movement in of_step):
            to = of_step[0].to
            doubts.append(f"{to} and later runs were fitted as a separate placement, after the movement")
            update = {"placement": f"{placement} from {to}".lstrip()}
            for k, run in rest.items():
                rest[k] = replace(run, run=replace(run.run, manifest=run.run.manifest.model_copy(update=update)))
        else:
            states.append({})
    states[-1] |= rest
    return states, movements, doubts


def _first_step(rig: Rig, runs: Sequence[Measured]) -> tuple[int, int, list[Movement]] | None:
    """The first movement among runs of a placement as the run and row after it, with the parts that moved.

    Several parts can move together between runs, but within a run such a step is more likely a drift.
    """
    pieces = [(k, piece) for k, run in enumerate(runs) for piece in observed(rig, [run])]
    begins = np.cumsum([0, *map(_rows, runs)])
    order = np.concatenate([begins[k] + piece.rows for k, piece in pieces])
    step = find_step([piece for _, piece in pieces], order)
    if step is None:
        return None
    where = int(np.searchsorted(begins, step.first, side="right")) - 1
    row = step.first - int(begins[where])
    if row and step.is_joint:
        return None
    return where, row, [_movement(runs, where, row, part, pieces[0][1]) for part in step.found]


def _movement(runs: Sequence[Measured], where: int, row: int, found: CauseOdds, piece: ObservedRun) -> Movement:
    names = [run.run.manifest.name for run in runs]
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
        alike=look_alike(found.cause, piece.model.arm.axes, of_tracker=piece.facts.of_tracker),
    )


def _shortened(table: Any, keep: Mask) -> Any:
    columns = {name: value[keep] for name, value in vars(table).items() if isinstance(value, np.ndarray)}
    return replace(table, **columns | {"row": table.rows[keep]})

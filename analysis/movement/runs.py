"""Inference of movements from measured runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from analysis.diagnosis.evidence.observation import ObservedRun, by_socket
from analysis.diagnosis.evidence.placements import observe_runs
from analysis.movement.inference import FEWEST_OF_REFERENCE, Reference, study
from analysis.movement.result import MovementResult, what_moved
from analysis.procedures.checks.check_runs import findings_of
from analysis.procedures.facts import shows_joints
from analysis.runs.loading import Measured
from rigs.errors import FileError
from rigs.rig import Rig


def observed(rig: Rig, runs: Sequence[Measured]) -> list[ObservedRun]:
    """Return observations of the runs with joint angles, with the model of a rig and touches split by socket.

    Raises FileError for a run of a different robot, and for a table that does not fit the arm.
    """
    for finding in findings_of(runs):
        if finding.strength != "likely":
            raise FileError(", ".join(finding.runs), finding.what, finding.remedy)
    with_joints = [run for run in runs if shows_joints(run.table.test)]
    return [part for run in observe_runs(rig, with_joints) for part in by_socket(run)]


def study_runs(rig: Rig, runs: Sequence[Measured]) -> Reference:
    """Return the reference of runs before a possible movement. rig: model of the arm.

    Raises FileError if the runs have no joint angles, or too few readings.
    """
    before = observed(rig, runs)
    where = ", ".join(run.run.manifest.name for run in runs)
    if not before:
        raise FileError(where, "has no joint angles", "give runs of touches, poses or circles")
    count = sum(len(run.rows) for run in before)
    if count < FEWEST_OF_REFERENCE:
        problem = f"has only {count} readings, but a reference needs at least {FEWEST_OF_REFERENCE}"
        raise FileError(where, problem, "touch more postures while the cell is in order, or give more runs")
    return study(before)


def what_moved_in(
    rig: Rig, reference: Sequence[Measured], new: Sequence[Measured], *, plan: bool = False
) -> MovementResult:
    """Infer the movement between reference runs and new runs.

    If all new runs have a different placement name, it is treated as that of the reference. Raises FileError for a
    reference without joint angles, or with too few readings.
    """
    before, after = study_runs(rig, reference), observed(rig, new)
    places = {run.run.manifest.placement for run in reference}
    others = {run.run.manifest.placement for run in new}
    if len(places) == len(others) == 1 and places != others:
        after = _renamed(after, others.pop(), places.pop())
    return what_moved(before, after, plan=plan)


def _renamed(runs: Sequence[ObservedRun], old: str, new: str) -> list[ObservedRun]:
    was, becomes = f" at {old}" if old else "", f" at {new}" if new else ""
    return [replace(run, setup=run.table.test + becomes + run.setup.removeprefix(run.table.test + was)) for run in runs]

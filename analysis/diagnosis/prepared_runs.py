"""Runs prepared for a diagnosis: all about the model of one rig, whatever their own rig files contain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from analysis.conventions.check import findings_of
from analysis.conventions.finding import Finding
from analysis.conventions.gauge_order import ORDER, SIGN
from analysis.diagnosis.observed_run import ObservedRun, observe_run
from analysis.fitting.observation import with_placement
from analysis.fitting.placements import split_by_frame, with_enough_readings
from analysis.model.predict import model_of
from analysis.traces.loading import Measured
from analysis.traces.tables import CircleTable, Table
from rigs.errors import FileError
from rigs.rig import Rig

_FEW = 1e-3
"""Share of wild readings up to which they are not reported: where a play is crossed, some sound readings are classified
as wild. Chosen."""


def prepare_runs(rig: Rig, *uses: Sequence[Measured]) -> tuple[list[list[ObservedRun]], list[str]]:
    """Return the runs of each use as the diagnosis uses them, with the circle and targets of their own rig files, and
    messages about their frames and wiring.

    All runs of one cell and placement share a set-up and its name, whatever their use. Runs that fit only if a
    convention is another than labelled, and runs of a set-up that absorbs all of their readings (m, k), are left out.
    Raises FileError for a run of another robot, and where a convention leaves no run of the first use.
    """
    runs = [run for use in uses for run in use]
    names = [run.run.manifest.name for run in runs]
    use_of = [number for number, use in enumerate(uses) for _ in use]
    found_wrong = findings_of(runs)
    wrong = _contradicted(runs, found_wrong)
    _hold_some(uses[0], runs, wrong)
    seen = _about_one_rig(rig, runs)
    kept = [k for k in range(len(runs)) if k not in wrong]
    found, doubts = _split_by_frame([seen[k] for k in kept], [names[k] for k in kept])
    for k, finding in reversed(wrong.items()):
        doubts.insert(0, f"{names[k]} is left out: {finding.words}")
    doubts += _likely(found_wrong)
    doubts += _wild([(names[k], seen[k].wild, runs[k].table) for k in kept])
    parts = []
    for number in range(len(uses)):
        own = [run for k, run in zip(kept, found, strict=True) if use_of[k] == number]
        enough, too_few = with_enough_readings([run.one for run in own]) if own else ([], [])
        parts.append([own[k] for k in enough])
        doubts += too_few
    return parts, doubts


def _contradicted(runs: Sequence[Measured], findings: Sequence[Finding]) -> dict[int, Finding]:
    """Return the runs that are no measurement as they are labelled, each with what shows it."""
    certain = [finding for finding in findings if finding.strength != "likely"]
    shown = {
        k: next((finding for finding in certain if run.run.manifest.name in finding.runs), None)
        for k, run in enumerate(runs)
    }
    return {k: finding for k, finding in shown.items() if finding is not None}


def _hold_some(used: Sequence[Measured], runs: Sequence[Measured], wrong: Mapping[int, Finding]) -> None:
    """Raise FileError where no run is left to find effects from."""
    first = [k for k in range(len(runs)) if k < len(used)]
    if first and all(k in wrong for k in first):
        raise FileError(str(runs[0].path), wrong[0].what, wrong[0].remedy)


def _likely(findings: Sequence[Finding]) -> list[str]:
    """Return a message for each doubt about the gauges, with the runs that look so: their repeats do not show it."""
    likely = [one for one in findings if one.convention in (ORDER, SIGN) and one.strength == "likely"]
    doubts = []
    for meant in dict.fromkeys(one.meant for one in likely):
        names = [name for one in likely if one.meant == meant for name in one.runs]
        more = f" and {len(names) - 1} more" * (len(names) > 1)
        doubts.append(
            f"{meant} in {names[0]}{more}, where repeats cannot show it; every size would be wrong then: press a probe "
            "to see which is which before anything is corrected"
        )
    return doubts


def _wild(counted: Sequence[tuple[str, int, Table]]) -> list[str]:
    """Return a message with the number of wild readings of circles, from the name, wild readings and table of
    each run."""
    circles = [(name, wild, table.g_mm.size) for name, wild, table in counted if isinstance(table, CircleTable)]
    wild, readings = sum(one[1] for one in circles), sum(one[2] for one in circles)
    if wild <= _FEW * readings:
        return []
    most = max(circles, key=lambda one: one[1])
    what = f"{wild} of {readings} readings of circles are wild and were replaced by interpolation"
    return [f"{what} (most, {most[1]}, in {most[0]})"]


def _about_one_rig(rig: Rig, runs: Sequence[Measured]) -> list[ObservedRun]:
    """Return the runs about a rig with their own circle and targets; set-ups are named by test, placement and cell."""
    cells: list[Rig] = []
    seen: list[ObservedRun] = []
    of_rig = any(run.rig.robot == rig.robot for run in runs)
    for run in runs:
        # A circle with the ball beside axis 6 has another tool on the same arm; a tool that no run has is a mistake.
        robot = run.rig.robot.model_copy(update={"tool": rig.robot.tool}) if of_rig else run.rig.robot
        if robot != rig.robot:
            raise FileError(
                str(run.path),
                f"is of another robot than {rig.name} ({_differing(run.rig, rig)})",
                "diagnose the runs of one robot at a time, or give the --rig that they were made with",
            )
        cell = run.rig.model_copy(update={"name": rig.name, "description": ""}).modelled_as(rig)
        if cell not in cells:
            cells.append(cell)
        one = observe_run(model_of(cell), run.table, str(run.path))
        placed = with_placement(one.one, run.run.manifest.placement)
        place = cells.index(cell)
        # Another circle or other gauges need another set-up.
        setup = placed.setup + f" {place + 1}" * (place > 0)
        seen.append(replace(one, one=replace(placed, setup=setup)))
    return seen


def _split_by_frame(seen: Sequence[ObservedRun], names: Sequence[str]) -> tuple[list[ObservedRun], list[str]]:
    """Return runs with a set-up for each frame that the runs of a set-up show, and messages about them."""
    found, doubts = list(seen), []
    for setup in dict.fromkeys(run.one.setup for run in seen):
        places = [k for k, run in enumerate(seen) if run.one.setup == setup]
        own, words = split_by_frame(seen[places[0]].model, [seen[k].one for k in places], [names[k] for k in places])
        for k, one in zip(places, own, strict=True):
            found[k] = replace(seen[k], one=one)
        doubts += words
    return found, doubts


def _differing(one: Rig, other: Rig) -> str:
    fields = [name for name in type(one.robot).model_fields if getattr(one.robot, name) != getattr(other.robot, name)]
    return f"its {', '.join(fields)} differ{'s' * (len(fields) == 1)}"

"""First stage of a diagnosis: the runs of one robot, prepared and divided by their use; removal of outliers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from analysis.diagnosis.evidence.observation import (
    ObservedRun,
    by_socket,
    in_content_order,
    observe_run,
    part,
    residual_of,
    with_placement,
)
from analysis.diagnosis.evidence.placements import split_by_frame, split_by_target, with_enough_readings
from analysis.diagnosis.evidence.setups import fit_run_setups, with_effects, without_a_fold
from analysis.procedures.checks.check_runs import findings_of
from analysis.procedures.checks.gauges import ORDER, SIGN
from analysis.procedures.checks.places import left_out
from analysis.procedures.shared.test_kind import Finding, kind_of, labels_of, shows_joints
from analysis.robot.kinematics.arm import Array, Mask
from analysis.robot.predict import model_of
from analysis.runs.loading import Measured
from analysis.runs.noise.cell_noise import TARGET_MM
from analysis.runs.noise.readings import FEW, by_accident
from analysis.runs.tables import Table
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig


@dataclass(frozen=True)
class Evidence:
    """Prepared runs of a robot."""

    rig: Rig
    used: Sequence[Measured]
    names: tuple[list[str], ...]
    """Names of the runs used, held out and unseen. Without held-out runs, a part of the runs used is held out."""
    runs: Sequence[ObservedRun]
    """Used in the fit."""
    judges: Sequence[ObservedRun]
    """Held out."""
    elsewhere: Sequence[ObservedRun]
    """At an unseen place."""
    tolerance_um: float | None
    """Largest accepted rms error; None if the limits of the rig file decide."""
    doubts: tuple[str, ...]
    withheld: Mapping[str, tuple[int, ...]]
    """Table rows, from 1, of each run that rig itself holds out."""


def gather(
    rig: Rig,
    used: Sequence[Measured],
    held_out: Sequence[Measured],
    unseen: Sequence[Measured],
    tolerance_um: float | None,
    progress: Callable[[str], None],
) -> Evidence:
    """Prepare the runs of a robot with the model of its rig. Raises FileError for runs of a different robot, or not
    readable as the stated test.

    Without held-out runs, a fifth of 60 or more poses is held out, in groups of neighbouring postures.
    """
    progress("reading the runs")
    (runs, judges, elsewhere), doubts = prepare_runs(rig, used, held_out, unseen)
    rows: dict[str, list[int]] = {}
    if not judges:
        runs, judges = without_a_fold(runs)
        for run, piece in product(used, judges):
            if piece.table is run.table:
                rows.setdefault(run.run.manifest.name, []).extend((piece.rows + 1).tolist())
    terms = sum({run.setup: run.facts.setup_terms for run in runs}.values())
    if (count := sum(run.values.size for run in runs)) < terms:
        why = f"{count} readings are fewer than the {terms} terms of the set-up"
        raise FileError("RUN…", why, "give more runs", code="readings.too_few")
    withheld = {name: tuple(sorted(numbers)) for name, numbers in rows.items()}
    names = tuple([run.run.manifest.name for run in use] for use in (used, held_out or used, unseen))
    return Evidence(rig, used, names, runs, judges, elsewhere, tolerance_um, tuple(doubts), withheld)


# ----------------------------------------------------------------------------------------------------------------------
# Runs relative to the model of a common rig, regardless of their rig files.

_FEW = 1e-3
"""Share of outliers below which they are not reported: at backlash crossings some valid readings look like outliers.
Chosen.
"""


def prepare_runs(rig: Rig, *uses: Sequence[Measured]) -> tuple[list[list[ObservedRun]], list[str]]:
    """Prepare the runs of each use, with the circle and targets of their rig files, and messages about frames and
    wiring.

    Runs of the same cell and placement share a set-up and its name, regardless of their use. Runs that only fit with a
    convention different from their label, or whose set-up absorbs all their readings, are excluded. Raises FileError
    for a run of a different robot, and if a convention excludes all runs of the first use.
    """
    uses, doubts = _with_joints(uses)
    runs = [run for use in uses for run in use]
    names = [run.run.manifest.name for run in runs]
    use_of = [number for number, use in enumerate(uses) for _ in use]
    findings = findings_of(runs)
    shown: dict[str, Finding] = {}  # the first certain proof that a run is not the labelled measurement
    for finding in findings:
        if finding.strength != "likely":
            shown = dict.fromkeys(finding.runs, finding) | shown
    wrong = {k: shown[name] for k, name in enumerate(names) if name in shown}
    if uses[0] and all(k in wrong for k in range(len(uses[0]))):
        raise FileError(str(runs[0].path), wrong[0].what, wrong[0].remedy, code="readings.unsuitable")
    seen = _about_one_rig(rig, runs)
    kept = [k for k in range(len(runs)) if k not in wrong]
    seen, far = _without_far(seen, names, set(kept))
    doubts += far
    pieces = [(k, piece) for k in kept for piece in by_socket(seen[k])]
    of_pieces = [names[k] for k, _ in pieces]
    split_up, of_frames = split_by_frame([piece for _, piece in pieces], of_pieces)
    split_up, of_targets = split_by_target(split_up, of_pieces)
    doubts += [f"{names[k]} is ignored: {finding.words}" for k, finding in wrong.items()] + of_frames + of_targets
    doubts += _doubts_of_gauges(findings, [(names[k], seen[k].wild, runs[k].table) for k in kept])
    parts = []
    for number in range(len(uses)):
        of_use = [run for (k, _), run in zip(pieces, split_up, strict=True) if use_of[k] == number]
        enough, too_few = with_enough_readings(of_use) if of_use else ([], [])
        parts.append([in_content_order(of_use[k]) for k in enough])
        doubts += too_few
    return parts, doubts


def _with_joints(uses: Sequence[Sequence[Measured]]) -> tuple[tuple[Sequence[Measured], ...], list[str]]:
    """Leave out paths, with a message for each. Raises FileError if the first use becomes empty."""
    kept = tuple([run for run in use if shows_joints(run.table.test)] for use in uses)
    without = [run for use in uses for run in use if not shows_joints(run.table.test)]
    if without and not kept[0]:
        why = labels_of(without[0].table.test).unsupported_reason
        raise FileError(str(without[0].path), why, "give poses, touches or circles as well", code="readings.unsuitable")
    return kept, [
        f"{run.run.manifest.name} is left out: it {labels_of(run.table.test).unsupported_reason}" for run in without
    ]


def _doubts_of_gauges(findings: Sequence[Finding], counted: Sequence[tuple[str, int, Table]]) -> list[str]:
    """Messages about doubtful gauges and about outliers of circles. counted: name, outliers and original table of each
    run.
    """
    likely = [finding for finding in findings if finding.convention in (ORDER, SIGN) and finding.strength == "likely"]
    doubts = []
    for meant in dict.fromkeys(finding.meant for finding in likely):
        names = [name for finding in likely if finding.meant == meant for name in finding.runs]
        others = f" and {len(names) - 1} more" * (len(names) > 1)
        doubts.append(
            f"{meant} in {names[0]}{others}, which repeats cannot show; every size would then be wrong: before any "
            "correction, press a probe to identify the gauges"
        )
    circles = [(name, wild, table.readings.size) for name, wild, table in counted if table.swept]
    wild, readings = sum(circle[1] for circle in circles), sum(circle[2] for circle in circles)
    if wild > _FEW * readings:
        worst, most, _ = max(circles, key=lambda circle: circle[1])
        message = f"{wild} of {readings} readings of circles are outliers and were replaced by interpolation"
        doubts.append(f"{message} (most, {most}, in {worst})")
    return doubts


def _about_one_rig(rig: Rig, runs: Sequence[Measured]) -> list[ObservedRun]:
    """Observe the runs relative to a rig, with set-ups named after test, placement and cell."""
    cells: list[Rig] = []
    seen: list[ObservedRun] = []
    of_rig = any(run.rig.robot == rig.robot for run in runs)
    is_given = all(run.rig.tests != rig.tests for run in runs)  # its distances were measured again since
    for run in runs:
        # A circle with the ball away from axis 6 has a different tool on the same arm; a tool with no runs is a
        # mistake.
        robot = run.rig.robot.model_copy(update={"tool": rig.robot.tool}) if of_rig else run.rig.robot
        if robot != rig.robot:
            theirs, ours = vars(run.rig.robot), vars(rig.robot)
            fields = [name for name in type(rig.robot).model_fields if theirs[name] != ours[name]]
            differing = f"its {', '.join(fields)} differ{'s' * (len(fields) == 1)}"
            remedy = "diagnose runs of a single robot, or give the original rig file with --rig"
            raise FileError(
                str(run.path),
                f"belongs to a different robot than {rig.name} ({differing})",
                remedy,
                code="robot.other",
            )
        cell = run.rig.model_copy(update={"name": rig.name, "description": ""}).modelled_as(rig)
        if is_given:
            cell = cell.with_distances(rig.tests.distances)
        if cell not in cells:
            cells.append(cell)
        observed = observe_run(model_of(cell), run.table, str(run.path))
        placed = with_placement(observed, run.run.manifest.placement)
        # A different circle or gauges need a separate set-up.
        seen.append(replace(placed, setup=placed.setup + f" {cells.index(cell) + 1}" * (cell != cells[0])))
    return seen


def _without_far(
    seen: Sequence[ObservedRun], names: Sequence[str], kept: Collection[int]
) -> tuple[list[ObservedRun], list[str]]:
    """Omit poses distant from all others of their run, before any fit, with a message for each affected run."""
    found, doubts = list(seen), []
    for k, run in enumerate(seen):
        far = kind_of(run.table.test).outliers(run.table, run.model.arm) if k in kept else None
        if far is None:
            continue
        table = run.table
        if words := far.words(table):
            doubts.append(f"{names[k]}: {words}")
        out = far.wild | table.lost
        if out.any() and not out.all():
            found[k] = part(run, ~out[run.rows])
            doubts.append(f"{names[k]}: {left_out(table, out, far.far_mm)}")
    return found, doubts


# ----------------------------------------------------------------------------------------------------------------------
# Outliers at targets and poses, unexplained by any effect: they are counted, and not used for judging models.
#
# Names are selected with robust weights, so outliers have little influence there. An rms has no such weights.

_NEAR = 2.5
"""Robust standard deviations within which a reading counts in set-up fits. Chosen: usual."""
_STEPS = 4
"""Number of set-up fits, each to the readings close to the previous fit (Rousseeuw's concentration steps): a single fit
failed to reveal one outlier in nine.
"""


def without_outliers(
    runs: Sequence[ObservedRun], effects: Sequence[Effect], use: str
) -> tuple[list[ObservedRun], list[str]]:
    """Omit readings at targets and poses distant from all others, relative to a model with `effects`, with a message
    for each affected set-up. `use`: purpose of the runs.
    """
    targets = [k for k, run in enumerate(runs) if not run.table.swept]
    sound, far_mm, doubts = list(runs), dict[str, float](), list[str]()
    away = _model_distances(with_effects([runs[k] for k in targets], effects)) if targets else []
    far = [spreads > runs[k].facts.wild_spreads for k, (_, spreads) in zip(targets, away, strict=True)]
    kept = _no_accidents([runs[k] for k in targets], far)
    for k, (distance_mm, _), wild in zip(targets, away, far, strict=True):
        run = runs[k]
        if run.setup not in kept:
            sound[k] = part(run, ~wild)
            if wild.any():
                far_mm[run.setup] = max(far_mm.get(run.setup, 0.0), float(distance_mm.max()))
        elif wild.any():
            doubts.append(
                f"{wild.sum()} of {len(run.rows)} readings of {run.setup} differ from all others by up to "
                f"{distance_mm.max():.1f} mm. They are used: so many, or all in one range of a joint, are not "
                "outliers. Check the signs, order and zeros of the joints, and whether instrument or base moved"
            )
    for setup, most_mm in far_mm.items():
        members = [k for k, run in enumerate(runs) if run.setup == setup]
        count = sum(len(runs[k].rows) for k in members)
        wild_count = count - sum(len(sound[k].rows) for k in members)
        are = "is an outlier" if wild_count == 1 else "are outliers"
        doubts.append(
            f"{wild_count} of {count} readings of {setup} {are}, up to {most_mm:.1f} mm off, and not included in the "
            f"rms of {use}: check that the robot is at rest during a reading, that the clocks agree, and that the "
            "tracker sees the target or the plunger touches"
        )
    return [run for run in sound if len(run.rows)], doubts


def _no_accidents(runs: Sequence[ObservedRun], wild: Sequence[Mask]) -> set[str]:
    """Set-ups whose outliers `wild` (m,) cannot be accidents: they are too frequent, or fill a joint range.

    Gauge readings at targets are excluded: a robot read in motion has many outliers.
    """
    poses = [k for k, run in enumerate(runs) if run.facts.of_places]
    kept = set()
    for setup in dict.fromkeys(runs[k].setup for k in poses):
        members = [k for k in poses if runs[k].setup == setup]
        angles = np.concatenate([runs[k].table.q[runs[k].rows] for k in members])
        if not by_accident(np.concatenate([wild[k] for k in members]), angles, FEW):
            kept.add(setup)
    return kept


def _model_distances(runs: Sequence[ObservedRun]) -> list[tuple[Array, Array]]:
    """Distance of the readings (m,) of each run from the model, in mm and in robust standard deviations of their
    set-up.
    """
    near: list[Mask] = [np.ones(len(run.rows), dtype=bool) for run in runs]
    distances_found: list[tuple[Array, Array]] = []
    for _ in range(_STEPS):
        setups, _ = fit_run_setups([part(run, mask) for run, mask in zip(runs, near, strict=True)])
        distances = [np.linalg.norm(residual_of(run, setups), axis=1) for run in runs]
        sd_mm = {}
        for setup in setups:
            every = [mm for run, mm in zip(runs, distances, strict=True) if run.setup == setup]
            sd_mm[setup] = max(1.4826 * float(np.median(np.concatenate(every))), TARGET_MM.high)
        distances_found = [(mm, mm / sd_mm[run.setup]) for run, mm in zip(runs, distances, strict=True)]
        near = [spreads <= _NEAR for _, spreads in distances_found]
    return distances_found

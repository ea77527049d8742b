"""Correction step of a session: values entered at the controller, or programs with corrected targets.

Entered values serve every program, so they are preferred if they remove nearly as much. Gear errors, compliance and
play can be corrected only in targets of a known path.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from analysis.apps.correct import correction_report
from analysis.apps.correct.controller_entries import at_controller
from analysis.apps.correct.correct_rig import correct_rig
from analysis.apps.makers.motion_plan import Arc
from analysis.apps.programs.compensated import ahead_of_plays, compensated, targets_of
from analysis.apps.report.texts import joined, texts_of
from analysis.apps.session.session_plan import FIXED, SessionProgram, programs_by_step, programs_for, stage_rig
from analysis.apps.session.session_state import (
    CORRECTIONS_FILE,
    MAIN,
    ProgramStep,
    Session,
    SessionCorrection,
    Stage,
    Way,
)
from analysis.correction.corrected_targets import corrected_angles
from analysis.correction.deviation import Expected, Work
from analysis.correction.pose_uncertainty import PoseUncertainty, frame_u_mm, pose_uncertainty, where_known
from analysis.correction.reasons import how_to_state_controller
from analysis.correction.support import known_plays, supports
from analysis.correction.work import tool_poses, used_effects
from analysis.diagnosis.judge.comparison import residuals_mm
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import controller_arm, forward
from analysis.robot.predict import model_of
from analysis.runs.loading import Measured, load_measured
from analysis.runs.noise.readings import rms
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.vocabulary import DrivenTest
from rigs.yaml_text import read_yaml

CORRECTIONS = "corrections"
_ARC_DEG = 5.0
"""Arc length of programs with corrected targets. On an arc the controller turns the tool at a constant rate. The
angular effect of a wave with eight periods per lap therefore keeps a residual of 6 %, compared with 55 % at 15°
(measured: 5 µm instead of 14 µm).
"""
_NEARLY = 0.8
"""Minimum share of the improvement by corrected targets for entries to be preferred. Chosen."""
_POSES = 60
"""Number of postures per run at which the uncertainty of the model is evaluated: every 6 degrees of a lap."""
_ENTER = "choose --correct entries"
_LEAST_UM, _LEAST_SHARE = 2.0, 0.05
"""Minimum improvement of a correction, in µm and as a share of the error of the readings. Chosen: a smaller gain
is not worth the effort and would not show in a second measurement.
"""


def corrected(
    rig: Rig,
    session: Session,
    model_file: Path,
    runs: tuple[Sequence[Path], Sequence[Path]],
    steps: Sequence[ProgramStep],
    directory: Path,
    chosen_way: Way | None = None,
) -> tuple[SessionCorrection, dict[str, SessionProgram]]:
    """Correction by the model of a session, and the corrected programs by the name of the program that each replaces.

    runs: on the circle of the rig, which decide between entries and programs, and at the other place. steps: to drive
    after the correction. The files replace those in the directory.
    """
    shutil.rmtree(directory, ignore_errors=True)
    model, _ = load(model_file)
    if session.emulated and model.controller == "unknown":  # the emulated controller has the arm of the rig file
        model = model.model_copy(update={"robot": model.robot.model_copy(update={"controller": "data_sheet"})})
    correction = correct_rig(model, None, session.maker)
    correction_report.write(correction, directory)
    entries = correction.at_controller
    on_circle, other_place = ([load_measured(path) for path in paths] for paths in runs)
    targets = (*used_effects(model, correction.effects), *known_plays(model))
    now_um = _left_um(on_circle, at_controller(rig), ())
    if entries is None:
        how = how_to_state_controller(model)
        if chosen_way not in (None, "none"):
            problem = "the constants of the controller are unknown: nothing is corrected"
            raise FileError(str(model_file), problem, how, code="controller.invalid")
        sentence = f"Nothing was corrected: the constants of the controller are unknown. To correct the robot, {how}."
        return _correction("none", sentence, now_um), {}
    of_test = cache(partial(_of_test, rig, model))
    by_entries_um = _left_um(on_circle, at_controller(rig), entries.effects)
    try:
        main = of_test(session.stages[0], MAIN)
        between_um = _between_targets_um(rig, model, session.stages[0], main)
    except FileError:
        if chosen_way == "programs":
            raise
        between_um = float("inf")
    by_targets_um = float(np.hypot(_left_um(on_circle, rig, targets), between_um))
    entries_gain_um, targets_gain_um = now_um - by_entries_um if entries.entries else 0.0, now_um - by_targets_um
    way: Way = "entries" if entries_gain_um >= _NEARLY * targets_gain_um else "programs"
    if max(targets_gain_um, entries_gain_um) < max(_LEAST_UM, _LEAST_SHARE * now_um):
        way = "none"
    way, work = chosen_way or way, correction.work
    if way == "none":
        sentence = f"Nothing you can enter removes much of this error ({now_um:.0f} µm rms). Repair the arm."
        return _correction(way, sentence, now_um), {}
    pose_u = pose_uncertainty(model, correction.effects)
    by, beside_um, after_um, left_um = (
        (entries.effects, 0.0, entries.after_um, by_entries_um)
        if way == "entries"
        else (targets, between_um, work.after_um, by_targets_um)
    )
    at_circle, elsewhere = expected_left(model, pose_u, on_circle, left_um), None
    if other_place:
        there = at_controller(other_place[0].rig) if way == "entries" else other_place[0].rig
        there_um = float(np.hypot(_left_um(other_place, there, by), beside_um))
        elsewhere = expected_left(model, pose_u, other_place, there_um)
    over_work = Work(
        before_um=round(work.before_um, 1), after_um=round(after_um, 1), u_um=round(work.u_um, 1),
        unknown=round(work.unknown, 3),
    )  # fmt: skip
    expected = {"same": at_circle, "elsewhere": elsewhere, "work": over_work}
    falls = f"The error is then expected to fall from {now_um:.0f} to {at_circle.text}"
    if way == "entries":
        unknown = texts_of("en").not_known(work.unknown)
        taught = entries.steps[0]  # programs with taught points, before anything is entered
        sentence = joined([correction_report.controller_sentence(entries), taught, unknown, f"{falls}."])
        return _correction(way, sentence, now_um, left_um, **expected), {}
    programs = programs_by_step(session.stages, steps, of_test, FIXED)
    sentence = f"Load the corrected programs. {falls}."
    return _correction(way, sentence, now_um, left_um, **expected), programs


def expected_left(model: Rig, pose_u: PoseUncertainty, runs: Sequence[Measured], left_um: float) -> Expected:
    """Expected error on runs after a correction.

    Its uncertainty applies to each coordinate of the tool with the frame taught on the circle, None if the runs of the
    model do not determine it.
    """
    q = np.concatenate([run.table.q[:: -(-len(run.table.q) // _POSES)] for run in runs])
    u_um = 1e3 * rms(where_known(pose_u, q, frame_u_mm(model, pose_u, q, q) / np.sqrt(3)))
    return Expected(um=round(left_um, 1), u_um=None if np.isnan(u_um) else round(u_um, 1))


def _left_um(runs: Sequence[Measured], rig: Rig, effects: Sequence[Effect]) -> float:
    """Rms in µm that these effects leave of the readings."""
    modelled = rig.model_copy(update={"effects": tuple(effects)}).with_calibration(None, None)
    return 1e3 * rms(residuals_mm(runs, modelled))


def _correction(
    way: Way, sentence: str, before_um: float, expected_um: float | None = None, **fields: Any
) -> SessionCorrection:
    before_um, expected_um = (round(um, 1) for um in (before_um, before_um if expected_um is None else expected_um))
    return SessionCorrection(
        way=way, sentence=sentence, before_um=before_um, expected_um=expected_um, directory=CORRECTIONS, **fields
    )


def entries_file(directory: Path) -> Path:
    return directory / CORRECTIONS_FILE


def reading_deg(directory: Path) -> tuple[float, ...]:
    """Offsets of the joint readings (6,) in degrees by the entered values of a correction."""
    data = read_yaml((directory / CORRECTIONS_FILE).read_text(encoding="utf-8"), str(directory / CORRECTIONS_FILE))[1]
    added_deg = [0.0] * 6
    for entry in data["controller"]["entries"]:
        added_deg[entry["axis"] - 1] += entry["reading_deg"]
    return tuple(data["controller"].get("readings_deg", added_deg))


def corrected_programs(
    rig: Rig, model: Rig, stages: Sequence[Stage], steps: Sequence[ProgramStep]
) -> dict[str, SessionProgram]:
    """Corrected programs by the name of the nominal program that each replaces."""
    return programs_by_step(stages, steps, partial(_of_test, rig, model), FIXED)


def _of_test(rig: Rig, model: Rig, stage: Stage, test: DrivenTest) -> list[SessionProgram]:
    programs = programs_for(rig, stage, test, arc_deg=_ARC_DEG)
    moved = stage_rig(rig, stage).modelled_as(model)
    targets = [targets_of(program.plan) for program in programs]
    q = np.array([target.q for of_program in targets for target in of_program])
    ahead = np.concatenate([ahead_of_plays(moved, program.plan) for program in programs])
    angles, _, failures = corrected_angles(moved, supports(model), q)
    where = f"the corrected programs of the stage {stage.name}"
    if failures:
        problem = f"{len(failures)} targets cannot be corrected: {failures[0].what}"
        raise FileError(where, problem, _ENTER, code="correction.impossible")
    angles = angles + ahead
    poses = forward(controller_arm(moved.robot), angles)
    plans = compensated([program.plan for program in programs], angles, poses, range(1, len(q) + 1), where)
    return [replace(program, plan=plan, corrected="targets") for program, plan in zip(programs, plans, strict=True)]


def _between_targets_um(rig: Rig, model: Rig, stage: Stage, programs: Sequence[SessionProgram]) -> float:
    """Rms error in µm of corrected circle programs between targets, from waves with a short period and from play."""
    moved = stage_rig(rig, stage).modelled_as(model)
    effects = (*used_effects(model, supports(model)), *known_plays(moved))
    real, frame = model_of(moved, effects), frame_of(circle_of(moved))
    squares = []
    for program in programs:
        q = np.concatenate([step.q for step in program.plan.steps if isinstance(step, Arc)])
        place = tool_poses(real, q)[:, :3, 3] - frame.centre
        phi = np.arctan2(place @ frame.v, place @ frame.u)
        distance = np.linalg.norm(place, axis=1)
        set_up = np.stack([np.ones_like(phi), np.cos(phi), np.sin(phi)], axis=1)
        squares.append((distance - set_up @ np.linalg.lstsq(set_up, distance)[0]) ** 2)
    return 1e3 * float(np.sqrt(np.mean(np.concatenate(squares))))

"""End of a session: the path error before and after the correction, and the page.

Readings are compared with the commanded circle, independent of the joint angles sent by the controller.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from analysis.api import diagnose, evaluate_runs
from analysis.apps.report.page.accuracy import judge
from analysis.apps.report.page.write_page import gather, write_page
from analysis.apps.session.correction_step import CORRECTIONS, reading_deg
from analysis.apps.session.session_answer import before_after
from analysis.apps.session.session_state import ELSEWHERE, ProgramStep, Session, SessionDirectory, VerifiedError
from analysis.correction.deviation import Deviation
from analysis.correction.work import tool_poses
from analysis.diagnosis.judge.comparison import compare
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import circle_laps, circle_of
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.robot.predict import model_of
from analysis.runs.loading import Measured, load_measured
from analysis.runs.noise.readings import rms
from analysis.runs.tables import CircleTable
from rigs.errors import RigError
from rigs.load import load
from rigs.rig import Rig

if TYPE_CHECKING:
    from analysis.diagnosis.judge.result import Diagnosis

PAGE = "report.html"


def verified_by(session: Session, place: SessionDirectory) -> VerifiedError:
    """Path error before and after the correction, on the same tests and at the other place."""
    model: Rig | None = None
    added_deg: Sequence[float] = (0.0,) * 6
    if session.answer and session.correction and session.correction.way != "none":
        model, _ = load(place.model_of(session.answer))
        if session.correction.way == "entries":
            added_deg = reading_deg(place.directory / CORRECTIONS)
    noise_um = session.answer.noise_um if session.answer else 0.0

    def error(steps: Sequence[ProgramStep], model: Rig | None = None) -> Deviation | None:
        return _path_error(place.runs_of(steps), model, added_deg, noise_um)

    verify = session.runs_for("verify")
    driven = [load_measured(run) for run in place.runs_of([step for step in verify if step.stage != ELSEWHERE])]
    tests = {(step.stage, step.test, step.direction) for step in verify}
    return VerifiedError(
        same_before=error([one for one in session.runs_for("find") if (one.stage, one.test, one.direction) in tests]),
        same_after=error([step for step in verify if step.stage != ELSEWHERE], model),
        elsewhere_before=error(session.runs_for("judge")),
        elsewhere_after=error([step for step in verify if step.stage == ELSEWHERE], model),
        standing=judge(evaluate_runs(driven), driven[0].rig.limits).overall if driven else "unjudged",
    )


def _path_error(
    runs: Sequence[Path], model: Rig | None, added_deg: Sequence[float], noise_um: float
) -> Deviation | None:
    """Deviation of the tool from the commanded circle, after fitting the set-ups; None without runs.

    noise_um: rms scatter of a run. model, added_deg: see `_as_commanded`.
    """
    measured = [_as_commanded(load_measured(path), model, added_deg) for path in runs]
    if not measured:
        return None
    # Both directions share a set-up, as in the residual and in the prediction. Separate fits would absorb half of a
    # play.
    every = np.concatenate([run.residuals_mm.ravel() for run in compare(measured, measured[0].rig).runs])
    um, largest_um = 1e3 * rms(every), float(1e3 * np.abs(every).max())
    u_um = noise_um / float(np.sqrt(len(measured)))
    return Deviation(um=round(um, 2), largest_um=round(largest_um, 2), u_um=round(u_um, 2), runs=len(measured))


def _as_commanded(run: Measured, model: Rig | None, added_deg: Sequence[float]) -> Measured:
    """Circle run of a rig without errors, with the joints of an ideal arm on the commanded circle.

    A corrected controller does not show these joints, so they follow from the circle angle. model: arm used by the
    controller, None if uncorrected; added_deg: offsets (6,) of the reported angles by its entered values.
    """
    table = run.table
    bare = run.rig.nominal
    if not isinstance(table, CircleTable):
        return replace(run, rig=bare)
    laps = circle_laps(bare, table.direction)
    if model is None:
        T = forward(arm_of(run.rig.robot), table.q)
    else:
        T = tool_poses(model_of(run.rig.modelled_as(model)), table.q - np.radians(added_deg))
    phi = frame_of(circle_of(run.rig)).angle(T[:, :3, 3])
    middle = (laps.phi[0] + laps.phi[-1]) / 2
    phi = phi + 2 * np.pi * np.round((middle - (phi.min() + phi.max()) / 2) / (2 * np.pi))
    order = np.argsort(laps.phi)
    q = np.stack([np.interp(phi, laps.phi[order], joint[order]) for joint in laps.q.T], axis=1)
    return replace(run, rig=bare, table=replace(table, q=q))


def write_report(session: Session, rig: Rig, place: SessionDirectory, diagnosis: Diagnosis | None = None) -> Path:
    """Write the page of a session.

    The figures show the runs for finding errors, the diagnosis all runs before the correction. diagnosis: that of these
    runs, if it exists.
    """
    find, judges = (
        [load_measured(run) for run in place.runs_of(session.runs_for(purpose))] for purpose in ("find", "judge")
    )
    model = find[0].rig.modelled_as(rig)
    joined = judges if session.answer and session.answer.joined else []
    with suppress(RigError):  # the page gives the reason for the runs that find errors
        diagnosis = diagnose([*find, *joined], rig=model) if joined and diagnosis is None else diagnosis
    results, after = evaluate_runs(find), None
    verify = [step for step in session.runs_for("verify") if step.stage != ELSEWHERE and session.is_corrected]
    driven = [load_measured(run) for run in place.runs_of(verify)]
    if session.verified is not None:
        after = before_after(session, place.directory, judge(evaluate_runs(driven), model.limits) if driven else None)
    report = gather(results, model, diagnosis=diagnosis, after=after, progress=lambda _: None)
    return write_page(report, place.directory / PAGE)

"""Final page of a session: the report of the runs, and the error of the robot before and after the correction."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.api import diagnose, evaluate_runs
from analysis.apps.report.page.accuracy import judge
from analysis.apps.report.page.write_page import gather, write_page
from analysis.apps.session.answer import ControllerModel, path_error
from analysis.apps.session.correction_step import CORRECTIONS, reading_deg
from analysis.apps.session.session_answer import before_after
from analysis.apps.session.session_state import ELSEWHERE, Session, SessionDirectory, VerifiedError
from analysis.runs.loading import load_measured
from rigs.errors import RigError
from rigs.load import load
from rigs.rig import Rig

if TYPE_CHECKING:
    from analysis.diagnosis.judge.result import Diagnosis

PAGE = "report.html"


def verified_by(session: Session, place: SessionDirectory) -> VerifiedError:
    nominal = after = ControllerModel()
    noise_um = session.answer.noise_um if session.answer else 0.0
    if session.answer is not None and session.correction is not None and session.correction.way != "none":
        entered = session.correction.way == "entries"
        model, _ = load(place.model_of(session.answer))
        after = ControllerModel(model, reading_deg(place.directory / CORRECTIONS) if entered else (0.0,) * 6)
    verify = session.runs_for("verify")
    tests = {(step.stage, step.test, step.direction) for step in verify}
    main = [step for step in session.runs_for("find") if (step.stage, step.test, step.direction) in tests]
    sides = {
        "same_before": (main, nominal),
        "same_after": ([step for step in verify if step.stage != ELSEWHERE], after),
        "elsewhere_before": (session.runs_for("judge"), nominal),
        "elsewhere_after": ([step for step in verify if step.stage == ELSEWHERE], after),
    }
    return VerifiedError(
        **{name: path_error(place.runs_of(steps), by, noise_um) for name, (steps, by) in sides.items()}
    )


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

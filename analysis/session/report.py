"""The page at the end of a session: the report of its runs, and the error of the robot before and after."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from analysis.api import Diagnosis, diagnose, evaluate_runs
from analysis.reporting.page.before_after import BeforeAfter, Expectation, Row, Side
from analysis.reporting.page.report import gather
from analysis.reporting.page.verdict import judge
from analysis.reporting.page.write_page import write_page
from analysis.session.plan import ELSEWHERE
from analysis.session.state import Expected, PathError, Place, Session, own_programs
from analysis.traces.loading import Measured, load_measured
from rigs.errors import RigError
from rigs.rig import Rig

PAGE = "report.html"


def write_report(session: Session, rig: Rig, place: Place) -> Path:
    """Write the page of a session, in place of an older one: figures of the runs that find errors, and the diagnosis of
    all runs before the correction. Raises FileError and CellError."""
    find, judge = (
        [load_measured(place.run(step.run)) for step in session.runs_for(purpose) if step.run]
        for purpose in ("find", "judge")
    )
    model = find[0].rig.modelled_as(rig)
    joined = judge if session.answer and session.answer.joined else []
    report = gather(
        evaluate_runs(find),
        model,
        diagnosis=_diagnosed([*find, *joined], model) if joined else None,
        after=_before_after(session, place, model),
        progress=_silent,
    )
    return write_page(report, place.directory / PAGE)


def _diagnosed(runs: list[Measured], model: Rig) -> Diagnosis | None:
    """The diagnosis of all runs; None where there is none, and the page says why for those that find errors."""
    try:
        return diagnose(runs, rig=model)
    except RigError:
        return None


def _before_after(session: Session, place: Place, model: Rig) -> BeforeAfter | None:
    verified, correction, judged = session.verified, session.correction, session.judged
    if verified is None or correction is None:
        return None
    sides: tuple[tuple[Literal["same", "elsewhere"], PathError | None, PathError | None, Expected | None], ...] = (
        ("same", verified.same_before, verified.same_after, correction.same),
        ("elsewhere", verified.elsewhere_before, verified.elsewhere_after, correction.elsewhere),
    )
    rows = [
        Row(key, _side(before), _side(after) if after else None, Expectation(by.um, by.u_um) if by else None)
        for key, before, after, by in sides
        if before
    ]
    work = correction.work
    verify = [step for step in session.runs_for("verify") if step.stage != ELSEWHERE and session.is_corrected]
    driven = [load_measured(place.run(step.run)) for step in verify if step.run]
    return BeforeAfter(
        correction.sentence,
        correction.way,
        tuple(rows),
        work=(work.before_um, work.after_um, work.u_um) if work else None,
        judged=(judged.before_there_um, judged.calibrated_um) if judged and judged.before_there_um else None,
        joined=session.answer.joined if session.answer else 0,
        own_programs=own_programs(session, place.directory),
        verdict=judge(evaluate_runs(driven), model.limits) if driven else None,
    )


def _side(error: PathError) -> Side:
    return Side(error.um, error.u_um, error.largest_um, error.runs)


def _silent(doing: str) -> None:
    """Nothing is shown."""

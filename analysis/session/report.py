"""The page at the end of a session: the report of its runs, and the error of the robot before and after."""

from __future__ import annotations

from pathlib import Path

from analysis.api import Diagnosis, diagnose, evaluate_runs
from analysis.reporting.page.before_after import BeforeAfter, Row
from analysis.reporting.page.report import gather
from analysis.reporting.page.verdict import judge
from analysis.reporting.page.write_page import write_page
from analysis.session.plan import ELSEWHERE
from analysis.session.state import Place, Session, own_programs
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
    rows = []
    if verified.same_before:
        rows.append(Row("same", verified.same_before, verified.same_after, correction.same))
    if verified.elsewhere_before:
        rows.append(Row("elsewhere", verified.elsewhere_before, verified.elsewhere_after, correction.elsewhere))
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


def _silent(doing: str) -> None:
    """Nothing is shown."""

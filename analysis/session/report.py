"""The page at the end of a session: the report of its runs, and the error of the robot before and after."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from analysis.api import evaluate_runs
from analysis.reporting.page.before_after import BeforeAfter, Side
from analysis.reporting.page.report import gather
from analysis.reporting.page.write_page import write_page
from analysis.session.state import PathError, Place, Session
from analysis.traces.loading import load_measured
from rigs.rig import Rig

PAGE = "report.html"


def write_report(session: Session, rig: Rig, place: Place) -> Path:
    """Write the page of a session, in place of an older one. Raises FileError and CellError."""
    used = [place.run(step.run) for step in session.runs_for("find") if step.run]
    measured = [load_measured(path) for path in used]
    report = gather(
        evaluate_runs(measured), measured[0].rig.modelled_as(rig), after=_before_after(session), progress=_silent
    )
    return write_page(report, place.directory / PAGE)


def _before_after(session: Session) -> BeforeAfter | None:
    verified, correction = session.verified, session.correction
    if verified is None or correction is None:
        return None
    sides: tuple[tuple[Literal["same", "elsewhere"], PathError | None, PathError | None], ...] = (
        ("same", verified.same_before, verified.same_after),
        ("elsewhere", verified.elsewhere_before, verified.elsewhere_after),
    )
    rows = [(key, _side(before), _side(after) if after else None) for key, before, after in sides if before]
    return BeforeAfter(correction.sentence, tuple(rows))


def _side(error: PathError) -> Side:
    return Side(error.um, error.u_um, error.largest_um, error.runs)


def _silent(doing: str) -> None:
    """Nothing is shown."""

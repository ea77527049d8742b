"""A session as a page shows it: what comes next, what was driven, what was found."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from analysis.correction.deviation import Deviation
from analysis.session.next_step import Correct, Decide, Done, Drive, Enter, Infer, Report, next_of
from analysis.session.state import Correction, Session, Verified
from analysis.session.words import correction_lines

_BUSY = {Infer: "infer", Decide: "decide", Correct: "correct", Report: "report"}


def summary(session: Session) -> dict[str, Any]:
    """Return a session as plain values; its texts stay as the session says them."""
    answer, correction, verified = session.answer, session.correction, session.verified
    return {
        "rig": session.rig,
        "began": session.began,
        "next": _next(session),
        "steps": [
            {
                "program": step.program,
                "state": "driven" if step.run else "skipped" if step.skipped else "again" if step.tries else "open",
                "run": step.run or "",
                "why": step.skipped or (step.tries[-1].why if step.tries and not step.run else ""),
            }
            for step in session.steps
        ],
        "headline": answer.headline if answer else "",
        "accuracy": (session.judged or answer).accuracy if answer and not session.is_corrected else "",
        "runs": answer.runs if answer else 0,
        "parts": [
            {"part": f"{part.part} {part.size}".strip(), "share": part.share, "um": part.um, "fault": part.fault}
            for part in (answer.parts if answer else ())
        ],
        "remedies": list(session.to_do),
        "correction": next(correction_lines(correction, verified)) if correction else "",
        "before_after": [*_before_after(verified, correction)] if verified else [],
        "work": correction.work.model_dump() if correction and correction.work else None,
        "report": session.report,
    }


def _next(session: Session) -> dict[str, Any]:
    """What comes next: its key among the texts, and what that text names."""
    following = next_of(session)
    match following:
        case Drive(number):
            step = session.steps[number]
            words = session.stage_of(step).words
            return {
                "key": "drive",
                "program": step.program,
                "number": number + 1,
                "of": len(session.steps),
                "stage": words,
            }
        case Enter():
            return {"key": "enter"}
        case Done():
            return {"key": "done"}
    return {"key": _BUSY[type(following)]}


def _before_after(verified: Verified, correction: Correction | None) -> Iterator[dict[str, Any]]:
    """Yield the error before and after, and what was expected, at each place that was driven."""
    at_place, elsewhere = (correction.same, correction.elsewhere) if correction else (None, None)
    for where, before, after, expected in (
        ("same", verified.same_before, verified.same_after, at_place),
        ("elsewhere", verified.elsewhere_before, verified.elsewhere_after, elsewhere),
    ):
        if before:
            yield {
                "where": where,
                "before": _error(before),
                "after": _error(after),
                "expected": ({"um": expected.um, "u_um": expected.u_um} if expected else None),
            }


def _error(error: Deviation | None) -> dict[str, float] | None:
    return {"um": error.um, "u_um": error.u_um, "largest_um": error.largest_um} if error else None

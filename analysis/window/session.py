"""A session as a page shows it: what comes next, what was driven, what was found."""

from __future__ import annotations

from typing import Any

from analysis.session.next_step import Drive, Infer, next_of
from analysis.session.state import Session
from analysis.session.words import correction_lines


def summary(session: Session) -> dict[str, Any]:
    """Return a session as plain values; its texts stay as the session says them."""
    answer, correction = session.answer, session.correction
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
        "correction": next(correction_lines(correction, session.sides)) if correction else "",
        "before_after": [
            {
                "where": side.place,
                "before": side.before.model_dump(exclude={"runs"}),
                "after": side.after.model_dump(exclude={"runs"}) if side.after else None,
                "expected": side.expected.model_dump() if side.expected else None,
            }
            for side in session.sides
        ],
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
        case Infer():
            return {"key": "infer"}
    return {"key": following}

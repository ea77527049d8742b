"""What comes next in a session: it follows from the state alone, so that a session goes on wherever it was cut off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from analysis.apps.session.session_state import MAIN, Answer, Purpose, Session

_UNEXPLAINED = 0.1
"""Share of the error without an explanation up to which named faults answer the question. Chosen."""
_SETTLED = ("named", "nothing_unusual", "uncalibrated")
"""Conditions that more runs of the same would not change."""


@dataclass(frozen=True)
class Drive:
    """The step of this number is driven."""

    number: int


@dataclass(frozen=True)
class Infer:
    """What there is, is understood. joins: whether the runs of the place that has judged are used as well."""

    joins: bool = False


Following = Drive | Infer | Literal["decide", "correct", "enter", "report", "done"]
"""What comes next. decide: the answer decides whether more is measured; correct: the correction is made; enter: its
values are entered; report: what was driven afterwards is set beside what was before, and the page is written; done:
nothing is left."""


def next_of(session: Session) -> Following:
    """Return what comes next in a session."""
    if (number := first_open(session, "find")) is not None:
        return Drive(number)
    if not session.answered:
        is_known = session.answer is not None and session.answer.runs == len(session.runs_for("find"))
        return "decide" if is_known else Infer()
    if (number := first_open(session, "judge")) is not None:
        return Drive(number)
    # The errors are found, and the place that judges was driven.
    following = _correcting(session) if session.aim != "check" else None
    return following or ("done" if session.report else "report")


def _correcting(session: Session) -> Following | None:
    """What comes next from the last inference to the last run after the correction, None after that."""
    answer, correction = session.answer, session.correction
    if correction is None:
        if answer is not None and session.is_last(answer):
            return "correct" if session.decided == answer.runs else "decide"
        # The other place judges first what was found without it; then its runs join, and what all of them show decides.
        run_counts = len(session.runs_for("find")), len(session.runs_for("judge"))
        judged = session.judged
        return Infer(joins=judged is not None and (judged.runs, judged.judges) == run_counts)
    if correction.way == "entries" and not correction.entered:
        return "enter"
    number = first_open(session, "verify")
    return None if number is None else Drive(number)


def first_open(session: Session, purpose: Purpose) -> int | None:
    """Return the number of the first open step with a purpose."""
    return next((k for k, step in enumerate(session.steps) if step.purpose == purpose and step.is_open), None)


def is_answered(session: Session, answer: Answer) -> bool:
    """Whether what is asked is known: repeats in both directions were used, the condition is settled, and no group that
    makes much of the error beside the faults waits for the test that names it."""
    used = session.runs_for("find")[: answer.runs - answer.joined]
    circles = [(step.test, step.direction) for step in used if step.direction]
    repeated = bool(circles) and all(circles.count(circle) >= _REPEATS for circle in ((MAIN, "acw"), (MAIN, "cw")))
    unexplained = sum(part.share for part in answer.parts if part.kind == "unexplained")
    is_open = answer.condition == "named" and any(act.why == "group" for act in answer.acts)
    return repeated and answer.condition in _SETTLED and unexplained <= _UNEXPLAINED and not is_open


def why_nothing(session: Session) -> str:
    """Return why the robot is not corrected by what was found, in a sentence; empty where it may be.

    Where the other place judged, its verdict counts, and not that of the last answer, which nothing judged.
    """
    answer = session.judged or session.answer
    return _WHY_NOTHING.get(answer.ground, "") if answer else ""


_WHY_NOTHING = {
    "unknown_cause": "Do not correct: most of the error has an unknown cause, and a correction may increase the error "
    "elsewhere. To correct anyway: --correct programs.",
    "not_shown": "Do not correct: these runs cannot show the cause. To correct anyway: --correct programs.",
    "no_gain_elsewhere": "Do not correct: the model does not reduce the error on other runs. To correct anyway: "
    "--correct programs.",
}
"""The advice for each ground on which nothing is corrected (`rigs.calibration.ground_of`)."""
_REPEATS = 2
"""Runs of a circle in each direction, at least, before its scatter is measured."""

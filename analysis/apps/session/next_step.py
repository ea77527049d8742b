"""Next step of a session, derived only from the stored state, so that an interrupted session can resume anywhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from analysis.apps.session.session_state import MAIN, Answer, Purpose, Session

_UNEXPLAINED = 0.1
"""Maximum unexplained share of the error if named faults are to answer the question. Chosen."""
_SETTLED = ("named", "nothing_unusual", "uncalibrated")
"""Conditions that more runs of the same tests would not change."""


@dataclass(frozen=True)
class Drive:
    number: int


@dataclass(frozen=True)
class Infer:
    """Diagnose the available runs. joins: also use the runs of the other place, after their judgement."""

    joins: bool = False


Following = Drive | Infer | Literal["decide", "correct", "enter", "report", "done"]
"""decide: are more tests needed? enter: have the values entered. report: compare the runs before and after, and write
the page.
"""


def next_of(session: Session) -> Following:
    if (number := first_open(session, "find")) is not None:
        return Drive(number)
    if not session.answered:
        is_known = session.answer is not None and session.answer.runs == len(session.runs_for("find"))
        return "decide" if is_known else Infer()
    if (number := first_open(session, "judge")) is not None:
        return Drive(number)
    # The search for errors is complete, and the other place was driven.
    following = _correcting(session) if session.aim != "check" else None
    return following or ("done" if session.report else "report")


def _correcting(session: Session) -> Following | None:
    """Step between the last inference and the last verification run; None after that run."""
    answer, correction = session.answer, session.correction
    if correction is None:
        if answer is not None and session.is_last(answer):
            return "correct" if session.decided == answer.runs else "decide"
        # First the other place judges a model found without it. Then its runs join, and the answer from all runs
        # decides.
        run_counts = len(session.runs_for("find")), len(session.runs_for("judge"))
        judged = session.judged
        return Infer(joins=judged is not None and (judged.runs, judged.judges) == run_counts)
    if correction.way == "entries" and not correction.entered:
        return "enter"
    number = first_open(session, "verify")
    return None if number is None else Drive(number)


def first_open(session: Session, purpose: Purpose, program: str = "") -> int | None:
    return next(
        (
            number
            for number, step in enumerate(session.steps)
            if step.purpose == purpose and step.is_open and program in ("", step.program)
        ),
        None,
    )


def shows_more(session: Session) -> bool:
    """True if there are both directions, and a new run or all runs of a kind."""
    find = session.runs_for("find")
    understood = session.answer.runs if session.answer else 0
    all_driven = first_open(session, "judge") is None and first_open(session, "find") is None
    both = len({step.direction for step in find}) > 1
    return both and (len(find) > understood or all_driven) and session.correction is None


def is_answered(session: Session, answer: Answer) -> bool:
    """True for repeats in both directions, a settled condition, little unexplained error, and no large group that
    another test could name.
    """
    used = session.runs_for("find")[: answer.runs - answer.joined]
    circles = [(step.test, step.direction) for step in used if step.direction]
    repeated = bool(circles) and all(circles.count(circle) >= _REPEATS for circle in ((MAIN, "acw"), (MAIN, "cw")))
    unexplained = sum(part.share for part in answer.parts if part.kind == "unexplained")
    is_open = answer.condition == "named" and any(act.why == "group" for act in answer.acts)
    return repeated and answer.condition in _SETTLED and unexplained <= _UNEXPLAINED and not is_open


def why_nothing(session: Session) -> str:
    """Reason not to correct the robot; empty if a correction is allowed. The verdict of the other place counts, if
    there is one.
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
"""Advice for each ground on which a correction is refused (`rigs.calibration.ground_of`)."""
_REPEATS = 2
"""Minimum number of runs of a circle in each direction for measuring the scatter."""

"""Guide of a session: the decisions about the next step.

The guide is a pure function of a state and an event, and returns the next state and actions.
`analysis.apps.session.run_session` executes the actions and reports the results as further events. The next step
depends only on the stored session (`analysis.apps.session.next_step`), so an interrupted session can resume anywhere.
The other fields of the state describe the work in progress.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

from analysis.apps.session import session_words as words
from analysis.apps.session.daemon_cell import ProgramRun
from analysis.apps.session.next_step import Drive, Infer, first_open, is_answered, next_of, why_nothing
from analysis.apps.session.session_plan import SessionPace, minutes_of, numbered, separating
from analysis.apps.session.session_state import (
    MOST_TRIES,
    Answer,
    ProgramStep,
    Purpose,
    Session,
    SessionCorrection,
    Stage,
    Try,
    VerifiedError,
    Way,
)
from rigs.errors import CellError
from rigs.rig import Rig
from rigs.text import counted

_T = TypeVar("_T")
_MOST_MORE = 4
"""Maximum number of stages added to separate rivals or to decide. If they do not suffice, an expert is needed."""


@dataclass(frozen=True)
class Runs:
    """Names of the runs of an inference: the runs used, and the runs that judge."""

    used: tuple[str, ...]
    judges: tuple[str, ...] = ()


@dataclass(frozen=True)
class GuideState:
    """A session and the work in progress.

    stage: stage that is set up. driving: number of the step being driven. inferring: runs of the inference in progress.
    ahead: runs of the final inference, if it was started in parallel with the judging inference.
    """

    session: Session
    stage: str = ""
    driving: int | None = None
    inferring: Runs | None = None
    ahead: Runs | None = None

    def keeping(self, **changed: object) -> GuideState:
        """Return the state with changed fields of the session."""
        return replace(self, session=self.session.model_copy(update=changed))

    def tried(self, number: int, attempt: Try) -> GuideState:
        """Return the state with an additional run of a step."""
        step = self.session.steps[number]
        tries = (*step.tries, attempt)
        return replace(self, session=self.session.with_step(number, step.model_copy(update={"tries": tries})))

    def skipping(self, purpose: Purpose, why: str) -> GuideState:
        """Skip the steps of a purpose that have no run, except the step being driven.

        An empty `why` reopens skipped steps.
        """
        steps = [
            step.model_copy(update={"skipped": why})
            if step.purpose == purpose and step.run is None and number != self.driving
            else step
            for number, step in enumerate(self.session.steps)
        ]
        return self.keeping(steps=tuple(steps))


# ----------------------------------------------------------------------------------------------------------------------
# Events.


@dataclass(frozen=True)
class Present:
    """Event: the directory contains a run unknown to the session.

    program: program of the run, if it may belong to a step.
    """

    run: str
    program: str = ""


@dataclass(frozen=True)
class Recorded:
    """A run was recorded, of the requested program or a different program."""

    run: ProgramRun
    minutes: float


@dataclass(frozen=True)
class Answered:
    """Event: an inference has finished.

    answer: None if it failed while a step is driven; more runs and a new inference then follow.
    """

    answer: Answer | None
    why: str = ""


@dataclass(frozen=True)
class CorrectionMade:
    """Event: the correction is computed.

    programs: names of corrected programs, by the name of the program that each replaces.
    """

    correction: SessionCorrection
    programs: Mapping[str, str]


@dataclass(frozen=True)
class Reported:
    """The page is written."""

    verified: VerifiedError | None
    page: str


Event = Present | Recorded | Answered | CorrectionMade | Reported | Literal["begun", "entered"]
"""begun: the session starts or resumes. entered: the values are entered at the controller."""


# ----------------------------------------------------------------------------------------------------------------------
# Actions, in addition to the next steps.


@dataclass(frozen=True)
class Say:
    """Print permanent lines."""

    lines: tuple[str, ...]


@dataclass(frozen=True)
class SetUpStage:
    """Write the programs of a stage and set it up."""

    stage: Stage


@dataclass(frozen=True)
class Begin:
    """Start an inference."""

    runs: Runs


@dataclass(frozen=True)
class EndSession:
    """Abort the session until a problem in the cell is solved."""

    error: CellError


Action = Say | SetUpStage | Begin | EndSession | Drive | Literal["await", "correct", "enter", "report"]
"""await: wait for the inference in progress. For the other literals see `Following`."""
Outcome = tuple[GuideState, tuple[Action, ...]]


@dataclass(frozen=True)
class Guide:
    """Decides the next actions in a session.

    directory: path of the session as printed for the user. chosen_way: way of the correction chosen by the user.
    """

    rig: Rig
    pace: SessionPace
    directory: Path
    chosen_way: Way | None = None

    def step(self, state: GuideState, event: Event) -> Outcome:
        """Return the next state and the actions. The state must be stored before the actions are executed.

        If a further event follows, the last action produces it.
        """
        changed, actions = state, tuple[Action, ...]()
        match event:
            case Present(run, program):
                return _adopted(state, run, program)
            case "begun":
                actions = (Say(tuple(words.plan_lines(state.session, self.pace, self.directory))),)
            case Recorded(run, minutes):
                changed, actions = _recorded(state, run, minutes)
            case Answered(None, why):
                changed, actions = replace(state, inferring=None), (Say((f"  no diagnosis yet: {why}",)),)
            case Answered(answer):
                changed, actions = _answered(replace(state, inferring=None), _of(answer))
            case CorrectionMade(correction, programs):
                changed, actions = _corrected(state, correction, programs)
            case "entered":
                correction = _of(state.session.correction)
                changed = state.keeping(correction=correction.model_copy(update={"entered": True}))
            case Reported(verified, page):
                changed = state.keeping(verified=verified, report=page)
        if changed.driving is not None:
            return changed, actions
        following, further = self._following(changed)
        return following, (*actions, *further)

    def _following(self, state: GuideState) -> Outcome:
        """Return the next state and actions when the robot is idle and all inferences are finished."""
        following = next_of(state.session)
        match following:
            case Drive(number):
                step = state.session.steps[number]
                stage = state.session.stage_of(step)
                asked = Say(tuple(words.step_lines(state.session, number)))
                driving = replace(state, stage=stage.name, driving=number)
                if stage.name == state.stage:
                    return driving, (asked, Drive(number))
                return driving, (
                    Say((f"-- set up {stage.name}: {stage.words}",)),
                    SetUpStage(stage),
                    asked,
                    Drive(number),
                )
            case Infer(joins):
                begun, actions = (state, ()) if state.inferring else _begun(state, joins=joins)
                return begun, (*actions, "await")
            case "decide":
                changed, actions = self._decided(state, _of(state.session.answer))
            case "correct" if why := self._nothing(state.session):
                none = SessionCorrection(way="none", sentence=why, before_um=0.0, expected_um=0.0)
                changed, actions = _corrected(state, none, {})
            case "done":
                return state, (Say(tuple(words.end_lines(state.session, self.directory))),)
            case _:
                return state, (following,)
        next_state, further = self._following(changed)
        return next_state, (*actions, *further)

    def _nothing(self, session: Session) -> str:
        """Return the reason for not correcting anything; empty if a correction is allowed."""
        answer = _of(session.answer)
        if not answer.model:
            return f"A correction is impossible: {answer.next_step}"
        return why_nothing(session) if self.chosen_way in (None, "none") else ""

    # ------------------------------------------------------------------------------------------------------------------
    # Decisions after an answer.

    def _decided(self, state: GuideState, answer: Answer) -> Outcome:
        """Insert a test that separates rivals or helps to decide. If there is none, close the search for errors."""
        session = state.session
        addition = self._more(session, answer) if session.aim != "check" else None
        if addition is None:
            decided = answer.runs if session.is_last(answer) else 0
            return state.keeping(answered=answer.condition, decided=decided), ()
        stage, steps = addition
        is_there = stage.name in [present.name for present in session.stages]
        stages = session.stages if is_there else (*session.stages, stage)
        at = next((k for k, step in enumerate(session.steps) if step.purpose != "find"), len(session.steps))
        ordered = numbered((*session.steps[:at], *steps, *session.steps[at:]), session.steps)
        reason = Say(tuple(words.more_lines(answer, stage)))
        return replace(state.keeping(stages=stages, steps=ordered), stage=""), (reason,)

    def _more(self, session: Session, answer: Answer) -> tuple[Stage, tuple[ProgramStep, ...]] | None:
        """Return a stage with steps that add information; None if none does, or if the time does not suffice."""
        if len(session.stages) >= 2 + _MOST_MORE:
            return None
        addition: tuple[Stage, tuple[ProgramStep, ...]] | None = None
        if answer.next_test and (_needs_other_test(answer) or session.is_last(answer)):
            tests = tuple(dict.fromkeys(step.test for step in session.runs_for("find")))
            addition = separating(self.rig, answer.next_test, tests, len(session.stages) + 1)
        elif answer.condition == "undecided" and answer.runs_to_decide is not None:
            # Repeat the main test in each direction, if that may decide.
            main = session.stages[0]
            main_steps = [step for step in session.steps if step.stage == main.name and step.purpose == "find"]
            once = list({step.program: step for step in main_steps}.values())
            if sum(bool(step.run) for step in main_steps) < len(once) * answer.runs_to_decide:
                addition = main, tuple(step.model_copy(update={"tries": (), "skipped": ""}) for step in once)
        # A test at the judging place is driven anyway, and its runs join the last diagnosis.
        judged_at = [stage.circle for stage in session.stages if stage.circle is not None]
        if addition is None or addition[0].circle in judged_at:
            return None
        need = minutes_of((addition[0],), (*addition[1], *session.open_steps), self.pace)
        return addition if session.driven_minutes + need <= session.minutes else None


# ----------------------------------------------------------------------------------------------------------------------
# Handling of each event.


def _needs_other_test(answer: Answer) -> bool:
    """Return whether a different test is needed to distinguish causes; more repeats would not help."""
    return answer.condition == "ambiguous" or (answer.condition == "undecided" and answer.runs_to_decide is None)


def _adopted(state: GuideState, run: str, program: str) -> Outcome:
    """Assign a run to an open step if it was recorded just before an interruption. Ignore all other runs."""
    following = next_of(state.session)
    if program and isinstance(following, Drive):
        number = _number_of(state.session, program, state.session.steps[following.number].purpose)
        if number is not None:
            return state.tried(number, Try(run=run)), ()
    left_alone = state.keeping(left_alone=(*state.session.left_alone, run))
    return left_alone, (Say((f"  {run} does not belong to a step of this session, or was interrupted: ignored",)),)


def _number_of(session: Session, program: str, purpose: Purpose) -> int | None:
    """Return the number of the first open step with this program and purpose."""
    steps = enumerate(session.steps)
    return next((k for k, step in steps if step.program == program and step.purpose == purpose and step.is_open), None)


def _recorded(state: GuideState, run: ProgramRun, minutes: float) -> Outcome:
    """Assign a run to the step of its program. If the run is usable and adds information, start an inference."""
    number, session = _of(state.driving), state.session
    idle = replace(state, driving=None).keeping(driven_minutes=round(session.driven_minutes + minutes, 2))
    usable = f"not usable: {run.why}; repeat the run" if run.why else "usable"
    actions = (Say((f"  {run.name}: {usable}",)),)
    step = session.steps[number]
    of = number if run.program == step.program else _number_of(session, run.program, step.purpose)
    if of is None:
        return idle.keeping(left_alone=(*session.left_alone, run.name)), actions
    tried = idle.tried(of, Try(run=run.name, why=run.why, held_up=run.held_up))
    if run.why:
        failed = _failed(tried.session.steps[of], is_emulated=session.emulated is not None)
        return tried, (*actions, *failed)
    # Run a single inference at a time, and only if it may show more than the last.
    find = tried.session.runs_for("find")
    understood = session.answer.runs if session.answer else 0
    all_driven = first_open(tried.session, "judge") is None and first_open(tried.session, "find") is None
    shows_more = len({step.direction for step in find}) > 1 and (len(find) > understood or all_driven)
    if not shows_more or tried.inferring is not None or session.correction is not None:
        return tried, actions
    begun, further = _begun(tried, joins=False)
    return begun, (*actions, *further)


def _failed(step: ProgramStep, *, is_emulated: bool) -> tuple[EndSession, ...]:
    """Abort after repeated failures of a step: a problem in the cell must be solved first."""
    last = step.tries[-1].why
    if len(step.tries) % MOST_TRIES:
        return ()
    if is_emulated or any(attempt.held_up for attempt in step.tries[-MOST_TRIES:]):
        vain = f"after {MOST_TRIES} failed attempts at {step.program}, last error: {last}"
        remedy = "close other programs, or use a faster computer; then repeat the command here"
        return (EndSession(CellError("this computer", f"was delayed, so that readings are missing ({vain})", remedy)),)
    remedy = "check the cell (rig doctor); then repeat the command here"
    return (EndSession(CellError(step.program, f"failed {MOST_TRIES} times, last error: {last}", remedy)),)


def _begun(state: GuideState, *, joins: bool) -> Outcome:
    """Start an inference with the available runs.

    joins: also use the runs of the other place, after their judgement.
    """
    find, judge = (
        tuple(step.run for step in state.session.runs_for(purpose) if step.run) for purpose in ("find", "judge")
    )
    every = Runs((*find, *judge))
    if joins:
        actions = () if state.ahead == every else (Begin(every),)
        return replace(state, inferring=every, ahead=None), actions
    asked = Runs(find, judge)
    # When the other place judges, run both inferences in parallel: computers have at least two cores.
    if judge and first_open(state.session, "judge") is None:
        return replace(state, inferring=asked, ahead=every), (Begin(asked), Begin(every))
    return replace(state, inferring=asked, ahead=None), (Begin(asked),)


def _answered(state: GuideState, answer: Answer) -> Outcome:
    """Store an answer. If it answers the question, skip the remaining steps for finding errors."""
    session, judges = state.session, len(state.session.runs_for("judge"))
    if judges and answer.runs > len(session.runs_for("find")):
        answer = answer.model_copy(update={"joined": judges})
    changed = state.keeping(answer=answer, judged=answer if answer.judges else session.judged)
    actions: tuple[Action, ...] = (Say(tuple(words.answer_lines(answer, session.answer))),)
    is_known = is_answered(changed.session, answer)
    # A later answer may be less certain. Steps are reopened as long as the ball is still in the same place.
    is_there = not judges and state.stage in ("", session.stages[0].name)
    if session.aim != "faults" or session.answered or not (is_known or is_there):
        return changed, actions
    early = changed.skipping("find", _ANSWERED if is_known else "")
    if count := abs(len(session.open_steps) - len(early.session.open_steps)):
        programs = counted(count, "further program is", "further programs are")
        sentence = f"{_ANSWERED}: {programs} skipped" if is_known else f"{_OPEN}: {programs} required after all"
        return early, (*actions, Say((f"  {sentence}",)))
    return changed, actions


_ANSWERED, _OPEN = "the causes are known", "the causes are not certain any more"
"""Reasons for skipping and reopening steps."""


def _corrected(state: GuideState, correction: SessionCorrection, programs: Mapping[str, str]) -> Outcome:
    """Store a correction. Its programs, if any, replace those of the verification steps."""
    changed = state
    if correction.way == "none":
        changed = state.skipping("verify", "the robot was not corrected")
    steps = [
        step.model_copy(update={"program": programs.get(step.program, step.program)})
        if step.purpose == "verify"
        else step
        for step in changed.session.steps
    ]
    kept = changed.keeping(correction=correction, steps=tuple(steps))
    # Entered values take effect in the current stage. Corrected programs must be loaded first.
    return replace(kept, stage=state.stage if correction.way == "entries" else ""), (
        Say((f"correction: {correction.sentence}",)),
    )


def _of(value: _T | None) -> _T:
    """Return a value that is always present at this point of a session."""
    assert value is not None  # noqa: S101 - by the step that comes next
    return value

"""The guide of a session: what each event makes of it, and what is done next.

Pure: the state and an event in, the next state and actions out. `analysis.apps.session.run_session` carries these out,
and says what came of them as events again. Which step comes next follows from what is kept alone
(`analysis.apps.session.next_step`), so that a session goes on wherever it was cut off; the rest of the state is what
goes on just now.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

from analysis.apps.session import session_words as words
from analysis.apps.session.daemon_cell import Run
from analysis.apps.session.next_step import Drive, Infer, first_open, is_answered, next_of, why_nothing
from analysis.apps.session.session_plan import Pace, minutes_of, numbered, separating
from analysis.apps.session.session_state import (
    MOST_TRIES,
    Answer,
    Correction,
    Purpose,
    Session,
    Stage,
    Step,
    Try,
    Verified,
    Way,
)
from rigs.errors import CellError
from rigs.rig import Rig
from rigs.text import counted

_T = TypeVar("_T")
_MOST_MORE = 4
"""So many stages are added at most to separate rivals or to decide: then a person has to think."""


@dataclass(frozen=True)
class Runs:
    """What an inference is about: names of the runs that are used, and of those that judge."""

    used: tuple[str, ...]
    judges: tuple[str, ...] = ()


@dataclass(frozen=True)
class State:
    """A session with what goes on in it: the stage that is set up, the number of the step that is driven, and the
    inferences under way. ahead: the last one, begun beside the one that the other place judges."""

    session: Session
    stage: str = ""
    driving: int | None = None
    inferring: Runs | None = None
    ahead: Runs | None = None

    def keeping(self, **changed: object) -> State:
        """Return the state with other values of the session."""
        return replace(self, session=self.session.model_copy(update=changed))

    def tried(self, number: int, attempt: Try) -> State:
        """Return the state with a further run of a step."""
        step = self.session.steps[number]
        tries = (*step.tries, attempt)
        return replace(self, session=self.session.with_step(number, step.model_copy(update={"tries": tries})))

    def skipping(self, purpose: Purpose, why: str) -> State:
        """Return the state without the steps of a purpose that were not driven, but for one that is being driven; an
        empty `why` opens them again."""
        steps = [
            step.model_copy(update={"skipped": why})
            if step.purpose == purpose and step.run is None and number != self.driving
            else step
            for number, step in enumerate(self.session.steps)
        ]
        return self.keeping(steps=tuple(steps))


# ----------------------------------------------------------------------------------------------------------------------
# What happens.


@dataclass(frozen=True)
class Present:
    """A run lies in the directory that the session does not know; program: of which it is, if it may be of a step."""

    run: str
    program: str = ""


@dataclass(frozen=True)
class Recorded:
    """A run was recorded: of the step that was asked for, or of another program."""

    run: Run
    minutes: float


@dataclass(frozen=True)
class Answered:
    """An inference has its answer; or none while a step is driven, and why: more runs follow, and with them another."""

    answer: Answer | None
    why: str = ""


@dataclass(frozen=True)
class Corrected:
    """The correction is made. programs: names of the corrected programs, by those whose place they take."""

    correction: Correction
    programs: Mapping[str, str]


@dataclass(frozen=True)
class Reported:
    """The page is written."""

    verified: Verified | None
    page: str


Event = Present | Recorded | Answered | Corrected | Reported | Literal["begun", "entered"]
"""begun: the session begins, or goes on; entered: the values are entered at the controller."""


# ----------------------------------------------------------------------------------------------------------------------
# What is done: besides the steps that come next.


@dataclass(frozen=True)
class Say:
    """Say lines that stay."""

    lines: tuple[str, ...]


@dataclass(frozen=True)
class SetUp:
    """Write the programs of a stage, and set it up."""

    stage: Stage


@dataclass(frozen=True)
class Begin:
    """Begin an inference."""

    runs: Runs


@dataclass(frozen=True)
class Stop:
    """End here: something in the cell must be put right first."""

    error: CellError


Action = Say | SetUp | Begin | Stop | Drive | Literal["await", "correct", "enter", "report"]
"""await: the inference that is under way; the others as of `Following`."""
Outcome = tuple[State, tuple[Action, ...]]


@dataclass(frozen=True)
class Guide:
    """Says what comes next in a session of a rig. directory: of the session, as it is named to a person; chosen_way:
    the way of the correction that a person chose."""

    rig: Rig
    pace: Pace
    directory: Path
    chosen_way: Way | None = None

    def step(self, state: State, event: Event) -> Outcome:
        """Return the next state, which is kept before anything is done, and what is to be done: the last action brings
        the next event, where one comes."""
        changed, actions = state, tuple[Action, ...]()
        match event:
            case Present(run, program):
                return _adopted(state, run, program)
            case "begun":
                actions = (Say(tuple(words.plan_lines(state.session, self.pace, self.directory))),)
            case Recorded(run, minutes):
                changed, actions = _recorded(state, run, minutes)
            case Answered(None, why):
                changed, actions = replace(state, inferring=None), (Say((f"  not understood yet: {why}",)),)
            case Answered(answer):
                changed, actions = _answered(replace(state, inferring=None), _of(answer))
            case Corrected(correction, programs):
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

    def _following(self, state: State) -> Outcome:
        """Return what comes next: nothing is driven, and no inference is waited for."""
        following = next_of(state.session)
        match following:
            case Drive(number):
                step = state.session.steps[number]
                stage = state.session.stage_of(step)
                asked = Say(tuple(words.step_lines(state.session, number)))
                driving = replace(state, stage=stage.name, driving=number)
                if stage.name == state.stage:
                    return driving, (asked, Drive(number))
                return driving, (Say((f"-- {stage.name}: {stage.words}",)), SetUp(stage), asked, Drive(number))
            case Infer(joins):
                begun, actions = (state, ()) if state.inferring else _begun(state, joins=joins)
                return begun, (*actions, "await")
            case "decide":
                changed, actions = self._decided(state, _of(state.session.answer))
            case "correct" if why := self._nothing(state.session):
                none = Correction(way="none", sentence=why, before_um=0.0, expected_um=0.0)
                changed, actions = _corrected(state, none, {})
            case "done":
                return state, (Say(tuple(words.end_lines(state.session, self.directory))),)
            case _:
                return state, (following,)
        next_state, further = self._following(changed)
        return next_state, (*actions, *further)

    def _nothing(self, session: Session) -> str:
        """Why nothing is corrected, empty where something may be."""
        answer = _of(session.answer)
        if not answer.model:
            return f"A correction is impossible: {answer.next_step}"
        return why_nothing(session) if self.chosen_way in (None, "none") else ""

    # ------------------------------------------------------------------------------------------------------------------
    # What an answer decides.

    def _decided(self, state: State, answer: Answer) -> Outcome:
        """Put the test next that separates rivals or decides, or go on."""
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

    def _more(self, session: Session, answer: Answer) -> tuple[Stage, tuple[Step, ...]] | None:
        """Return a stage with steps that would show more, None where none would, or the time is over."""
        if len(session.stages) >= 2 + _MOST_MORE:
            return None
        addition: tuple[Stage, tuple[Step, ...]] | None = None
        if answer.next_test and (_needs_other_test(answer) or session.is_last(answer)):
            tests = tuple(dict.fromkeys(step.test for step in session.runs_for("find")))
            addition = separating(self.rig, answer.next_test, tests, len(session.stages) + 1)
        elif answer.condition == "undecided" and answer.runs_to_decide is not None:
            # The same once more in each direction, where that may decide
            main = session.stages[0]
            main_steps = [step for step in session.steps if step.stage == main.name and step.purpose == "find"]
            once = list({step.program: step for step in main_steps}.values())
            if sum(bool(step.run) for step in main_steps) < len(once) * answer.runs_to_decide:
                addition = main, tuple(step.model_copy(update={"tries": (), "skipped": ""}) for step in once)
        # A test at the place that judges is driven anyway: its runs join the last diagnosis.
        judged_at = [stage.circle for stage in session.stages if stage.circle is not None]
        if addition is None or addition[0].circle in judged_at:
            return None
        need = minutes_of((addition[0],), (*addition[1], *session.open_steps), self.pace)
        return addition if session.driven_minutes + need <= session.minutes else None


# ----------------------------------------------------------------------------------------------------------------------
# What each event makes of the state.


def _needs_other_test(answer: Answer) -> bool:
    """Return whether another test is needed to distinguish causes, and no more runs of the same."""
    return answer.condition == "ambiguous" or (answer.condition == "undecided" and answer.runs_to_decide is None)


def _adopted(state: State, run: str, program: str) -> Outcome:
    """Take a run that was recorded for an open step just before the session was cut off; leave all others alone."""
    following = next_of(state.session)
    if program and isinstance(following, Drive):
        number = _number_of(state.session, program, state.session.steps[following.number].purpose)
        if number is not None:
            return state.tried(number, Try(run=run)), ()
    left_alone = state.keeping(left_alone=(*state.session.left_alone, run))
    return left_alone, (Say((f"  {run} does not belong to a step of this session, or was interrupted: ignored",)),)


def _number_of(session: Session, program: str, purpose: Purpose) -> int | None:
    """Return the number of the first open step of a program with a purpose."""
    steps = enumerate(session.steps)
    return next((k for k, step in steps if step.program == program and step.purpose == purpose and step.is_open), None)


def _recorded(state: State, run: Run, minutes: float) -> Outcome:
    """Take a run as what it is; where it can be used, try to understand what there is meanwhile."""
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
    # One inference at a time, and only where it would show more than the last one
    find = tried.session.runs_for("find")
    understood = session.answer.runs if session.answer else 0
    all_driven = first_open(tried.session, "judge") is None and first_open(tried.session, "find") is None
    shows_more = len({step.direction for step in find}) > 1 and (len(find) > understood or all_driven)
    if not shows_more or tried.inferring is not None or session.correction is not None:
        return tried, actions
    begun, further = _begun(tried, joins=False)
    return begun, (*actions, *further)


def _failed(step: Step, *, is_emulated: bool) -> tuple[Stop, ...]:
    """End where a step was driven in vain so often that something in the cell must be put right."""
    last = step.tries[-1].why
    if len(step.tries) % MOST_TRIES:
        return ()
    if is_emulated or any(attempt.held_up for attempt in step.tries[-MOST_TRIES:]):
        vain = f"after {MOST_TRIES} failed attempts at {step.program}, the last time: {last}"
        remedy = "close other programs, or use a faster computer; then repeat the command here"
        return (Stop(CellError("this computer", f"was delayed, so that readings are missing ({vain})", remedy)),)
    remedy = "check the cell (rig doctor); then repeat the command here"
    return (Stop(CellError(step.program, f"failed {MOST_TRIES} times, the last time: {last}", remedy)),)


def _begun(state: State, *, joins: bool) -> Outcome:
    """Begin to understand what there is. joins: whether the runs of the place that has judged are used as well."""
    find, judge = (
        tuple(step.run for step in state.session.runs_for(purpose) if step.run) for purpose in ("find", "judge")
    )
    every = Runs((*find, *judge))
    if joins:
        actions = () if state.ahead == every else (Begin(every),)
        return replace(state, inferring=every, ahead=None), actions
    asked = Runs(find, judge)
    # Where the other place judges, both at once, since a computer has two cores.
    if judge and first_open(state.session, "judge") is None:
        return replace(state, inferring=asked, ahead=every), (Begin(asked), Begin(every))
    return replace(state, inferring=asked, ahead=None), (Begin(asked),)


def _answered(state: State, answer: Answer) -> Outcome:
    """Keep an answer; where it answers the question, leave out what was still to be driven to find errors."""
    session, judges = state.session, len(state.session.runs_for("judge"))
    if judges and answer.runs > len(session.runs_for("find")):
        answer = answer.model_copy(update={"joined": judges})
    changed = state.keeping(answer=answer, judged=answer if answer.judges else session.judged)
    actions: tuple[Action, ...] = (Say(tuple(words.answer_lines(answer, session.answer))),)
    is_known = is_answered(changed.session, answer)
    # More runs may show less for sure: as long as the ball stands where it stood, they go on.
    is_there = not judges and state.stage in ("", session.stages[0].name)
    if session.aim != "faults" or session.answered or not (is_known or is_there):
        return changed, actions
    early = changed.skipping("find", _ANSWERED if is_known else "")
    if count := abs(len(session.open_steps) - len(early.session.open_steps)):
        programs = counted(count, "further program is", "further programs are")
        sentence = f"{_ANSWERED}: {programs} left out" if is_known else f"{_OPEN}: {programs} driven after all"
        return early, (*actions, Say((f"  {sentence}",)))
    return changed, actions


_ANSWERED, _OPEN = "the question is answered", "the question is open"
"""Why steps are left out, and why they are driven after all."""


def _corrected(state: State, correction: Correction, programs: Mapping[str, str]) -> Outcome:
    """Keep a correction; its programs take the place of those that would be driven after it, if there are any."""
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
    # Entries change the robot where it stands; corrected programs are loaded first.
    return replace(kept, stage=state.stage if correction.way == "entries" else ""), (
        Say((f"correction: {correction.sentence}",)),
    )


def _of(value: _T | None) -> _T:
    """What is there at this point of a session."""
    assert value is not None  # noqa: S101 - by the step that comes next
    return value

"""The step function of the guide: state and event as input, new state and commands as output."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from analysis.apps.session.daemon_cell import ProgramRun
from analysis.apps.session.guide import (
    Answered,
    Begin,
    CorrectionMade,
    EndSession,
    Event,
    Guide,
    GuideState,
    Outcome,
    Present,
    Recorded,
    Reported,
    Runs,
    Say,
    SetUpStage,
)
from analysis.apps.session.next_step import Drive, is_answered
from analysis.apps.session.session_plan import BY_ITSELF
from analysis.apps.session.session_state import Session, SessionAct, SessionCorrection, Try, VerifiedError
from analysis.correction.deviation import Deviation
from rigs.load import load
from tests.support.session_cell import NAMED, begun, cell_file

ACW, CW = "p01-yaw-acw", "p02-yaw-cw"
BY_PROGRAMS = SessionCorrection(way="programs", sentence="Load them.", before_um=50, expected_um=2)
BY_ENTRIES = BY_PROGRAMS.model_copy(update={"way": "entries"})
IN_VAIN = ProgramRun("r", ACW, "g1: 3 silent")


@pytest.fixture(scope="module")
def at_start(tmp_path_factory: pytest.TempPathFactory) -> Session:
    folder = tmp_path_factory.mktemp("step")
    return begun(cell_file(folder), folder / "session")


def driven(session: Session, *purposes: str, **changed: Any) -> Session:
    """The session after the runs r0, r1 … of all steps with these purposes."""
    steps = [
        step.model_copy(update={"tries": (Try(run=f"r{k}"),)}) if step.purpose in purposes else step
        for k, step in enumerate(session.steps)
    ]
    return session.model_copy(update={"steps": tuple(steps), **changed})


def stepped(state: GuideState, event: Event) -> Outcome:
    """Return the outcome of an event without messages."""
    guide = Guide(load("paper-fanuc")[0], BY_ITSELF, Path("session"))
    after, actions = guide.step(state, event)
    return after, tuple(action for action in actions if not isinstance(action, Say))


def known(session: Session) -> Session:
    """The session when all is understood and decided, and the correction comes."""
    before = driven(session, "find", "judge", answered="named")
    find, judges = len(before.runs_for("find")), len(before.runs_for("judge"))
    judged = NAMED.model_copy(update={"runs": find, "judges": judges})
    last = NAMED.model_copy(update={"runs": find + judges, "joined": judges, "model": "model.yaml"})
    return before.model_copy(update={"judged": judged, "answer": last, "decided": find + judges})


def test_the_first_program_is_driven_where_its_stage_is_set_up(at_start: Session) -> None:
    state, actions = stepped(GuideState(at_start), "begun")
    assert actions == (SetUpStage(at_start.stages[0]), Drive(0))
    assert (state.stage, state.driving, state.session) == ("yaw", 0, at_start)


@pytest.mark.parametrize(
    ("run", "tries", "left_alone", "following"),
    [
        (ProgramRun("r", ACW, ""), [1, 0], (), Drive(1)),
        (IN_VAIN, [1, 0], (), Drive(0)),
        (ProgramRun("r", CW, ""), [0, 1], (), Drive(0)),
        (ProgramRun("r", "p99-roll-cw", ""), [0, 0], ("r",), Drive(0)),
    ],
    ids=["usable", "in vain", "of another step", "of no step"],
)
def test_a_run_counts_as_what_it_is(
    run: ProgramRun, tries: list[int], left_alone: tuple[str, ...], following: Drive, at_start: Session
) -> None:
    state, actions = stepped(GuideState(at_start, "yaw", driving=0), Recorded(run, 0.5))
    assert [len(step.tries) for step in state.session.steps[:2]] == tries
    assert (state.session.left_alone, state.session.driven_minutes, actions) == (left_alone, 0.5, (following,))


@pytest.mark.parametrize(("held_up", "where"), [(0, ACW), (2, "this computer")])
def test_the_third_run_in_vain_ends_the_session_after_it_is_kept(held_up: int, where: str, at_start: Session) -> None:
    vain = Try(run="r", why=IN_VAIN.why, held_up=held_up)
    state = GuideState(at_start, "yaw", driving=0).tried(0, vain).tried(0, vain)
    after, actions = stepped(state, Recorded(IN_VAIN, 0.5))
    assert len(after.session.steps[0].tries) == 3
    assert isinstance(actions[0], EndSession) and actions[0].error.where == where


def test_both_directions_are_understood_while_the_next_program_is_driven(at_start: Session) -> None:
    state = GuideState(at_start, "yaw", driving=1).tried(0, Try(run="a"))
    state, actions = stepped(state, Recorded(ProgramRun("b", CW, ""), 0.5))
    assert actions == (Begin(Runs(("a", "b"))), Drive(2)) and state.inferring == Runs(("a", "b"))
    later, none = stepped(state, Answered(None, "no lap"))
    assert (later.inferring, later.session, none) == (None, state.session, ())
    answer = NAMED.model_copy(update={"runs": 2})
    later, none = stepped(state, Answered(answer))
    assert (later.inferring, later.session.answer, later.driving, none) == (None, answer, 2, ())


def test_two_inferences_begin_where_the_other_place_has_judged_and_the_second_is_awaited(at_start: Session) -> None:
    session = driven(at_start, "find", "judge", answered="named")
    number = max(k for k, step in enumerate(session.steps) if step.purpose == "judge")
    before = session.with_step(number, at_start.steps[number])
    step = before.steps[number]
    state, actions = stepped(
        GuideState(before, "other", driving=number), Recorded(ProgramRun("z", step.program, ""), 0.5)
    )
    find, judges = (tuple(step.run for step in state.session.runs_for(purpose)) for purpose in ("find", "judge"))
    assert actions == (Begin(Runs(find, judges)), Begin(Runs((*find, *judges))), "await")  # type: ignore[arg-type]
    judged = NAMED.model_copy(update={"runs": len(find), "judges": len(judges)})
    state, actions = stepped(state, Answered(judged))
    assert actions == ("await",) and state.inferring == Runs((*find, *judges))  # type: ignore[arg-type]
    assert state.session.judged == judged


def test_corrected_programs_take_the_place_of_those_that_verify(at_start: Session) -> None:
    names = {step.program: f"{step.program}-fixed" for step in at_start.steps if step.purpose == "verify"}
    state, (set_up, drive) = stepped(GuideState(known(at_start), "other"), CorrectionMade(BY_PROGRAMS, names))
    verify = [step.program for step in state.session.steps if step.purpose == "verify"]
    assert verify and all(name.endswith("-fixed") for name in verify)
    assert isinstance(set_up, SetUpStage) and isinstance(drive, Drive), (
        "also where its stage is set up: they are loaded"
    )


def test_entries_are_entered_before_anything_is_driven(at_start: Session) -> None:
    state, actions = stepped(GuideState(known(at_start), "other"), CorrectionMade(BY_ENTRIES, {}))
    assert actions == ("enter",) and state.stage == "other"
    state, (drive,) = stepped(state, "entered")
    assert isinstance(drive, Drive) and state.session.correction and state.session.correction.entered


def test_nothing_is_corrected_without_a_model_or_by_one_that_the_other_place_refuses(at_start: Session) -> None:
    session = known(at_start)
    assert session.answer and session.judged
    refused = session.model_copy(update={"judged": session.judged.model_copy(update={"ground": "unknown_cause"})})
    bare = session.model_copy(update={"answer": session.answer.model_copy(update={"model": ""})})
    for case in (refused, bare):
        state, actions = stepped(GuideState(case, "other"), "begun")
        assert actions == ("report",) and not state.session.open_steps
        assert state.session.correction and state.session.correction.way == "none"
    assert stepped(GuideState(session, "other"), "begun")[1] == ("correct",)


def test_the_page_is_the_end(at_start: Session) -> None:
    done = driven(known(at_start), "find", "judge", "verify", correction=BY_PROGRAMS)
    assert stepped(GuideState(done), "begun")[1] == ("report",)
    state, actions = stepped(GuideState(done), Reported(None, "report.html"))
    assert actions == () and state.session.report == "report.html"


def test_a_run_that_was_recorded_before_a_cut_is_taken_by_the_step_that_is_driven(at_start: Session) -> None:
    state, actions = stepped(GuideState(at_start), Present("r", ACW))
    assert (state.session.steps[0].run, actions) == ("r", ())
    state, _ = stepped(state, Present("s"))
    state, actions = stepped(state, Present("t", "p99-roll-cw"))
    assert (state.session.left_alone, actions) == (("s", "t"), ())


def test_what_becomes_of_a_correction_is_said_once_after_it(at_start: Session) -> None:
    repair = SessionAct(kind="repair", why="fault", words="Repair it. Do it instead.", corrected="Repair it.")
    answer = NAMED.model_copy(update={"acts": (repair, GROUP)})
    before = driven(known(at_start), "find", "judge", "verify", correction=BY_PROGRAMS, answer=answer)
    size = Deviation(um=9, largest_um=20, u_um=1, runs=2)
    after = before.model_copy(update={"verified": VerifiedError(same_before=size, same_after=size)})
    assert before.to_do == ("Repair it. Do it instead.", GROUP.words)
    assert after.to_do == ("Repair it.", GROUP.words)


GROUP = SessionAct(kind="measure", why="group", words="Drive roll: it names what makes 72 % of the error.")


@pytest.mark.parametrize(
    ("used", "changed", "is_so"),
    [(4, {}, True), (3, {}, False), (4, {"acts": (GROUP,)}, False), (4, {"condition": "ambiguous"}, False)],
)
def test_the_question_is_answered_by_the_runs_that_an_answer_has_used(
    at_start: Session, used: int, changed: dict[str, Any], is_so: bool
) -> None:
    answer = NAMED.model_copy(update={"runs": used, **changed})
    assert is_answered(driven(at_start, "find"), answer) == is_so


def test_what_was_left_out_is_driven_where_more_runs_say_less(at_start: Session) -> None:
    steps = list(at_start.steps)
    twice = [steps[0], steps[1], *steps[:4]]  # six programs to find errors
    find = [step.model_copy(update={"purpose": "find"}) for step in twice]
    steps = [
        *(step.model_copy(update={"tries": (Try(run=f"r{k}"),)}) for k, step in enumerate(find[:4])),
        *find[4:],
        *(step for step in at_start.steps if step.purpose != "find"),
    ]
    session = at_start.model_copy(update={"steps": tuple(steps)})
    driving = GuideState(session, stage="yaw", driving=4)
    early, _ = stepped(driving, Answered(NAMED.model_copy(update={"runs": 4})))
    assert [step.program for step in early.session.steps if step.skipped] == [find[5].program]
    less = NAMED.model_copy(update={"runs": 5, "acts": (GROUP,)})
    again, _ = stepped(early, Answered(less))
    assert not any(step.skipped for step in again.session.steps)
    at_other, _ = stepped(replace(early, stage="other"), Answered(less))
    assert at_other.session.steps[5].skipped

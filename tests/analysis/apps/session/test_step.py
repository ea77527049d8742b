"""Decisions of a session: the requests to a cell and the stored state, for a given state and given runs."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from analysis.apps.session import run_session
from analysis.apps.session.answer import Inference
from analysis.apps.session.cell import ProgramRun, RealCell
from analysis.apps.session.next_step import is_answered
from analysis.apps.session.run_session import Conductor
from analysis.apps.session.session_plan import SessionProgram
from analysis.apps.session.session_state import (
    Answer,
    ProgramStep,
    Session,
    SessionAct,
    SessionCorrection,
    SessionDirectory,
    Stage,
    Try,
    VerifiedError,
    own_programs,
)
from analysis.correction.deviation import Deviation
from rigs.errors import CellError
from rigs.load import load
from tests.support.refusals import refused
from tests.support.session_cell import NAMED, InstantDiagnosis, Killed, Screen, asked_for, begun, cell_file

ACW, CW = "p01-yaw-acw", "p02-yaw-cw"
BY_PROGRAMS = SessionCorrection(way="programs", sentence="Load them.", before_um=50, expected_um=2)
BY_ENTRIES = BY_PROGRAMS.model_copy(update={"way": "entries"})
GROUP = SessionAct(kind="measure", why="group", words="Drive roll.")


class Scripted(RealCell):
    """A cell that records the given runs, logs its requests, and ends the session at the next drive.

    diagnoses: answers or errors of the inferences, which are finished at the next look.
    """

    def __init__(self, runs: Sequence[ProgramRun], diagnoses: Sequence[Answer | CellError]) -> None:
        self.runs, self.diagnoses, self.requests = list(runs), list(diagnoses), list[Any]()

    def set_up(self, stage: Stage, programs: Mapping[str, SessionProgram]) -> None:
        self.requests.append(stage.name)

    def drive(self, step: ProgramStep, look: Callable[[], None]) -> ProgramRun:
        look()
        self.requests.append(step.program)
        if not self.runs:
            raise Killed
        return self.runs.pop(0)

    def infer(self, used: Sequence[Path], judges: Sequence[Path], rig_file: Path, directory: Path) -> Inference:
        self.requests.append(([run.name for run in used], len(judges)))
        return InstantDiagnosis(self.diagnoses.pop(0))  # like an inference

    def enter(self, file: Path) -> bool:
        self.requests.append("enter")
        return True


@pytest.fixture(scope="module")
def at_start(tmp_path_factory):
    folder = tmp_path_factory.mktemp("step")
    return begun(cell_file(folder), folder / "session")


@pytest.fixture(autouse=True)
def no_files(monkeypatch):
    """Write no programs, which would take most of the time."""
    monkeypatch.setattr(Conductor, "_write_stage", lambda *_: None)
    monkeypatch.setattr(run_session, "programs_of_steps", lambda *_: {})


def driven(session: Session, *purposes: str, **changed: Any) -> Session:
    """The session after the runs r0, r1 … of all steps with these purposes."""
    steps = [
        step.model_copy(update={"tries": (Try(run=f"r{k}"),)}) if step.purpose in purposes else step
        for k, step in enumerate(session.steps)
    ]
    return session.model_copy(update={"steps": tuple(steps), **changed})


def conduct(
    session: Session,
    place: Path,
    runs: Sequence[ProgramRun] = (),
    diagnoses: Sequence[Answer | CellError] = (),
    stage: str = "",
) -> tuple[Session, list[Any]]:
    """Continue a session until it drives without a run. Return the stored session and the requests to the cell."""
    cell = Scripted(runs, diagnoses)
    with SessionDirectory(place) as held:
        rig, text = load(session.rig_file)
        with pytest.raises(Killed):
            Conductor(rig, text, held, session, cell, Screen(), asked_for(session), stage=stage).run()
        kept = held.read()
    return kept or session, cell.requests


def known(session: Session) -> Session:
    """The session when all is diagnosed and decided, and the correction follows."""
    before = driven(session, "find", "judge", answered="named")
    find, judges = len(before.runs_for("find")), len(before.runs_for("judge"))
    judged = NAMED.model_copy(update={"runs": find, "judges": judges})
    last = NAMED.model_copy(update={"runs": find + judges, "joined": judges, "model": "model.yaml"})
    return before.model_copy(update={"judged": judged, "answer": last, "decided": find + judges})


@pytest.mark.parametrize(
    ("run", "tries", "left_alone", "following"),
    [
        (ProgramRun("r", ACW), [1, 0], (), CW),
        (ProgramRun("r", ACW, "g1: 3 silent"), [1, 0], (), ACW),
        (ProgramRun("r", CW), [0, 1], (), ACW),
        (ProgramRun("r", "p99-roll-cw"), [0, 0], ("r",), ACW),
    ],
    ids=["usable", "unusable", "of another step", "of no step"],
)
def test_run_counts_for_the_step_of_its_program(run, tries, left_alone, following, at_start, tmp_path):
    session, requests = conduct(at_start, tmp_path, [run])
    assert [len(step.tries) for step in session.steps[:2]] == tries
    assert session.left_alone == left_alone and requests == ["yaw", ACW, following]


@pytest.mark.parametrize(("held_up", "code"), [(0, "robot.refused"), (2, "computer.unsuitable")])
def test_third_unusable_run_ends_the_session(held_up, code, at_start, tmp_path):
    with refused(code) as error:
        conduct(at_start, tmp_path, [ProgramRun(f"r{k}", ACW, "g1: 3 silent", held_up) for k in range(3)])
    assert ACW in str(error.value) and "g1: 3 silent" in error.value.what
    kept = SessionDirectory(tmp_path).read()
    assert kept and len(kept.steps[0].tries) == 3 and kept.steps[0].is_open


@pytest.mark.parametrize("fails", [False, True])
def test_both_directions_are_diagnosed_during_the_next_program(fails, at_start, tmp_path):
    answer = NAMED.model_copy(update={"runs": 2})
    diagnosis = CellError("inference", "no lap", "see the log") if fails else answer
    session, requests = conduct(at_start, tmp_path, [ProgramRun("a", ACW), ProgramRun("b", CW)], [diagnosis])
    assert requests[3] == (["a", "b"], 0) and requests[4:] == [session.steps[2].program]
    assert session.answer == (None if fails else answer)


@pytest.mark.parametrize(("correction", "requests"), [(BY_PROGRAMS, []), (BY_ENTRIES, ["enter"])])
def test_correction_is_loaded_or_entered_before_the_verification(
    correction,
    requests,
    at_start,
    tmp_path,
    monkeypatch,
):
    verify = {step.program for step in at_start.steps if step.purpose == "verify"}
    by_programs = correction.way == "programs"
    fixed = {
        name: SessionProgram(f"{name}-fixed", "other", "yaw", "acw", None, 1.0)  # not driven
        for name in verify
        if by_programs
    }
    monkeypatch.setattr(run_session, "corrected", lambda *_: (correction, fixed))
    monkeypatch.setattr(run_session, "write_programs", lambda *_: None)
    session, made = conduct(known(at_start), tmp_path, stage="other")
    programs = [step.program for step in session.steps if step.purpose == "verify"]
    assert all(program.endswith("-fixed") == by_programs for program in programs)
    assert made[: len(requests)] == requests and made[-1] == programs[0]
    assert ("other" in made) == by_programs, "corrected programs are loaded also at the present stage"
    assert session.correction.entered != by_programs


def test_unconfirmed_entries_end_the_session(at_start, tmp_path, monkeypatch):
    monkeypatch.setattr(Scripted, "enter", lambda *_: False)
    with refused("answer.missing", "confirmed that the values are entered") as error:
        conduct(known(at_start).model_copy(update={"correction": BY_ENTRIES}), tmp_path)
    assert error.value.remedy.endswith(" --entered")


@pytest.mark.parametrize("is_refused", [True, False])
def test_nothing_is_corrected_without_a_model_or_against_the_judgement(is_refused, at_start, tmp_path, monkeypatch):
    session = known(at_start)
    assert session.answer and session.judged
    changed = {
        True: {"judged": session.judged.model_copy(update={"ground": "unknown_cause"})},
        False: {"answer": session.answer.model_copy(update={"model": ""})},
    }
    monkeypatch.setattr(Conductor, "_report", lambda _: pytest.fail("report"))
    monkeypatch.setattr(run_session, "corrected", lambda *_: pytest.fail("correction"))
    with pytest.raises(pytest.fail.Exception, match="report"):
        conduct(session.model_copy(update=changed[is_refused]), tmp_path)
    kept = SessionDirectory(tmp_path).read()
    assert kept.correction.way == "none" and not kept.open_steps


def test_correction_changes_the_recommended_acts(at_start):
    repair = SessionAct(kind="repair", why="fault", words="Repair it. Do it instead.", corrected="Repair it.")
    answer = NAMED.model_copy(update={"acts": (repair, GROUP)})
    before = driven(known(at_start), "find", "judge", "verify", correction=BY_PROGRAMS, answer=answer)
    size = Deviation(um=9, largest_um=20, u_um=1, runs=2)
    after = before.model_copy(update={"verified": VerifiedError(same_before=size, same_after=size)})
    assert before.to_do == (repair.words, GROUP.words) and after.to_do == (repair.corrected, GROUP.words)


@pytest.mark.parametrize(
    ("used", "changed", "is_so"),
    [(4, {}, True), (3, {}, False), (4, {"acts": (GROUP,)}, False), (4, {"condition": "ambiguous"}, False)],
)
def test_question_is_answered_by_repeats_in_both_directions(at_start, used, changed, is_so):
    answer = NAMED.model_copy(update={"runs": used, **changed})
    assert is_answered(driven(at_start, "find"), answer) == is_so


@pytest.mark.parametrize("stage", ["yaw", "other"])
def test_skipped_steps_are_reopened_while_the_ball_is_in_place(stage, at_start, tmp_path):
    twice = [at_start.steps[k].model_copy(update={"purpose": "find"}) for k in (0, 1, 0, 1, 2, 3)]
    steps = [step.model_copy(update={"tries": (Try(run=f"r{k}"),)}) for k, step in enumerate(twice[:4])]
    rest = [step for step in at_start.steps if step.purpose != "find"]
    session = at_start.model_copy(update={"steps": (*steps, *twice[4:], *rest)})
    with SessionDirectory(tmp_path) as held:
        rig, text = load(session.rig_file)
        cell = Scripted([], [])
        conductor = Conductor(rig, text, held, session, cell, Screen(), asked_for(session), stage="yaw", driving=4)
        conductor._store_answer(NAMED.model_copy(update={"runs": 4}))  # private: an answer during a step
        assert [step.program for step in conductor.session.steps if step.skipped] == [twice[5].program]
        conductor.stage = stage
        conductor._store_answer(NAMED.model_copy(update={"runs": 5, "acts": (GROUP,)}))
    assert bool(conductor.session.steps[5].skipped) == (stage == "other")


@pytest.mark.parametrize(("correction", "points"), [(BY_PROGRAMS, "computed"), (BY_ENTRIES, "taught --since")])
def test_own_programs_are_corrected_or_after_entries_converted(correction, points, at_start, tmp_path):
    correction = correction.model_copy(update={"directory": "corrections"})
    command = own_programs(known(at_start).model_copy(update={"correction": correction}), tmp_path)
    assert f"--points {points}" in command
    assert (str(tmp_path / "corrections" / "corrections.yaml") in command) == (correction.way == "entries")

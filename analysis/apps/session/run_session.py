"""Execution of `rig session`.

The next step depends only on the stored session (`analysis.apps.session.next_step`), so the same command resumes an
interrupted session anywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from analysis.apps.commission.cell_references import references_of
from analysis.apps.session.answer import Inference
from analysis.apps.session.cell import ProgramRun, RealCell, Screen, ServedCell
from analysis.apps.session.correction_step import CORRECTIONS, corrected, corrected_programs, entries_file
from analysis.apps.session.next_step import (
    Drive,
    Infer,
    first_open,
    is_answered,
    next_of,
    shows_more,
    why_nothing,
)
from analysis.apps.session.session_answer import diagnosis_blocks, plan_blocks, step_lines
from analysis.apps.session.session_plan import (
    FIXED,
    SessionOptions,
    SessionProgram,
    further_stage,
    insert_find_steps,
    numbered,
    planned,
    programs_of_steps,
    stage_text,
    write_programs,
)
from analysis.apps.session.session_state import (
    MOST_TRIES,
    Answer,
    ProgramStep,
    Purpose,
    Session,
    SessionCorrection,
    SessionDirectory,
    Stage,
    Try,
    digest_of,
)
from analysis.procedures.results import why_unusable
from analysis.procedures.shared.test_kind import facts_of
from analysis.runs.written_files import holding, write_all_over
from daq import clock
from daq.store import load_manifest, read_run
from daq.store.manifest import is_run
from rigs.errors import CellError, RigError, UseError
from rigs.load import load
from rigs.rig import Rig
from rigs.text import as_argument, counted

if TYPE_CHECKING:
    from analysis.diagnosis.judge.result import Diagnosis

_T = TypeVar("_T")
_POLL_S = 0.2
_ANSWERED, _OPEN = "the causes are known", "the causes are not certain any more"
"""Reasons for skipping and reopening steps."""


def run_session(
    rig: Rig,
    text: str,
    place: SessionDirectory,
    asked: SessionOptions,
    screen: Screen,
    make_cell: Callable[[Session], RealCell] | None = None,
) -> Session:
    """Start a session, or resume the stored one, and run it to the end.

    make_cell: default: the real cell, or the one emulated as requested.
    """
    with place:
        kept = place.read()
        if kept is None:
            for line in offer_lines(rig.name, [place.runs, Path("runs")]):
                screen.say(line)
        session = kept or _begun(rig, text, asked, screen)
        place.require_intact(session, text)
        if (session.emulated is None) != (asked.emulated is None):
            problem = f"this session uses {'a real' if session.emulated is None else 'an emulated'} cell"
            remedy = "continue with the original options, or choose a different -o"
            raise UseError("--emulated", problem, remedy, code="session.invalid")
        if asked.entered:
            if session.correction is None or session.correction.way != "entries":
                problem = "this session does not have values to enter"
                raise UseError("--entered", problem, "remove it", code="controller.invalid")
            session = session.model_copy(update={"correction": session.correction.model_copy(update={"entered": True})})
        if kept is not None:
            which = f"from {kept.began}: aim {kept.aim}, {kept.minutes:g} minutes, for {kept.maker}"
            complete = f"this session is complete ({which}); to start a new session, choose a different --output"
            screen.say(complete if kept.report else f"Continuing the session {which}")
        place.write(session)
        made = nullcontext(make_cell(session)) if make_cell else _cell_of(session, place, asked, screen)
        with made as cell, closing(cell):
            return Conductor(rig, text, place, session, cell, screen, asked).run()


@dataclass
class Conductor:
    rig: Rig
    rig_text: str
    place: SessionDirectory
    session: Session
    cell: RealCell
    screen: Screen
    asked: SessionOptions
    stage: str = ""
    """Name of the stage that is set up."""
    driving: int | None = None
    """Number of the step being driven."""
    corrected: Mapping[str, SessionProgram] = field(default_factory=dict)
    """Corrected programs by the name of the program that each replaces."""
    inference: Inference | None = None
    """The running inference."""
    inferred: tuple[list[str], list[str]] = ([], [])
    """Runs of the running or last inference: those used, and those that judge."""
    diagnosis: Diagnosis | None = None

    def run(self) -> Session:
        self._adopt_runs()
        session = self.session
        if session.correction and session.correction.way == "programs" and session.answer and session.open_steps:
            model, _ = load(self.place.model_of(session.answer))
            self.corrected = corrected_programs(self.rig, model, session.stages, self._verify_steps())
        if not any(step.tries for step in session.steps):
            for stage in session.stages:
                self._write_stage(stage, self._programs(stage))
        self.screen.answer(plan_blocks(session, self.asked.pace, self.place.directory))
        while (following := next_of(self.session)) != "done":
            match following:
                case Drive(number):
                    self._drive(number)
                case Infer(joins):
                    if self.inference is None:
                        self._infer(joins=joins)
                    self._await_answer()
                case "decide":
                    self._decide()
                case "correct":
                    self._correct()
                case "enter":
                    self._enter()
                case "report":
                    self._report()
        return self.session

    def _say(self, *lines: str) -> None:
        for line in lines:
            self.screen.say(line)

    def _keep(self, **changed: object) -> None:
        self.session = self.session.model_copy(update=changed)
        self.place.write(self.session)

    # Runs and programs.

    def _adopt_runs(self) -> None:
        """Assign runs that were recorded just before an interruption to open steps."""
        known = {attempt.run for step in self.session.steps for attempt in step.tries} | set(self.session.left_alone)
        for path in sorted(self.place.runs.glob("*")):
            if path.name in known or not is_run(path):
                continue
            if (number := self._step_of(path)) is not None:
                self._keep(steps=self.session.with_try(number, Try(run=path.name)).steps)
            else:
                self._keep(left_alone=(*self.session.left_alone, path.name))
                self._say(f"  {path.name} does not belong to a step of this session, or was interrupted: ignored")

    def _step_of(self, path: Path) -> int | None:
        """Open step of a run; None for a run that is incomplete, unusable, of another rig, or a copy."""
        following = next_of(self.session)
        try:
            manifest = load_manifest(path)
        except RigError:
            return None
        is_usable = manifest.exit_status == "complete" and manifest.rig_name == self.rig.name and not why_unusable(path)
        if not is_usable or not isinstance(following, Drive):
            return None
        readings = read_run(path).readings_sha256
        if any(read_run(run).readings_sha256 == readings for run in self.place.runs_of(self.session.steps)):
            return None
        return first_open(self.session, self.session.steps[following.number].purpose, manifest.name)

    def _programs(self, stage: Stage) -> dict[str, SessionProgram]:
        nominal = (step for step in self.session.steps if not step.program.endswith(FIXED))
        programs = programs_of_steps(self.rig, [stage], [step for step in nominal if step.stage == stage.name])
        return programs | {new.name: new for new in self.corrected.values() if new.stage == stage.name}

    def _write_stage(self, stage: Stage, programs: Mapping[str, SessionProgram]) -> None:
        directory = self.place.directory
        write_programs(self.session.maker, list(programs.values()), directory / "programs" / stage.name)
        files = {**self.rig.companion_files, f"{stage.name}.yaml": stage_text(self.rig_text, stage).encode()}
        write_all_over(directory / "cells", {name: holding(content) for name, content in files.items()})

    # A step.

    def _drive(self, number: int) -> None:
        step = self.session.steps[number]
        stage = self.session.stage_of(step)
        self.driving = number
        if stage.name != self.stage:
            self.stage = stage.name
            self._say(f"-- set up {stage.name}: {stage.words}")
            programs = self._programs(stage)
            self._write_stage(stage, programs)
            self.cell.set_up(stage, programs)
        self._say(*step_lines(self.session, number))
        began_s = clock.now_s()
        run = self.cell.drive(step, self._look)
        minutes = round(self.session.driven_minutes + (clock.now_s() - began_s) / 60, 2)
        self.session, self.driving = self.session.model_copy(update={"driven_minutes": minutes}), None
        is_asked = run.program == step.program
        self._store_run(run, number if is_asked else first_open(self.session, step.purpose, run.program))

    def _store_run(self, run: ProgramRun, number: int | None) -> None:
        self._say(f"  {run.name}: {f'not usable: {run.why}; repeat the run' if run.why else 'usable'}")
        if number is None:
            self._keep(left_alone=(*self.session.left_alone, run.name))
            return
        attempt = Try(run=run.name, why=run.why, held_up=run.held_up)
        self._keep(steps=self.session.with_try(number, attempt).steps)
        step = self.session.steps[number]
        if run.why and len(step.tries) % MOST_TRIES == 0:
            raise _failed(step, is_emulated=self.session.emulated is not None)
        if not run.why and self.inference is None and shows_more(self.session):
            self._infer(joins=False)

    def _look(self) -> None:
        if self.inference is None or not self.inference.is_done:
            return
        try:
            answer = self._finished()
        except RigError as error:
            self._say(f"  no diagnosis yet: {error.what}")
        else:
            self._store_answer(answer)

    # Diagnosis.

    def _infer(self, *, joins: bool) -> None:
        """joins: also use the runs of the other place, after their judgement."""
        find, judge = ([step.run for step in self.session.runs_for(kind) if step.run] for kind in ("find", "judge"))
        self.inferred, self.diagnosis = ([*find, *judge], []) if joins else (find, judge), None
        folder = self.place.directory / "found"
        number = 1 + max((int(path.name) for path in folder.glob("[0-9]*") if path.name.isdigit()), default=0)
        model = self.place.directory / "cells" / f"{self.session.stages[0].name}.yaml"
        used, judges = ([self.place.run(name) for name in names] for names in self.inferred)
        self.inference = self.cell.infer(used, judges, model, folder / f"{number:02d}")

    def _await_answer(self) -> None:
        began_s, runs = clock.now_s(), counted(len(self.session.runs_for("find")), "run")
        while self.inference and not self.inference.is_done:
            self.screen.show(f"diagnosing {runs}: {clock.now_s() - began_s:.0f} s")
            clock.sleep(_POLL_S)
        self._store_answer(self._finished())

    def _finished(self) -> Answer:
        inference, self.inference = _of(self.inference), None
        answer, self.diagnosis = inference.result()
        return answer

    def _store_answer(self, answer: Answer) -> None:
        """Store an answer. If it answers the question, the remaining steps for finding errors are skipped."""
        session, judges = self.session, len(self.session.runs_for("judge"))
        if judges and answer.runs > len(session.runs_for("find")):
            answer = answer.model_copy(update={"joined": judges})
        is_known = is_answered(session, answer)
        # A later answer may be less certain. Steps are reopened as long as the ball is still in the same place.
        is_there = not judges and self.stage in ("", session.stages[0].name)
        steps = session.steps
        if session.aim == "faults" and not session.answered and (is_known or is_there):
            steps = self._skipped("find", _ANSWERED if is_known else "")
        self._keep(answer=answer, judged=answer if answer.judges else session.judged, steps=steps)
        if session.answer is None or (answer.runs, answer.headline) != (session.answer.runs, session.answer.headline):
            self.screen.answer(diagnosis_blocks(answer))
        if count := abs(len(session.open_steps) - len(self.session.open_steps)):
            programs = counted(count, "further program is", "further programs are")
            self._say(f"  {_ANSWERED}: {programs} skipped" if is_known else f"  {_OPEN}: {programs} required after all")

    def _skipped(self, purpose: Purpose, why: str) -> tuple[ProgramStep, ...]:
        """Skip the undriven steps of a purpose; an empty `why` reopens them."""
        return tuple(
            step.model_copy(update={"skipped": why})
            if step.purpose == purpose and step.run is None and number != self.driving
            else step
            for number, step in enumerate(self.session.steps)
        )

    def _decide(self) -> None:
        """Insert a test that separates rivals or helps to decide, or close the search for errors."""
        session, answer = self.session, _of(self.session.answer)
        addition = further_stage(session, answer, self.rig, self.asked.pace) if session.aim != "check" else None
        if addition is None:
            self._keep(answered=answer.condition, decided=answer.runs if session.is_last(answer) else 0)
            return
        stage, steps = addition
        is_there = stage.name in [present.name for present in session.stages]
        stages = session.stages if is_there else (*session.stages, stage)
        self._keep(stages=stages, steps=numbered(insert_find_steps(session.steps, steps), session.steps))
        self.stage = ""
        measure = next((act.words for act in answer.acts if act.kind == "measure"), answer.next_step)
        self._say(f"  further measurement: {measure}", f"  next stage: {stage.name}")

    # Correction and the end.

    def _verify_steps(self) -> list[ProgramStep]:
        """Verification steps with the names of the nominal programs."""
        return [
            step.model_copy(update={"program": step.program.removesuffix(FIXED)})
            for step in self.session.steps
            if step.purpose == "verify"
        ]

    def _correct(self) -> None:
        answer, way = _of(self.session.answer), self.asked.correct
        why = why_nothing(self.session) if way in (None, "none") else ""
        if not answer.model:
            why = f"A correction is impossible: {answer.next_step}"
        nothing = SessionCorrection(way="none", sentence=why, before_um=0.0, expected_um=0.0)
        correction = nothing if why else self._make_correction(answer)
        steps = self.session.steps
        if correction.way == "none":
            steps = self._skipped("verify", "the robot was not corrected")
        elif self.corrected:
            steps = tuple(
                step.model_copy(update={"program": f"{step.program}{FIXED}"}) if step.purpose == "verify" else step
                for step in steps
            )
        self._keep(correction=correction, steps=steps)
        # Entered values take effect in the current stage. Corrected programs must be loaded first.
        self.stage = self.stage if correction.way == "entries" else ""
        self._say(f"correction: {correction.sentence}")

    def _make_correction(self, answer: Answer) -> SessionCorrection:
        self.screen.show("making the correction")
        session, place = self.session, self.place
        finding = [step for step in session.runs_for("find") if step.stage == session.stages[0].name]
        runs = place.runs_of(finding), place.runs_of(session.runs_for("judge"))
        model, directory = place.model_of(answer), place.directory / CORRECTIONS
        correction, self.corrected = corrected(
            self.rig, session, model, runs, self._verify_steps(), directory, self.asked.correct
        )
        for stage in session.stages:
            new = [program for program in self.corrected.values() if program.stage == stage.name]
            write_programs(session.maker, new, place.directory / "programs" / stage.name)
        return correction

    def _enter(self) -> None:
        file, session = entries_file(self.place.directory / CORRECTIONS), self.session
        self._say(f"enter the values of {file}, as described in that file")
        if not self.cell.enter(file):
            problem = "the operator has not confirmed that the values are entered"
            remedy = f"enter the values, then run: {self.place.command(session.rig_file, session)} --entered"
            raise CellError(str(file), problem, remedy, code="answer.missing")
        self._keep(correction=_of(session.correction).model_copy(update={"entered": True}))

    def _report(self) -> None:
        from analysis.apps.session import session_report as report  # noqa: PLC0415 - slow to import

        self.screen.show("writing the report")
        session = self.session
        verified = None if session.aim == "check" else report.verified_by(session, self.place)
        session = session.model_copy(update={"verified": verified})
        joined = session.runs_for("judge") if session.answer and session.answer.joined else []
        diagnosed = [step.run for step in (*session.runs_for("find"), *joined) if step.run]
        kept = self.diagnosis if self.inferred == (diagnosed, []) else None
        page = report.write_report(session, self.rig, self.place, kept)
        self._keep(verified=verified, report=page.name)


def _of(value: _T | None) -> _T:
    assert value is not None  # noqa: S101 - by the step that comes next
    return value


def _failed(step: ProgramStep, *, is_emulated: bool) -> CellError:
    """Error after repeated failures of a step."""
    last = step.tries[-1].why
    if is_emulated or any(attempt.held_up for attempt in step.tries[-MOST_TRIES:]):
        vain = f"after {MOST_TRIES} failed attempts at {step.program}, last error: {last}"
        problem = f"was delayed, so that readings are missing ({vain})"
        remedy = "close other programs, or use a faster computer; then repeat the command here"
        return CellError("this computer", problem, remedy, code="computer.unsuitable")
    problem = f"failed {MOST_TRIES} times, last error: {last}"
    return CellError(
        step.program, problem, "check the cell (rig doctor); then repeat the command here", code="robot.refused"
    )


@contextmanager
def _cell_of(session: Session, place: SessionDirectory, asked: SessionOptions, screen: Screen) -> Iterator[RealCell]:
    if asked.emulated is None:
        yield RealCell(session, place.directory, screen, asked)
    elif not asked.emulated.fast:
        yield ServedCell(session, place.directory, screen, asked)
    else:
        from analysis.apps.session.simulated import CellInSimulatedTime, simulated_time  # noqa: PLC0415 - the daemon

        with simulated_time(_of(session.emulated).seed) as simulated:
            yield CellInSimulatedTime(session, place.directory, screen, asked, simulated=simulated)


def offer_lines(rig_name: str, directories: Sequence[Path]) -> Iterator[str]:
    """The offer to find first what moved, if a reference of the cell exists."""
    references = references_of(dict.fromkeys(directories), rig_name)
    if not references:
        return
    reference = references[0]
    counted_readings = counted(reference.count, "reading" if facts_of(reference.test).of_places else "circle")
    runs = " ".join(as_argument(run) for run in reference.runs)
    yield f"a reference of this cell exists: {counted_readings} of {reference.day}; to ask first what moved since then:"
    yield f"  rig moved {runs} {'--live' if reference.can_be_touched else '--new NEW'}"


def _begun(rig: Rig, text: str, asked: SessionOptions, screen: Screen) -> Session:
    screen.show("planning")
    stages, steps = planned(rig, asked.aim, asked.minutes, asked.pace, screen.show)
    began = clock.wall_time().isoformat(timespec="seconds")
    return Session(
        rig=rig.name, rig_file=asked.rig_file, rig_sha256=digest_of(text), aim=asked.aim, maker=asked.maker,
        minutes=asked.minutes, began=began, emulated=asked.emulated, stages=stages, steps=steps,
    )  # fmt: skip

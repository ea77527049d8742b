"""Execution of the command `rig session`: starts or resumes a session and carries out the decisions of the guide.

All slow or fallible work is here. The decisions are in `analysis.apps.session.guide`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.apps.commission.cell_reference import references_of
from analysis.apps.session import guide
from analysis.apps.session.answer import Inference, Infers, StartInference
from analysis.apps.session.correction_step import CORRECTIONS, corrected, corrected_programs, entries_file
from analysis.apps.session.daemon_cell import Driver, EmulatedHands, Hands, LiveDriver, Person, Rigd, Screen, StartRigd
from analysis.apps.session.next_step import Drive
from analysis.apps.session.session_plan import (
    BY_HAND,
    BY_ITSELF,
    FIXED,
    SessionPace,
    SessionProgram,
    planned,
    programs_of_steps,
    stage_text,
    write_programs,
)
from analysis.apps.session.session_state import (
    Aim,
    Answer,
    Emulated,
    ProgramStep,
    Session,
    SessionDirectory,
    Stage,
    Way,
    digest_of,
)
from analysis.procedures.facts import facts_of
from analysis.procedures.results import why_unusable
from analysis.runs.written_files import holding, write_all_over
from daq import clock
from daq.store import load_manifest, read_run
from daq.store.manifest import is_run
from rigs.errors import CellError, FileError, RigError, UseError
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.vocabulary import MakerName
from rigs.text import as_argument, counted

if TYPE_CHECKING:
    from analysis.diagnosis.judge.result import Diagnosis


@dataclass(frozen=True)
class SessionOptions:
    """Options of a session.

    wait_min: minutes to wait for the robot to start. correct: way chosen by the user. entered: whether the values of
    the correction are entered. fast: whether an emulated cell runs in simulated time.
    """

    rig_file: str
    aim: Aim
    minutes: float
    maker: MakerName
    emulated: Emulated | None
    operator: str
    wait_min: float
    correct: Way | None = None
    entered: bool = False
    fast: bool = False

    @property
    def pace(self) -> SessionPace:
        """Time needed in addition to the motion; in simulated time the same as for an operator."""
        return BY_ITSELF if self.emulated and not self.fast else BY_HAND


@dataclass(frozen=True)
class SessionDependencies:
    """Dependencies of a session."""

    hands: Hands
    start_rigd: StartRigd = Rigd.start
    start_inference: StartInference = Inference.start


def run_session(
    rig: Rig,
    text: str,
    place: SessionDirectory,
    asked: SessionOptions,
    screen: Screen,
    means: SessionDependencies | None = None,
) -> Session:
    """Start a session, or resume the stored session, and run it to the end.

    Raises RigError. Progress is stored, so the same call resumes the session.
    """
    with place:
        kept = place.read()
        if kept is None:
            for line in offer_lines(rig.name, [place.runs, Path("runs")]):
                screen.say(line)
        session = kept or _begun(rig, text, asked, screen)
        _require_same_session(session, text, asked, place)
        if asked.entered:
            if session.correction is None or session.correction.way != "entries":
                raise UseError("--entered", "this session does not have values to enter", "remove it")
            session = session.model_copy(update={"correction": session.correction.model_copy(update={"entered": True})})
        if kept is not None:
            which_session = f"from {kept.began}: aim {kept.aim}, {kept.minutes:g} minutes, for {kept.maker}"
            if kept.report:
                screen.say(
                    f"this session is complete ({which_session}); to start a new session, choose a different --output"
                )
            else:
                screen.say(f"Continuing the session {which_session}")
        place.write(session)
        with _session_dependencies(session, place, asked, screen) if means is None else nullcontext(means) as equipment:
            driver = LiveDriver(
                rig.name, place.directory, equipment.hands, screen, asked.operator, asked.wait_min, equipment.start_rigd
            )
            driver.entered = bool(_entered_files(session, place))
            try:
                guided = guide.Guide(rig, asked.pace, place.directory, asked.correct)
                state = guide.GuideState(session)
                return Conductor(place, state, driver, screen, guided, text, equipment.start_inference).run()
            finally:
                driver.close()


@dataclass
class Conductor:
    """Executes the decisions of the guide step by step until the session ends.

    rig_text: text of the rig file. corrected: corrected programs, by the name of the program that each replaces.
    latest: the last finished inference by its runs, with the diagnosis if that was kept.
    """

    place: SessionDirectory
    state: guide.GuideState
    driver: Driver
    screen: Screen
    guided: guide.Guide
    rig_text: str
    start_inference: StartInference = Inference.start
    inferences: dict[guide.Runs, Infers] = field(default_factory=dict)
    corrected: Mapping[str, SessionProgram] = field(default_factory=dict)
    latest: tuple[guide.Runs, Diagnosis | None] | None = None

    def run(self) -> Session:
        """Run to the end of the session. Raises RigError; the progress is stored."""
        session = self.state.session
        present = {attempt.run for step in session.steps for attempt in step.tries} | set(session.left_alone)
        for path in sorted(self.place.runs.glob("*")):
            if path.name not in present and is_run(path):
                self._take(guide.Present(path.name, self._program_of(path)))
        if session.correction and session.correction.way == "programs" and session.answer and session.open_steps:
            model, _ = load(self.place.model_of(session.answer))
            self.corrected = corrected_programs(self.guided.rig, model, session.stages, self._verify_steps())
        if not any(step.tries for step in self.state.session.steps):
            for stage in session.stages:
                self._write(stage, self._programs(stage))
        event: guide.Event | None = "begun"
        while event is not None:
            event = self._take(event)
        return self.state.session

    def _take(self, event: guide.Event) -> guide.Event | None:
        """Process an event, store the session and execute the actions. Return the event produced by the last action."""
        before = self.state.session
        self.state, actions = self.guided.step(self.state, event)
        if self.state.session != before:
            self.place.write(self.state.session)
        came = None
        for action in actions:
            came = self._carry_out(action)
        return came

    def _carry_out(self, action: guide.Action) -> guide.Event | None:
        match action:
            case guide.Say(lines):
                for line in lines:
                    self.screen.say(line)
            case guide.SetUpStage(stage):
                programs = self._programs(stage)
                self._write(stage, programs)
                self.driver.set_up(stage, programs)
            case Drive(number):
                began_s = clock.now_s()
                run = self.driver.drive(self.state.session.steps[number], self._look)
                return guide.Recorded(run, (clock.now_s() - began_s) / 60)
            case guide.Begin(runs):
                self.inferences[runs] = self._begun(runs)
            case "await":
                return self._awaited()
            case "correct":
                return self._correct()
            case "enter":
                return self._enter()
            case "report":
                return self._report()
            case guide.EndSession(error):
                raise error
        return None

    def _look(self) -> None:
        """Process an answer that arrives while a step is driven."""
        runs = self.state.inferring
        if runs is not None and self.inferences[runs].is_done:
            try:
                event = guide.Answered(self._finished(runs))
            except RigError as error:
                event = guide.Answered(None, error.what)
            self._take(event)

    # ------------------------------------------------------------------------------------------------------------------
    # Files in the directory.

    def _program_of(self, path: Path) -> str:
        """Return the program of a run that may belong to an open step.

        Return an empty string if the run is incomplete, unusable, of another rig, or a copy of a known run.
        """
        try:
            manifest = load_manifest(path)
        except RigError:
            return ""
        if manifest.exit_status != "complete" or manifest.rig_name != self.guided.rig.name or why_unusable(path):
            return ""
        # A copied run contains the readings of another run.
        readings = read_run(path).readings_sha256
        driven = self.place.runs_of(self.state.session.steps)
        return "" if any(read_run(run).readings_sha256 == readings for run in driven if is_run(run)) else manifest.name

    def _programs(self, stage: Stage) -> dict[str, SessionProgram]:
        """Return all programs available at a stage."""
        nominal = (step for step in self.state.session.steps if not step.program.endswith(FIXED))
        programs = programs_of_steps(self.guided.rig, [stage], [step for step in nominal if step.stage == stage.name])
        return programs | {new.name: new for new in self.corrected.values() if new.stage == stage.name}

    def _write(self, stage: Stage, programs: Mapping[str, SessionProgram]) -> None:
        """Write the rig file and the programs of a stage. Existing files are overwritten with the same content."""
        directory = self.place.directory
        write_programs(self.state.session.maker, list(programs.values()), directory / "programs" / stage.name)
        files = {**self.guided.rig.companion_files, f"{stage.name}.yaml": stage_text(self.rig_text, stage).encode()}
        write_all_over(directory / "cells", {name: holding(content) for name, content in files.items()})

    # ------------------------------------------------------------------------------------------------------------------
    # Diagnosis, correction and the end.

    def _begun(self, runs: guide.Runs) -> Infers:
        folder = self.place.directory / "found"
        number = 1 + max((int(path.name) for path in folder.glob("[0-9]*") if path.name.isdigit()), default=0)
        while (folder / f"{number:02d}.json").exists():
            number += 1
        model = self.place.directory / "cells" / f"{self.state.session.stages[0].name}.yaml"
        used, judges = ([self.place.run(name) for name in names] for names in (runs.used, runs.judges))
        return self.start_inference(used, judges, model, folder / f"{number:02d}")

    def _awaited(self) -> guide.Answered:
        assert self.state.inferring is not None  # noqa: S101 - it is waited for
        runs, began_s = self.state.inferring, clock.now_s()
        count = len(self.state.session.runs_for("find"))
        while not self.inferences[runs].is_done:
            self.screen.show(f"diagnosing {counted(count, 'run')}: {clock.now_s() - began_s:.0f} s")
            clock.sleep(_POLL_S)
        return guide.Answered(self._finished(runs))

    def _finished(self, runs: guide.Runs) -> Answer:
        """Return the answer of a finished inference and keep its diagnosis. Raises RigError."""
        inference = self.inferences.pop(runs)
        answer = inference.result()
        self.latest = runs, inference.diagnosis()
        return answer

    def _verify_steps(self) -> list[ProgramStep]:
        """Return the steps after the correction with the nominal programs from which they are derived."""
        return [
            step.model_copy(update={"program": step.program.removesuffix(FIXED)})
            for step in self.state.session.steps
            if step.purpose == "verify"
        ]

    def _correct(self) -> guide.CorrectionMade:
        self.screen.show("making the correction")
        session, place = self.state.session, self.place
        assert session.answer is not None  # noqa: S101 - it is corrected by it
        main = session.stages[0].name
        finding = [step for step in session.runs_for("find") if step.stage == main]
        runs = place.runs_of(finding), place.runs_of(session.runs_for("judge"))
        model, directory = place.model_of(session.answer), place.directory / CORRECTIONS
        verify = self._verify_steps()
        correction, programs = corrected(
            self.guided.rig, session, model, runs, verify, directory, self.guided.chosen_way
        )
        self.corrected = programs
        for stage in session.stages:
            new = [program for program in programs.values() if program.stage == stage.name]
            write_programs(session.maker, new, place.directory / "programs" / stage.name)
        return guide.CorrectionMade(correction, {name: program.name for name, program in programs.items()})

    def _enter(self) -> guide.Event:
        """Have the values entered. Raises CellError if the operator does not confirm it."""
        file = entries_file(self.place.directory / CORRECTIONS)
        self.screen.say(f"enter the values of {file}, as described in that file")
        if not self.driver.enter(file):
            kept = self.state.session
            remedy = f"enter the values, then run: {self.place.command(kept.rig_file, kept)} --entered"
            raise CellError(str(file), "the operator has not confirmed that the values are entered", remedy)
        return "entered"

    def _report(self) -> guide.Reported:
        from analysis.apps.session import session_report as report  # noqa: PLC0415 - slow to import

        self.screen.show("writing the report")
        session = self.state.session
        verified = None if session.aim == "check" else report.verified_by(session, self.place)
        session = session.model_copy(update={"verified": verified})
        kept = self.latest[1] if self.latest and self.latest[0] == guide.Runs(session.diagnosed_runs) else None
        page = report.write_report(session, self.guided.rig, self.place, kept)
        return guide.Reported(verified, page.name)


_POLL_S = 0.2


@contextmanager
def _session_dependencies(
    session: Session, place: SessionDirectory, asked: SessionOptions, screen: Screen
) -> Iterator[SessionDependencies]:
    """Provide the dependencies of a session, in simulated time if requested."""
    files, emulated = _entered_files(session, place), session.emulated
    if emulated is None:
        yield SessionDependencies(Person(screen, _confirmed))
        return
    if not asked.fast:
        yield SessionDependencies(EmulatedHands(place.directory, session.maker, emulated, files))
        return
    from analysis.apps.session.simulated import (  # noqa: PLC0415 - imports the daemon
        SimulatedCells,
        SimulatedInference,
        simulated_time,
    )

    with simulated_time(emulated.seed) as simulated:
        cells = SimulatedCells(simulated, place.directory)
        hands = EmulatedHands(place.directory, session.maker, emulated, files, cells.start_cell)
        yield SessionDependencies(hands, cells.start_rigd, SimulatedInference.start)


def offer_lines(rig_name: str, directories: Sequence[Path]) -> Iterator[str]:
    """Yield the offer to find first what moved, if a reference of the cell exists."""
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
    return Session(
        rig=rig.name,
        rig_file=asked.rig_file,
        rig_sha256=digest_of(text),
        aim=asked.aim,
        maker=asked.maker,
        minutes=asked.minutes,
        began=clock.wall_time().isoformat(timespec="seconds"),
        emulated=asked.emulated,
        stages=stages,
        steps=steps,
    )


def _require_same_session(session: Session, text: str, asked: SessionOptions, place: SessionDirectory) -> None:
    """Raise an error if the stored session belongs to a different cell or was started with other options."""
    if session.rig_sha256 != digest_of(text):
        problem = f"is a session with the rig file {session.rig_file}, which has changed or is a different file"
        raise FileError(str(place.file), problem, "restore that file, or start a new session with a different --output")
    if (session.emulated is None) != (asked.emulated is None):
        kind = "a real" if session.emulated is None else "an emulated"
        raise UseError(
            "--emulated",
            f"this session uses {kind} cell",
            "continue with the original options, or choose a different -o",
        )


def _entered_files(session: Session, place: SessionDirectory) -> list[Path]:
    """Return the files with values that are entered at the controller."""
    correction = session.correction
    return [entries_file(place.directory / CORRECTIONS)] if correction and correction.entered else []


def _confirmed(statement: str) -> bool:
    """Request a confirmation at the terminal; return False if standard input is not a terminal."""
    if not (sys.stdin is not None and sys.stdin.isatty() and sys.stdout.isatty()):
        return False
    try:
        return input(f"{statement}? [y] ").strip().lower() in ("", "y", "yes")
    except EOFError:
        return False

"""The guide: which step comes next, and what is done in it. The state alone decides; after each step it is kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from analysis.files.write import holding, write_all_over
from analysis.measures.usable import why_unusable
from analysis.session.answer import Driven, Inference, path_error
from analysis.session.cell import Driver, Screen
from analysis.session.correct import CORRECTIONS, corrected, corrected_programs, entries_file, reading_deg
from analysis.session.next_step import (
    Correct,
    Decide,
    Done,
    Drive,
    Enter,
    Infer,
    Report,
    first_open,
    is_answered,
    next_of,
    why_nothing,
)
from analysis.session.plan import (
    ELSEWHERE,
    FIXED,
    Pace,
    Program,
    minutes_of,
    numbered,
    programs_of_steps,
    separating,
    stage_text,
    write_programs,
)
from analysis.session.state import (
    MOST_TRIES,
    Answer,
    Correction,
    Place,
    Purpose,
    Session,
    Stage,
    Step,
    Try,
    Verified,
    Way,
)
from analysis.session.words import Words
from daq import clock
from daq.store import load_manifest, read_run
from daq.store.manifest import is_run
from rigs.errors import CellError, RigError
from rigs.load import load

_MOST_MORE = 4
"""So many stages are added at most to separate rivals or to decide: then a person has to think."""


class Infers(Protocol):
    """An inference under way."""

    @property
    def is_done(self) -> bool:
        """Whether it has ended."""

    def result(self) -> Answer:
        """Return its answer. Raises RigError."""


StartInference = Callable[[Sequence[Path], Sequence[Path], Path, Path], Infers]


class Guide:
    """Takes a session from one step to the next, until nothing is left."""

    def __init__(
        self,
        place: Place,
        session: Session,
        driver: Driver,
        screen: Screen,
        pace: Pace,
        *,
        chosen_way: Way | None = None,
        start_inference: StartInference = Inference.start,
    ) -> None:
        """chosen_way: the way of the correction that a person chose."""
        self._place, self.session, self._driver, self._screen, self._pace = place, session, driver, screen, pace
        self._chosen_way, self._start_inference = chosen_way, start_inference
        self._rig, self._text = load(session.rig_file)
        self._words = Words(place.directory, screen)
        self._inference: Infers | None = None
        self._ahead: Infers | None = None
        """The last diagnosis, begun beside the one that the other place judges."""
        self._stage, self._driving = "", -1
        self._known: dict[str, dict[str, Program]] = {}
        """The programs of each stage, until the steps change."""
        self._corrected: Mapping[str, Program] | None = None

    def run(self) -> Session:
        """Go on to the end. Raises RigError; what was reached is kept."""
        self._adopt()
        if not any(step.tries for step in self.session.steps):
            self._write_programs(self.session.stages)
        self._words.plan(self.session, self._pace)
        while True:
            match next_of(self.session):
                case Drive(number):
                    self._drive(number)
                case Infer() as asked:
                    self._await_inference(asked)
                case Decide():
                    self._decide()
                case Correct():
                    self._correct()
                case Enter():
                    self._enter()
                case Report():
                    self._report()
                case Done():
                    self._words.end(self.session)
                    return self.session

    def _keep(self, **changed: object) -> None:
        self.session = self.session.model_copy(update=changed)
        self._place.write(self.session)

    # ------------------------------------------------------------------------------------------------------------------
    # What was there before.

    def _adopt(self) -> None:
        """Take runs that were recorded for open steps just before the session was cut off; leave all others alone."""
        run_names = {attempt.run for step in self.session.steps for attempt in step.tries} | set(
            self.session.left_alone
        )
        directories = (
            sorted(path for path in self._place.runs.glob("*") if path.is_dir()) if self._place.runs.is_dir() else []
        )
        for path in directories:
            if path.name in run_names or not is_run(path):
                continue
            number = self._step_of(path)
            if number is None:
                self._words.left_alone(path)
                self._keep(left_alone=(*self.session.left_alone, path.name))
            else:
                self._keep_try(number, Try(run=path.name))

    def _step_of(self, path: Path) -> int | None:
        """Return the number of the open step that a whole and usable run is of."""
        try:
            manifest = load_manifest(path)
        except RigError:
            return None
        if manifest.exit_status != "complete" or manifest.rig_name != self._rig.name:
            return None
        following = next_of(self.session)
        if not isinstance(following, Drive):
            return None
        number = self._number_of(manifest.name, self.session.steps[following.number].purpose)
        if number is None or why_unusable(path):
            return None
        # Somebody may have copied a run: it holds the readings of one that a step has.
        driven = [self._run(step) for step in self.session.steps if step.run]
        readings = read_run(path).readings_sha256
        is_copy = any(read_run(run).readings_sha256 == readings for run in driven if is_run(run))
        return None if is_copy else number

    def _number_of(self, program: str, purpose: Purpose) -> int | None:
        """Return the number of the first open step of a program with a purpose."""
        steps = enumerate(self.session.steps)
        return next(
            (k for k, step in steps if step.program == program and step.purpose == purpose and step.is_open), None
        )

    def _write_programs(self, stages: Sequence[Stage]) -> None:
        """Write the rig files and programs of stages; those that are there are the same."""
        for stage in stages:
            programs = list(self._programs(stage).values())
            write_programs(self.session.maker, programs, self._place.directory / "programs" / stage.name)
            files = {**self._rig.beside, f"{stage.name}.yaml": stage_text(self._text, stage).encode()}
            cells = self._place.directory / "cells"
            write_all_over(cells, {name: holding(content) for name, content in files.items()})

    def _programs(self, stage: Stage) -> dict[str, Program]:
        """The programs that may be driven at a stage now."""
        if stage.name not in self._known:
            nominal = (step for step in self.session.steps if not step.program.endswith(FIXED))
            steps = [step for step in nominal if step.stage == stage.name]
            programs = programs_of_steps(self._rig, [stage], steps)
            correction = self.session.correction
            if self._corrected is None and correction:
                self._corrected = {}
                if correction.way == "programs":
                    model, verify = load(self._model_file())[0], self._verify_steps()
                    self._corrected = corrected_programs(self._rig, model, self.session.stages, verify)
            corrected = (self._corrected or {}).values() if correction else ()
            self._known[stage.name] = programs | {
                program.name: program for program in corrected if program.stage == stage.name
            }
        return self._known[stage.name]

    # ------------------------------------------------------------------------------------------------------------------
    # Driving.

    def _drive(self, number: int) -> None:
        step = self.session.steps[number]
        stage = self.session.stage_of(step)
        if stage.name != self._stage:
            self._words.stage(stage)
            self._write_programs([stage])
            self._driver.set_up(stage, self._programs(stage))
            self._stage = stage.name
        self._words.step(self.session, number)
        began_s = clock.now_s()
        self._driving = number
        try:
            run = self._driver.drive(step, self._look)
        finally:
            self._driving = -1
        minutes = round(self.session.driven_minutes + (clock.now_s() - began_s) / 60, 2)
        self.session = self.session.model_copy(update={"driven_minutes": minutes})
        self._words.run(run)
        of = number if run.program == step.program else self._number_of(run.program, step.purpose)
        if of is None:
            self._keep(left_alone=(*self.session.left_alone, run.name))
            return
        self._keep_try(of, Try(run=run.name, why=run.why, held_up=run.held_up))
        if run.why:
            self._hold_tries(of)
        else:
            self._infer_meanwhile()

    def _keep_try(self, number: int, attempt: Try) -> None:
        step = self.session.steps[number]
        self._keep(
            steps=self.session.with_step(number, step.model_copy(update={"tries": (*step.tries, attempt)})).steps
        )

    def _hold_tries(self, number: int) -> None:
        """Raise CellError where a step was driven in vain so often that something in the cell must be put right."""
        step = self.session.steps[number]
        if len(step.tries) % MOST_TRIES == 0:
            vain = f"after {MOST_TRIES} failed attempts at {step.program}"
            if any(attempt.held_up for attempt in step.tries[-MOST_TRIES:]) or self.session.emulated:
                problem = f"was held up, so that readings are missing ({vain}, the last time: {step.tries[-1].why})"
                remedy = "end what keeps it busy, or give rig another computer; the same command goes on here"
                raise CellError("this computer", problem, remedy)
            remedy = "look at the cell (rig doctor); the same command goes on here"
            raise CellError(step.program, f"failed {MOST_TRIES} times, the last time: {step.tries[-1].why}", remedy)

    # ------------------------------------------------------------------------------------------------------------------
    # Understanding.

    def _infer_meanwhile(self) -> None:
        """Start to understand what there is, unless that is under way, or too little."""
        find = self.session.runs_for("find")
        understood = self.session.answer.runs if self.session.answer else 0
        ways = {step.direction for step in find}
        judged = first_open(self.session, "judge") is None and first_open(self.session, "find") is None
        is_new = len(ways) > 1 and (len(find) > understood or judged)
        if is_new and self._inference is None and self.session.correction is None:
            self._inference = self._begun(Infer())

    def _begun(self, asked: Infer) -> Infers:
        """Begin to understand what there is; where the other place judges, with its runs among those used as well."""
        ahead, self._ahead = self._ahead, None
        if asked.joins and ahead is not None:
            return ahead
        find, judge = ([self._run(step) for step in self.session.runs_for(purpose)] for purpose in ("find", "judge"))
        if asked.joins:
            return self._started([*find, *judge], [])
        begun = self._started(find, judge)
        if judge and first_open(self.session, "judge") is None:  # both at once, since a computer has two cores
            self._ahead = self._started([*find, *judge], [])
        return begun

    def _started(self, used: Sequence[Path], judges: Sequence[Path]) -> Infers:
        folder = self._place.directory / "found"
        number = 1 + max((int(path.name) for path in folder.glob("[0-9]*") if path.name.isdigit()), default=0)
        while (folder / f"{number:02d}.json").exists():
            number += 1
        first = self.session.stages[0].name
        model = self._place.directory / "cells" / f"{first}.yaml"
        return self._start_inference(used, judges, model, folder / f"{number:02d}")

    def _run(self, step: Step) -> Path:
        assert step.run is not None  # noqa: S101 - of a step that was driven
        return self._place.run(step.run)

    def _look(self) -> None:
        """Take in an answer that has come meanwhile."""
        if self._inference is not None and self._inference.is_done:
            try:
                self._take_answer()
            except RigError as error:  # more runs follow, and with them another one
                self._screen.say(f"  not understood yet: {error.what}")

    def _await_inference(self, asked: Infer) -> None:
        """Wait for an answer about all runs."""
        if self._inference is None:
            self._inference = self._begun(asked)
        began_s = clock.now_s()
        while self._inference is not None and not self._inference.is_done:
            self._screen.show(
                f"understanding {len(self.session.runs_for('find'))} runs: {clock.now_s() - began_s:.0f} s"
            )
            clock.sleep(_LOOK_S)
        self._take_answer()

    def _take_answer(self) -> None:
        assert self._inference is not None  # noqa: S101 - one has come
        inference, self._inference = self._inference, None
        answer, before = inference.result(), self.session.answer
        judges = len(self.session.runs_for("judge"))
        if judges and answer.runs > len(self.session.runs_for("find")):
            answer = answer.model_copy(update={"joined": judges})
        self._keep(answer=answer, judged=answer if answer.judges else self.session.judged)
        self._words.answer(answer, before)
        if self.session.aim == "faults" and not self.session.answered and is_answered(self.session, answer):
            self._stop_early()

    def _stop_early(self) -> None:
        """Leave out what was still to be driven to find errors."""
        numbers = [
            k
            for k, step in enumerate(self.session.steps)
            if step.purpose == "find" and step.is_open and k != self._driving
        ]
        for number in numbers:
            step = self.session.steps[number]
            skipped = step.model_copy(update={"skipped": "the question is answered"})
            self.session = self.session.with_step(number, skipped)
        if numbers:
            self._keep()
            self._words.early(len(numbers))

    def _decide(self) -> None:
        """Put the test next that separates rivals or decides, or go on."""
        answer = self.session.answer
        assert answer is not None  # noqa: S101 - it decides
        addition = self._more(answer) if self.session.aim != "check" else None
        if addition is None:
            self._keep(answered=answer.condition, decided=answer.runs if self.session.is_last(answer) else 0)
            return
        stage, steps = addition
        names = [stage.name for stage in self.session.stages]
        stages = self.session.stages if stage.name in names else (*self.session.stages, stage)
        at = next((k for k, step in enumerate(self.session.steps) if step.purpose != "find"), len(self.session.steps))
        ordered = self._named((*self.session.steps[:at], *steps, *self.session.steps[at:]))
        self._words.more(answer, stage)
        self._keep(stages=stages, steps=ordered)
        self._known = {}
        self._write_programs([stage])
        self._stage = ""

    def _more(self, answer: Answer) -> tuple[Stage, tuple[Step, ...]] | None:
        """Return a stage with steps that would show more, None where none would, or the time is over."""
        if len(self.session.stages) >= 2 + _MOST_MORE:
            return None
        addition: tuple[Stage, tuple[Step, ...]] | None = None
        if answer.next_test and (answer.condition == "ambiguous" or self.session.is_last(answer)):
            tests = tuple(dict.fromkeys(step.test for step in self.session.runs_for("find")))
            addition = separating(self._rig, answer.next_test, tests, len(self.session.stages) + 1)
        elif answer.condition == "undecided" and answer.runs_to_decide is not None:
            # The same once more in each direction, where that may decide
            main = self.session.stages[0]
            main_steps = [step for step in self.session.steps if step.stage == main.name and step.purpose == "find"]
            once = list({step.program: step for step in main_steps}.values())
            if sum(bool(step.run) for step in main_steps) < len(once) * answer.runs_to_decide:
                addition = main, tuple(step.model_copy(update={"tries": (), "skipped": ""}) for step in once)
        # A test at the place that judges is driven anyway: its runs join the last diagnosis.
        judged_at = [stage.circle for stage in self.session.stages if stage.circle is not None]
        if addition is None or addition[0].circle in judged_at:
            return None
        open_steps = [step for step in self.session.steps if step.is_open]
        need = minutes_of((addition[0],), (*addition[1], *open_steps), self._pace)
        return addition if self.session.driven_minutes + need <= self.session.minutes else None

    def _named(self, steps: Sequence[Step]) -> tuple[Step, ...]:
        """Return steps of which those that are new have the next numbers; programs that were written keep theirs."""
        names = {step.program[4:]: step.program for step in self.session.steps}
        fresh = [step for step in numbered(steps) if step.program[4:] not in names]
        count = len(set(names.values()))
        for number, bare in enumerate(dict.fromkeys(step.program[4:] for step in fresh), start=count + 1):
            names[bare] = f"p{number:02d}-{bare}"
        return tuple(step.model_copy(update={"program": names[_bare(step.program)]}) for step in steps)

    # ------------------------------------------------------------------------------------------------------------------
    # Correcting, and the end.

    def _model_file(self) -> Path:
        """The rig file with what was found."""
        answer = self.session.answer
        assert answer is not None  # noqa: S101 - it is corrected by it
        return self._place.directory / "found" / answer.found / answer.model

    def _verify_steps(self) -> list[Step]:
        """The steps after the correction, with the nominal programs that they begin from."""
        return [
            step.model_copy(update={"program": step.program.removesuffix(FIXED)})
            for step in self.session.steps
            if step.purpose == "verify"
        ]

    def _correct(self) -> None:
        self._screen.show("making the correction")
        answer = self.session.answer
        assert answer is not None  # noqa: S101 - it is corrected by it
        if not answer.model:
            self._keep(correction=self._nothing(f"Nothing can be corrected: {answer.next_step}"))
        elif (why := why_nothing(self.session)) and self._chosen_way in (None, "none"):
            self._keep(correction=self._nothing(why))
        else:
            directory = self._place.directory / CORRECTIONS
            main = self.session.stages[0].name
            main_runs = [self._run(step) for step in self.session.runs_for("find") if step.stage == main]
            runs = main_runs, [self._run(step) for step in self.session.runs_for("judge")]
            made = corrected(
                self._rig, self.session, self._model_file(), runs, self._verify_steps(), directory, self._chosen_way
            )
            self._known = {}
            self._corrected = programs = made.programs
            for stage in self.session.stages:
                stage_programs = [program for program in programs.values() if program.stage == stage.name]
                write_programs(self.session.maker, stage_programs, self._place.directory / "programs" / stage.name)
            steps = self.session.steps
            if made.correction.way == "none":
                steps = self._without_verification("nothing was corrected")
            elif made.correction.way == "programs":
                steps = tuple(
                    step.model_copy(update={"program": programs[step.program].name})
                    if step.purpose == "verify"
                    else step
                    for step in steps
                )
            self._keep(correction=made.correction, steps=steps)
        assert self.session.correction is not None  # noqa: S101 - it was made
        self._stage = self._stage if self.session.correction.way == "entries" else ""
        self._words.correction(self.session.correction)

    def _nothing(self, sentence: str) -> Correction:
        self.session = self.session.model_copy(update={"steps": self._without_verification("nothing was corrected")})
        return Correction(way="none", sentence=sentence, before_um=0.0, expected_um=0.0)

    def _without_verification(self, why: str) -> tuple[Step, ...]:
        return tuple(
            step.model_copy(update={"skipped": why}) if step.purpose == "verify" and step.is_open else step
            for step in self.session.steps
        )

    def _enter(self) -> None:
        """Have the values entered. Raises CellError where no person confirms it."""
        correction = self.session.correction
        assert correction is not None  # noqa: S101 - it is entered
        file = entries_file(self._place.directory / CORRECTIONS)
        self._words.entries(file)
        if not self._driver.enter(file):
            remedy = f"enter them, then: rig session {self.session.rig_file} --entered"
            raise CellError(str(file), "no person has confirmed that its values are entered", remedy)
        self._keep(correction=correction.model_copy(update={"entered": True}))

    def _report(self) -> None:
        from analysis.session.report import write_report  # noqa: PLC0415 - slow to import

        self._screen.show("writing the report")
        answer = self.session.answer
        noise_um = answer.noise_um if answer else 0.0
        verified = self._verified(noise_um) if self.session.aim != "check" else None
        session = self.session.model_copy(update={"verified": verified})
        page = write_report(session, self._rig, self._place)
        self._keep(verified=verified, report=page.name)

    def _verified(self, noise_um: float) -> Verified:
        nominal = after = Driven()
        answer, correction = self.session.answer, self.session.correction
        if answer is not None and correction is not None and correction.way != "none":
            model, _ = load(self._model_file())
            entered = correction.way == "entries"
            after = Driven(model, reading_deg(self._place.directory / CORRECTIONS) if entered else (0.0,) * 6)
        verify = self.session.runs_for("verify")
        tests = {(step.stage, step.test, step.direction) for step in verify}
        main = [step for step in self.session.runs_for("find") if (step.stage, step.test, step.direction) in tests]
        sides = {
            "same_before": (main, nominal),
            "same_after": ([step for step in verify if step.stage != ELSEWHERE], after),
            "elsewhere_before": (self.session.runs_for("judge"), nominal),
            "elsewhere_after": ([step for step in verify if step.stage == ELSEWHERE], after),
        }
        return Verified(
            **{
                name: path_error([self._run(step) for step in steps], by, noise_um)
                for name, (steps, by) in sides.items()
            }
        )


_LOOK_S = 0.2


def _bare(program: str) -> str:
    return program[4:] if program[:1] == "p" and program[1:3].isdigit() else program

"""State of a session in a readable file, rewritten after each step. It alone determines the next step."""

from __future__ import annotations

import datetime as dt
import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import AfterValidator, Field, ValidationError, model_validator

from analysis.apps.report.summary_words import Summary, with_corrections_removed, with_driven_error, with_next
from analysis.apps.report.texts import texts_of
from analysis.correction.deviation import Count, Deviation, Expected, NotNegative, Side, Work
from analysis.diagnosis.judge.acts import ActiveCorrection, open_acts
from daq.store import durable
from rigs.errors import CellError, FileError
from rigs.files import of_newer_rig, read_text
from rigs.problems import RigFileError, problems_of
from rigs.schema.declared_tests import Circle
from rigs.schema.part import Part
from rigs.schema.vocabulary import CIRCLES, Direction, DrivenTest, MakerName
from rigs.text import as_argument
from rigs.yaml_text import read_yaml

STATE = "session.yaml"
_HEAD = """\
# A session of rig: programs, results and progress. To continue: `rig session RIG -o DIR`.
"""
_MOST_BYTES = 1_000_000
_MOST_MINUTES = 10_000.0
"""One week; a session takes at most a day."""
MOST_TRIES = 3

CORRECTIONS_FILE = "corrections.yaml"
"""File of `rig correct` in the directory of the corrections."""
MAIN: DrivenTest = CIRCLES[0]
"""Test for finding errors and for verifying the correction."""
ELSEWHERE = "other"
"""Name of the stage at the other place, which is not used to find errors."""
Aim = Literal["faults", "accuracy", "check"]
Purpose = Literal["find", "judge", "verify"]
"""Find errors; judge the model at the other place; or verify a correction."""
Way = Literal["entries", "programs", "none"]
"""Values entered at the controller, programs with corrected targets, or no correction."""


def _a_time(text: str) -> str:
    dt.datetime.fromisoformat(text)  # raises ValueError
    return text


class Stage(Part):
    name: Annotated[str, Field(pattern=r"^[a-z0-9-]{1,40}$")]
    words: str
    """Instructions for the operator."""
    circle: Circle | None = None


class Try(Part):
    """A run of a step. why: reason for being unusable. held_up: stalls of the computer during the run."""

    run: Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9._-]{0,200}$")]
    why: str = ""
    held_up: Count = 0


class ProgramStep(Part):
    """A program to drive; its last usable run counts. skipped: reason."""

    program: Annotated[str, Field(pattern=r"^[a-z0-9-]{1,60}$")]
    stage: str
    test: DrivenTest
    direction: Direction | None = None
    purpose: Purpose = "find"
    seconds: Annotated[float, Field(ge=0)]
    tries: tuple[Try, ...] = ()
    skipped: str = ""

    @property
    def run(self) -> str | None:
        return next((attempt.run for attempt in self.tries[::-1] if not attempt.why), None)

    @property
    def is_open(self) -> bool:
        return self.run is None and not self.skipped

    @property
    def title(self) -> str:
        return " ".join(filter(None, (self.test, self.direction)))


class PartOfError(Part):
    part: str
    kind: str = ""
    size: str = ""
    share: float
    um: float
    fault: bool = False


class SessionAct(Part):
    """An act (`analysis.diagnosis.judge.acts`). corrected: words for a corrected robot, if different."""

    kind: str
    why: str
    words: str
    corrected: str = ""
    step: str = ""
    """The imperative alone, as in the summary."""
    action: str = ""
    """The imperative in a few words."""
    command: str = ""
    remains_um: float | None = None
    with_before_um: float | None = None


class Answer(Part):
    """Result of an inference with its sentences.

    joined: runs used that had judged an earlier answer. runs_to_decide: runs of each kind needed. found: directory of
    the result files. noise_um: rms scatter of a run.
    """

    runs: Count
    judges: Count = 0
    joined: Count = 0
    condition: str
    standing: str | None
    headline: str
    accuracy: str
    next_step: str
    parts: tuple[PartOfError, ...]
    remedies: tuple[str, ...] = ()
    acts: tuple[SessionAct, ...] = ()
    """Empty in sessions of earlier versions."""
    next_test: str = ""
    """Test that would separate rivals or name a group."""
    ground: str = ""
    """Reason to correct or not (`rigs.calibration.Ground`)."""
    runs_to_decide: int | None = None
    now_um: NotNegative
    calibrated_um: NotNegative
    before_there_um: NotNegative = 0.0
    """Error without the model in the same place as calibrated_um."""
    level: float = 1.0
    """Size of the errors relative to typical arms of this kind; 1 is typical (`rig plan --level`)."""
    noise_um: NotNegative
    seconds: NotNegative
    found: str
    model: str = ""
    """Rig file with the diagnosed effects, if there is one."""
    summary: Summary | None = None
    """Headline and tiles; None in sessions of earlier versions."""


class SessionCorrection(Part):
    """Errors of the readings before the correction, and expected after it."""

    way: Way
    sentence: str
    before_um: NotNegative
    expected_um: NotNegative
    same: Expected | None = None
    elsewhere: Expected | None = None
    work: Work | None = None
    directory: str = ""
    entered: bool = False


class VerifiedError(Part):
    """Measured errors on the same tests and at the other place, None if not driven."""

    same_before: Deviation | None = None
    same_after: Deviation | None = None
    elsewhere_before: Deviation | None = None
    elsewhere_after: Deviation | None = None
    standing: Literal["pass", "watch", "fail", "unjudged"] = "unjudged"
    """Of the corrected robot, by the limits of the rig file."""


class Emulated(Part):
    effects: str = ""
    seed: int = 1
    fast: bool = False


class Session(Part):
    version: Literal[1] = 1
    rig: Annotated[str, Field(min_length=1)]
    rig_file: Annotated[str, Field(min_length=1)]
    rig_sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    aim: Aim
    maker: MakerName
    minutes: Annotated[float, Field(gt=0, le=_MOST_MINUTES)]
    began: Annotated[str, AfterValidator(_a_time)]
    emulated: Emulated | None = None
    stages: tuple[Stage, ...]
    steps: tuple[ProgramStep, ...]
    driven_minutes: NotNegative = 0.0
    """Time from the start of each step to the recorded run; pauses do not count."""
    left_alone: tuple[str, ...] = ()
    """Runs in the directory that belong to no step."""
    answer: Answer | None = None
    answered: str = ""
    """Reason for ending the search for errors; empty while it continues."""
    judged: Answer | None = None
    """Answer validated on the runs at the other place, which join the last answer."""
    decided: int = 0
    """Number of runs of the answer on which the end of measuring was decided."""
    correction: SessionCorrection | None = None
    verified: VerifiedError | None = None
    report: str = ""

    @model_validator(mode="after")
    def _consistent(self) -> Session:
        stage_names = [stage.name for stage in self.stages]
        if len(set(stage_names)) < len(stage_names):
            raise ValueError("two stages have the same name")
        for step in self.steps:
            if step.stage not in stage_names:
                raise ValueError(f"the step {step.program} is of the stage {step.stage!r}, which is missing")
            if (step.direction is None) == (step.test in CIRCLES):
                raise ValueError(f"the step {step.program} needs a direction if and only if it is a circle")
        return self

    def stage_of(self, step: ProgramStep) -> Stage:
        return next(stage for stage in self.stages if stage.name == step.stage)

    @property
    def open_steps(self) -> list[ProgramStep]:
        return [step for step in self.steps if step.is_open]

    def with_try(self, number: int, attempt: Try) -> Session:
        steps, tries = list(self.steps), (*self.steps[number].tries, attempt)
        steps[number] = steps[number].model_copy(update={"tries": tries})
        return self.model_copy(update={"steps": tuple(steps)})

    def is_last(self, answer: Answer) -> bool:
        """True if an answer used all runs before the correction, including those that judge."""
        if any(step.purpose == "judge" and step.is_open for step in self.steps):
            return False
        judges = len(self.runs_for("judge"))
        return (answer.runs, answer.joined) == (len(self.runs_for("find")) + judges, judges)

    @property
    def is_corrected(self) -> bool:
        return bool(self.verified and self.verified.same_after)

    @property
    def sides(self) -> tuple[Side, ...]:
        verified, correction = self.verified or VerifiedError(), self.correction
        at_place, elsewhere = (correction.same, correction.elsewhere) if correction else (None, None)
        sides = []
        if verified.same_before:
            sides.append(Side("same", verified.same_before, verified.same_after, at_place))
        if verified.elsewhere_before:
            sides.append(Side("elsewhere", verified.elsewhere_before, verified.elsewhere_after, elsewhere))
        return tuple(sides)

    @property
    def active(self) -> ActiveCorrection | None:
        """The verified correction of the robot."""
        correction, verified = self.correction, self.verified
        if not (correction and verified and verified.same_after) or correction.way == "none":
            return None
        return ActiveCorrection(correction.way, verified.same_after.um, verified.same_after.u_um)

    @property
    def to_do(self) -> tuple[str, ...]:
        """Acts by priority. A verified correction is left out."""
        answer = self.answer
        if answer is None:
            return ()
        if not answer.acts:
            return tuple(filter(None, (answer.next_step, *answer.remedies)))
        return tuple(map(self._words, self.open_acts))

    @property
    def instead(self) -> tuple[str, ...]:
        """Acts that would replace the correction, and leave a larger error."""
        return tuple(map(self._words, self._divided_acts[1]))

    def _words(self, act: SessionAct) -> str:
        return (self.is_corrected and act.corrected) or act.words

    @property
    def open_acts(self) -> tuple[SessionAct, ...]:
        return self._divided_acts[0]

    @property
    def _divided_acts(self) -> tuple[tuple[SessionAct, ...], tuple[SessionAct, ...]]:
        if self.answer is None:
            return (), ()
        elsewhere = bool(self.answer.joined or self.answer.judges or self.active)
        return open_acts(self.answer.acts, self.active, elsewhere=elsewhere)

    @property
    def summary(self) -> Summary | None:
        """Headline and tiles of the last answer; for a corrected robot with the error measured after the correction."""
        if self.answer is None or (summary := self.answer.summary) is None:
            return None
        acts, verified, active, texts = self.open_acts, self.verified, self.active, texts_of("en")
        if verified and verified.same_before and verified.same_after:
            summary = with_driven_error(summary, verified.same_before, verified.same_after, texts)
        elif self.judged and self.judged.summary:
            summary = replace(summary, error=self.judged.summary.error)
        if active and verified:
            is_enough = verified.standing != "fail"
            if is_enough or not acts:
                key = "act_none_corrected" if is_enough else "act_none_corrected_fail"
                return with_next(summary, texts(key), "", texts("do_now_none") if is_enough else "")
        if not acts:
            return with_next(summary, "", "", "")
        summary = with_next(summary, acts[0].step, acts[0].command, acts[0].action)
        return with_corrections_removed(summary, acts[0].kind, active.way if active else "none", texts)

    def runs_for(self, *purposes: Purpose) -> list[ProgramStep]:
        return [step for step in self.steps if step.purpose in purposes and step.run]


def own_programs(session: Session, directory: Path) -> str:
    """Command for other programs of the user; empty if a correction is not recommended.

    Entered values correct computed points in every program, so only taught points are left to convert.
    """
    if not (session.answer and session.answer.model) or (session.correction and session.correction.way == "none"):
        return ""
    model = SessionDirectory(directory).model_of(session.answer)
    if session.correction and session.correction.way == "entries":
        points = f"taught --since {as_argument(directory / session.correction.directory / CORRECTIONS_FILE)}"
    else:
        points = "computed"
    return f"rig correct {as_argument(model)} --program FILE --points {points} -o DIR"


class SessionDirectory:
    """A session's directory with the state file and a lock for one process."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self._lock: int | None = None

    def __enter__(self) -> SessionDirectory:
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            self._lock = durable.try_lock(self.directory)
        except OSError as error:
            remedy = "choose a different --output"
            raise FileError.of_os(self.directory, error, remedy, code="output.not_writable") from None
        if self._lock is None:
            problem = "a different rig session uses this directory"
            remedy = "end that session, or show it with --status"
            raise CellError(str(self.directory), problem, remedy, code="session.in_use")
        return self

    def __exit__(self, *_: object) -> None:
        if self._lock is not None:
            durable.close(self._lock)

    @property
    def file(self) -> Path:
        return self.directory / STATE

    def command(self, rig_file: Path | str, kept: Session | None = None) -> str:
        """Command that starts a session here, or resumes the stored one."""
        command = f"rig session {as_argument(rig_file)} -o {as_argument(self.directory)}"
        if kept is None:
            return command
        emulated = " --emulated" + " --fast" * kept.emulated.fast if kept.emulated else ""
        return f"{command} --for {kept.maker}{emulated}"

    @property
    def runs(self) -> Path:
        return self.directory / "runs"

    def run(self, name: str) -> Path:
        return self.runs / name

    def runs_of(self, steps: Sequence[ProgramStep]) -> list[Path]:
        return [self.run(step.run) for step in steps if step.run]

    def model_of(self, answer: Answer) -> Path:
        return self.directory / "found" / answer.found / answer.model

    def read(self) -> Session | None:
        try:
            text = read_text(self.file, _MOST_BYTES)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise FileError.of_os(self.file, error, "check the permissions", code="file.unreadable") from None
        root, data = read_yaml(text, str(self.file))
        try:
            return Session.model_validate(data)
        except ValidationError as error:
            if newer := of_newer_rig(str(self.file), error):
                raise newer from None
            raise RigFileError(str(self.file), problems_of(error, data, root, Session)) from None

    def require_intact(self, session: Session, rig_text: str) -> None:
        """Raise FileError if the session belongs to another text of the rig file, or if runs are missing."""
        if session.rig_sha256 != digest_of(rig_text):
            problem = f"is a session with the rig file {session.rig_file}, which has changed or is a different file"
            remedy = "restore that file, or start a new session with a different --output"
            raise FileError(str(self.file), problem, remedy, code="session.invalid")
        if missing := [run.name for run in self.runs_of(session.steps) if not run.is_dir()]:
            problem = f"names runs that are missing in {self.runs}: {', '.join(missing)}"
            remedy = "restore these directories, or start a new session with a different --output"
            raise FileError(str(self.file), problem, remedy, code="run.missing")

    def write(self, session: Session) -> None:
        """The old file is kept if the disk refuses (CellError)."""
        try:
            durable.replace(self.file, (_HEAD + text_of(session)).encode())
        except OSError as error:
            problem = f"cannot be written: {error.strerror or error}"
            remedy = "free some space, then repeat the command"
            raise CellError(str(self.file), problem, remedy, code="output.not_writable") from None


def text_of(session: Session) -> str:
    """YAML with a line for each step, without default values."""
    plain: dict[str, Any] = session.model_dump(mode="json", exclude_defaults=True)
    text: str = yaml.safe_dump(
        {"version": 1, **plain}, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None
    )
    return text


def digest_of(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()

"""The state of a session: one file that a person can read, written whole after each step.

Everything that a session knows is here; which step comes next follows from it alone (`analysis.apps.session.guide`). So
a session that was interrupted, however, goes on with the same command.
"""

from __future__ import annotations

import datetime as dt
import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import AfterValidator, Field, ValidationError, model_validator

from analysis.correction.deviation import Count, Deviation, Expected, NotNegative, Side, Work
from analysis.diagnosis.judge.acts import is_done
from analysis.report.summary import Summary, driven_error
from analysis.report.texts import texts_of
from daq.store import durable
from rigs.errors import CellError, FileError
from rigs.files import of_newer_rig, read_text
from rigs.problems import Problem, RigFileError, problems_of
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
"""A week: rig session takes a day at most."""
MOST_TRIES = 3
"""So often a step is driven again by itself before a person is asked to look at the cell."""

MAIN: DrivenTest = CIRCLES[0]
"""The test by which a session finds errors and shows that they are gone."""
ELSEWHERE = "other"
"""The stage at the place that is not used to find errors."""
Aim = Literal["faults", "accuracy", "check"]
"""What a session is for: what is worn, loose or shifted; how accurate the arm can be made; or whether all is well."""
Purpose = Literal["find", "judge", "verify"]
"""What a run is for: to find errors; to judge at a place that is not used for that; or to see what a correction did."""
Way = Literal["entries", "programs", "none"]
"""How the robot is corrected: values entered at the controller, programs with corrected targets, or not at all."""


def _a_time(text: str) -> str:
    dt.datetime.fromisoformat(text)  # which raises ValueError
    return text


class Stage(Part):
    """What a person sets up before some programs: where the ball stands and how the gauges are mounted. circle: where
    it differs from that of the rig file; words: what to set up."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9-]{1,40}$")]
    words: str
    circle: Circle | None = None


class Try(Part):
    """A run that was recorded for a step; why: what makes it unusable, empty where it is usable; held_up: how often the
    computer stood still meanwhile."""

    run: Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9._-]{0,200}$")]
    why: str = ""
    held_up: Count = 0


class Step(Part):
    """A program to be driven. program: its name, also of its file; tries: the runs recorded for it, the last counts;
    skipped: why it is not needed any more, or empty."""

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
        """The usable run of the step, if there is one."""
        return next((attempt.run for attempt in self.tries[::-1] if not attempt.why), None)

    @property
    def is_open(self) -> bool:
        """Whether it is still to be driven."""
        return self.run is None and not self.skipped

    @property
    def title(self) -> str:
        """For example `yaw acw`."""
        return " ".join(filter(None, (self.test, self.direction)))


class PartOfError(Part):
    """A part of the error in words, with its share of the whole and its root mean square in µm."""

    part: str
    kind: str = ""
    size: str = ""
    share: float
    um: float
    fault: bool = False


class Deed(Part):
    """An act that follows from an answer (`analysis.diagnosis.judge.acts`): its kind and reason, and what it says to
    do; corrected: the same once the robot was driven corrected, where that is said otherwise."""

    kind: str
    why: str
    words: str
    corrected: str = ""
    step: str = ""
    """The imperative alone, as in the summary."""
    command: str = ""


class Answer(Part):
    """What the runs so far show. runs, judges: how many were used, and how many judged at another place; joined: how
    many of those used had judged before, at the last diagnosis; condition and standing as of `rig diagnose`; headline,
    accuracy, next_step: its sentences; next_test: the test that would separate rivals or name a group; runs_to_decide:
    how many runs of each kind would decide; found: directory of its files; noise_um: scatter of one run, root mean
    square."""

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
    """What a person does next to that."""
    acts: tuple[Deed, ...] = ()
    """Both, with what kind of act each is; empty in sessions of earlier versions."""
    next_test: str = ""
    ground: str = ""
    """Why the model is corrected by, or not (`rigs.calibration.Ground`); empty where there is none."""
    runs_to_decide: int | None = None
    now_um: NotNegative
    calibrated_um: NotNegative
    before_there_um: NotNegative = 0.0
    """What was there without the model where calibrated_um was left with it."""
    level: float = 1.0
    """Multiple of the usual errors of this arm, 1 where it has them as such arms usually do (`rig plan --level`)."""
    noise_um: NotNegative
    seconds: NotNegative
    found: str
    model: str = ""
    """The rig file with what was found."""
    summary: Summary | None = None
    """Headline and tiles; None in sessions of earlier versions."""


class Correction(Part):
    """What is corrected and how. sentence: what a person does; expected_um: what the correction is expected to leave
    of the error of the readings, and before_um what it was; same, elsewhere: that with its uncertainty, on the circle
    and at the other place; work: over the whole work; directory: of its files; entered: whether a person entered the
    values."""

    way: Way
    sentence: str
    before_um: NotNegative
    expected_um: NotNegative
    same: Expected | None = None
    elsewhere: Expected | None = None
    work: Work | None = None
    directory: str = ""
    entered: bool = False


class Verified(Part):
    """The error on the robot before and after, on the same tests and at the place that was not used; None where one
    side was not driven."""

    same_before: Deviation | None = None
    same_after: Deviation | None = None
    elsewhere_before: Deviation | None = None
    elsewhere_after: Deviation | None = None


class Emulated(Part):
    """The emulated cell of a session: its hidden effects, the seed of its noise, and whether in simulated time."""

    effects: str = ""
    seed: int = 1
    fast: bool = False


class Session(Part):
    """All of it."""

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
    steps: tuple[Step, ...]
    driven_minutes: NotNegative = 0.0
    """Minutes from the start of each step to its run, pauses between sessions left out."""
    left_alone: tuple[str, ...] = ()
    """Runs in the directory that are of no step: of somebody else, or broken off."""
    answer: Answer | None = None
    answered: str = ""
    """Why no more is measured to find errors; empty while something is."""
    judged: Answer | None = None
    """What was found without the place that judges, with its judgement; those runs join the last answer."""
    decided: int = 0
    """Runs of the last answer after which nothing more is measured."""
    correction: Correction | None = None
    verified: Verified | None = None
    report: str = ""
    """The page, once the session is at its end."""

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

    def stage_of(self, step: Step) -> Stage:
        """Return what is set up for a step."""
        return next(stage for stage in self.stages if stage.name == step.stage)

    @property
    def open_steps(self) -> list[Step]:
        """The steps that are still to be driven."""
        return [step for step in self.steps if step.is_open]

    def with_step(self, number: int, step: Step) -> Session:
        """Return the session with another state of a step, counted from 0."""
        return self.model_copy(update={"steps": (*self.steps[:number], step, *self.steps[number + 1 :])})

    def is_last(self, answer: Answer) -> bool:
        """Whether an answer is of all runs before the correction, those that only judged among them."""
        if any(step.purpose == "judge" and step.is_open for step in self.steps):
            return False
        judges = len(self.runs_for("judge"))
        return (answer.runs, answer.joined) == (len(self.runs_for("find")) + judges, judges)

    @property
    def is_corrected(self) -> bool:
        """Whether the robot was driven with a correction."""
        return bool(self.verified and self.verified.same_after)

    @property
    def sides(self) -> tuple[Side, ...]:
        """The error on the robot at each place that was driven before the correction."""
        verified, correction = self.verified or Verified(), self.correction
        at_place, elsewhere = (correction.same, correction.elsewhere) if correction else (None, None)
        sides = []
        if verified.same_before:
            sides.append(Side("same", verified.same_before, verified.same_after, at_place))
        if verified.elsewhere_before:
            sides.append(Side("elsewhere", verified.elsewhere_before, verified.elsewhere_after, elsewhere))
        return tuple(sides)

    @property
    def to_do(self) -> tuple[str, ...]:
        """What is to be done, the first act first; of a robot that was corrected without the correction, which is
        done."""
        answer = self.answer
        if answer is None:
            return ()
        open_acts = tuple((self.is_corrected and act.corrected) or act.words for act in self.open_acts)
        return open_acts if answer.acts else tuple(filter(None, (answer.next_step, *answer.remedies)))

    @property
    def open_acts(self) -> tuple[Deed, ...]:
        """The actions that the correction has not done."""
        if self.answer is None:
            return ()
        way = self.correction.way if self.correction and self.is_corrected else None
        elsewhere = bool(self.answer.joined or self.answer.judges or way)
        return tuple(act for act in self.answer.acts if not is_done(act.kind, act.why, way=way, elsewhere=elsewhere))

    @property
    def summary(self) -> Summary | None:
        """Headline and tiles of the last answer; the error of a corrected robot is that measured with the correction.
        None without an answer."""
        if self.answer is None or (summary := self.answer.summary) is None:
            return None
        acts, verified = self.open_acts, self.verified
        if verified and verified.same_before and verified.same_after:
            summary = replace(summary, error=driven_error(verified.same_before, verified.same_after, texts_of("en")))
        elif self.judged and self.judged.summary:
            summary = replace(summary, error=self.judged.summary.error)
        return replace(summary, next=acts[0].step if acts else "", command=acts[0].command if acts else "")

    def runs_for(self, *purposes: Purpose) -> list[Step]:
        """Return the driven steps with these purposes."""
        return [step for step in self.steps if step.purpose in purposes and step.run]


def own_programs(session: Session, directory: Path) -> str:
    """Return the command that corrects programs of a person's own by what a session found; empty without a model, and
    where nothing is to be corrected by it."""
    if not (session.answer and session.answer.model) or (session.correction and session.correction.way == "none"):
        return ""
    model = Place(directory).model_of(session.answer)
    return f"rig correct {as_argument(model)} --program FILE -o DIR"


class Place:
    """The directory of a session: its file, and the lock that one process holds while it works with it."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self._lock: int | None = None

    def __enter__(self) -> Place:
        """Take the lock. Raises CellError where another session has it, FileError where there can be none."""
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            self._lock = durable.try_lock(self.directory)
        except OSError as error:
            raise FileError(str(self.directory), error.strerror or str(error), "choose a different --output") from None
        if self._lock is None:
            problem = "a different rig session uses this directory"
            raise CellError(str(self.directory), problem, "end that session, or show it with --status")
        return self

    def __exit__(self, *_: object) -> None:
        if self._lock is not None:
            durable.close(self._lock)

    @property
    def file(self) -> Path:
        """The file of the state."""
        return self.directory / STATE

    def command(self, rig_file: Path | str, kept: Session | None = None) -> str:
        """Return the command that begins a session of a rig file here, or goes on with the one that is kept."""
        command = f"rig session {as_argument(rig_file)} -o {as_argument(self.directory)}"
        if kept is None:
            return command
        emulated = " --emulated" + " --fast" * kept.emulated.fast if kept.emulated else ""
        return f"{command} --for {kept.maker}{emulated}"

    @property
    def runs(self) -> Path:
        """The directory of the runs."""
        return self.directory / "runs"

    def run(self, name: str) -> Path:
        """The directory of a run."""
        return self.runs / name

    def runs_of(self, steps: Sequence[Step]) -> list[Path]:
        """The directories of the runs of steps that were driven."""
        return [self.run(step.run) for step in steps if step.run]

    def model_of(self, answer: Answer) -> Path:
        """The rig file with what was found."""
        return self.directory / "found" / answer.found / answer.model

    def read(self) -> Session | None:
        """Return the session that is kept here, None where there is none. Raises FileError, RigFileError."""
        try:
            text = read_text(self.file, _MOST_BYTES)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise FileError(str(self.file), error.strerror or str(error), "check the permissions") from None
        root, data = read_yaml(text, str(self.file))
        try:
            return Session.model_validate(data)
        except ValidationError as error:
            if newer := of_newer_rig(str(self.file), error):
                raise newer from None
            raise RigFileError(str(self.file), problems_of(error, data, root, Session)) from None

    def hold_whole(self, session: Session, rig_text: str) -> None:
        """Raise RigFileError, with the lines, where a session names runs that are not here, or is of another rig file
        than the one with this text."""
        missing = []
        if session.rig_sha256 != digest_of(rig_text):
            problem = (
                "does not match the rig file: the rig file was changed, or this session belongs to a different one"
            )
            missing.append(("rig_sha256", session.rig_sha256, problem))
        names = (attempt.run for step in session.steps for attempt in step.tries)
        missing += [
            ("run", name, f"run {name} is missing in {self.runs}") for name in names if not self.run(name).is_dir()
        ]
        if missing:
            lines = read_text(self.file, _MOST_BYTES).splitlines()
            problems = [
                Problem(next((k for k, line in enumerate(lines, 1) if text in line), 1), place, problem)
                for place, text, problem in missing
            ]
            raise RigFileError(str(self.file), problems)

    def write(self, session: Session) -> None:
        """Keep a session, durably and at once. Raises CellError where the disk refuses; the old one stays then."""
        try:
            durable.replace(self.file, (_HEAD + text_of(session)).encode())
        except OSError as error:
            problem = f"cannot be written: {error.strerror or error}"
            raise CellError(str(self.file), problem, "free some space, then repeat the command") from None


def text_of(session: Session) -> str:
    """Return a session as YAML: a line for each step, without what is as usual."""
    plain: dict[str, Any] = session.model_dump(mode="json", exclude_defaults=True)
    text: str = yaml.safe_dump(
        {"version": 1, **plain}, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None
    )
    return text


def digest_of(text: str) -> str:
    """Return by what a rig file is known again."""
    return hashlib.sha256(text.encode()).hexdigest()

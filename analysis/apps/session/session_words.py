"""Screen output of a session: lines for each step, for the parts of the error, and for the end."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

from analysis.apps.report.texts import texts_of
from analysis.apps.session.next_step import Drive, Following
from analysis.apps.session.session_plan import SessionPace, minutes_of
from analysis.apps.session.session_state import (
    Answer,
    PartOfError,
    Session,
    SessionCorrection,
    SessionDirectory,
    Stage,
    Way,
    own_programs,
)
from analysis.correction.deviation import Deviation, Side
from rigs.text import as_argument, counted

_PURPOSES = {"find": "to find errors", "judge": "for validation only", "verify": "after the correction"}
_BAR = 10
_WIDTH = 34
_LONGEST = 46
"""Maximum length of the name and size of a part. Its figures and bar then fit into a terminal of 80 columns."""


def plan_lines(session: Session, pace: SessionPace, directory: Path) -> Iterator[str]:
    """Yield the remaining programs, with a line for each purpose and stage."""
    if not (open_steps := session.open_steps):
        return
    driven = len(session.steps) - len(open_steps)
    goes_on = f", {driven} of {len(session.steps)} steps completed" if driven else ""
    minutes = minutes_of(session.stages, open_steps, pace)
    yield f"{session.rig}: {counted(len(open_steps), 'program')} to run, {counted(round(minutes), 'minute')}{goes_on}"
    for (purpose, stage), group in groupby(open_steps, key=lambda step: (step.purpose, step.stage)):
        programs = [step.program for step in group]
        times = [f"{name} × {programs.count(name)}" for name in dict.fromkeys(programs)]
        yield f"  {stage}, {_PURPOSES[purpose]}: {', '.join(times)}"
    yield f"programs for {session.maker}: {directory / 'programs'}"


def step_lines(session: Session, number: int) -> Iterator[str]:
    """Yield the program to start and the commands for recording it manually."""
    step = session.steps[number]
    is_again = any(earlier.program == step.program and earlier.run for earlier in session.steps[:number])
    again = " again" if is_again else ""
    yield f"step {number + 1} of {len(session.steps)}: start program {step.program}{again}"
    if not again:
        way = f" --direction {step.direction}" if step.direction else ""
        yield f"to record manually: rig record start {step.program} --test {step.test}{way}; rig record stop"


def answer_lines(answer: Answer, before: Answer | None) -> Iterator[str]:
    """Yield the current diagnosis, unless it is unchanged."""
    if before is None or (answer.runs, answer.headline) != (before.runs, before.headline):
        yield f"  after {counted(answer.runs, 'run')}: {answer.headline}"
        yield from (f"    {line}" for line in budget_lines(answer.parts))


def more_lines(answer: Answer, stage: Stage) -> Iterator[str]:
    """Yield the additional stage and the reason for it."""
    measure = next((act.words for act in answer.acts if act.kind == "measure"), answer.next_step)
    yield f"  {answer.condition}: {measure}"
    yield f"  next stage: {stage.name}"


def budget_lines(parts: tuple[PartOfError, ...]) -> Iterator[str]:
    """Yield the parts of the error with their shares."""
    names = []
    for part in parts:
        # Leave the size out if it does not fit: the headline includes it.
        whole = f"{part.part} {part.size}".strip()
        short = part.part if len(part.part) <= _LONGEST else f"{part.part[: _LONGEST - 1]}…"
        names.append(whole if len(whole) <= _LONGEST else short)
    width = max(map(len, names), default=0)
    for part, name in zip(parts, names, strict=True):
        bar = "#" * round(_BAR * max(0.0, min(1.0, part.share)))
        yield f"{name:{width}} {100 * part.share:4.0f} % {part.um:7.1f} µm {bar}".rstrip()


def end_lines(session: Session, directory: Path) -> Iterator[str]:
    """Yield the result of a session: the error before and after, the causes, and the recommended acts."""
    answer, correction = session.answer, session.correction
    if answer:
        yield f"found: {answer.headline}"
        judged = session.judged
        if not session.is_corrected or judged is None:
            yield f"accuracy: {(judged or answer).accuracy}"
        elif judged.before_there_um:
            at_other_place = (
                f"{judged.before_there_um:.0f} µm rms with the nominal arm, {judged.calibrated_um:.1f} with the model"
            )
            yield f"validation at the second place: {at_other_place}"
        if answer.joined:
            yield f"the last diagnosis used all {answer.runs} runs, including the {answer.joined} of the second place"
    if correction:
        first, *further_lines = correction_lines(correction, session.sides)
        yield f"corrected: {first}"
        yield from further_lines
    for number, act in enumerate(session.to_do):
        first = "to remove the cause" if session.is_corrected else "next"
        yield f"  then: {act}" if number else f"{first}: {act}"
    if session.is_corrected and correction and session.to_do:
        yield f"  {texts_of('en')(f'after_cause_{correction.way}')}"
    programs = sum(len(step.tries) for step in session.steps)
    driven = f"{counted(programs, 'run')}, {counted(round(session.driven_minutes), 'minute')} of driving"
    yield f"{driven} ({session.minutes:g} minutes were available)"
    yield f"report: {directory / session.report}"
    if answer and answer.level != 1:
        rig_file = as_argument(Path(session.rig_file))
        yield f"to plan further tests of this arm: rig plan {rig_file} --level {max(answer.level, 0.01):.2g}"
    if command := own_programs(session, directory):
        yield f"the arm itself is unchanged; to correct your programs: {command}"


def correction_lines(correction: SessionCorrection, sides: Sequence[Side]) -> Iterator[str]:
    """Yield the correction and the error before, expected and measured after it, for each place."""
    is_driven = any(side.after for side in sides)
    yield _DRIVEN[correction.way] if is_driven else correction.sentence
    for side in sides:
        where = f"error of the path {'on the same circle' if side.place == 'same' else 'at the other place'}"
        expected = f" (expected {side.expected.text})" if side.expected else ""
        before = _size(side.before)
        yield f"{where}: {before} before, {_size(side.after)} after{expected}" if side.after else f"{where}: {before}"
    if is_driven and correction.work:
        work = correction.work
        yield (
            f"over the work area: {work.before_um:.0f} µm rms before, {work.after_um:.0f} expected after"
            f" (± {work.u_um:.0f} by the model).{texts_of('en').not_known(work.unknown)}"
        )


_DRIVEN: dict[Way, str] = {
    "programs": "The corrected programs were loaded and run.",
    "entries": "The values were entered at the controller, and the programs were driven.",
    "none": "The robot was not corrected.",
}


def _size(error: Deviation) -> str:
    size = f"{error.um:.1f} ± {error.u_um:.1f}" if error.u_um else f"{error.um:.1f}"
    return f"{size} µm rms (at most {error.largest_um:.0f})"


def status_lines(session: Session, following: Following, directory: Path) -> Iterator[str]:
    """Yield the progress of a session, with a line for each step, and the next step."""
    began = session.began.replace("T", " ")
    minutes = counted(round(session.driven_minutes), "minute")
    yield f"session of {session.rig}, started {began}, aim {session.aim}, {minutes} of driving"
    for number, step in enumerate(session.steps, start=1):
        open_state = f"to be repeated: {step.tries[-1].why}" if step.tries else "to be driven"
        state = step.run or (f"skipped: {step.skipped}" if step.skipped else open_state)
        yield f"{number:3} {step.program:{_WIDTH}} {state}"
    if session.answer:
        shown = "" if session.report else f" {session.answer.headline}"  # the lines of the end include it
        yield f"after {counted(session.answer.runs, 'run')}:{shown}"
        yield from (f"  {line}" for line in budget_lines(session.answer.parts))
    if session.report:
        yield from end_lines(session, directory)
    else:
        action = _NEXT.get(following) if isinstance(following, str) else None
        if isinstance(following, Drive):
            action = next(step_lines(session, following.number)).partition(": ")[2]
        command = SessionDirectory(directory).command(session.rig_file, session)
        yield f"next: {action or 'diagnose the runs'}; continue with: {command}"


_NEXT: dict[Following, str] = {
    "decide": "decide on further measurements",
    "correct": "make the correction",
    "enter": "enter the values of the correction at the controller",
    "report": "write the report",
}

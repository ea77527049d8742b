"""Answers of a session as blocks: the plan, the diagnosis so far, the progress, and the end."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.apps.report.blocks import Block, Cell, Command, Heading, Sentence, Table
from analysis.apps.report.diagnosis_answer import summary_blocks
from analysis.apps.report.page.accuracy import BeforeAfter, now_sentence, own_program_blocks, path_blocks
from analysis.apps.report.texts import texts_of
from analysis.apps.session.next_step import Drive, Following
from analysis.apps.session.session_plan import SessionPace, minutes_of
from analysis.apps.session.session_state import Answer, PartOfError, Session, SessionDirectory, own_programs
from rigs.text import as_argument, counted

if TYPE_CHECKING:
    from analysis.apps.report.page.accuracy import PageVerdict

_TEXTS = texts_of("en")
_NEXT: dict[Following, str] = {"decide": "decide", "correct": "correct", "enter": "enter", "report": "write"}


def plan_blocks(session: Session, pace: SessionPace, directory: Path) -> list[Block]:
    """The remaining programs, a row for each purpose and stage; empty if none remains."""
    if not (open_steps := session.open_steps):
        return []
    steps = len(session.steps)
    minutes = counted(round(minutes_of(open_steps, pace)), "minute")
    key, driven = "session_plan_goes_on" if len(open_steps) < steps else "session_plan", steps - len(open_steps)
    programs = counted(len(open_steps), "program")
    rows = []
    for (purpose, stage), group in groupby(open_steps, key=lambda step: (step.purpose, step.stage)):
        names = [step.program for step in group]
        times = [f"{name} × {names.count(name)}" for name in dict.fromkeys(names)]
        rows.append((stage, _TEXTS(f"session_{purpose}"), ", ".join(times)))
    return [
        Sentence(_TEXTS(key, rig=session.rig, programs=programs, minutes=minutes, driven=driven, steps=steps)),
        Table(("stage", "purpose", "programs"), tuple(rows)),
        Sentence(_TEXTS("session_programs", maker=session.maker, directory=directory / "programs"), "note"),
    ]


def step_lines(session: Session, number: int) -> list[str]:
    """The program to start, and at its first run the commands for recording it by hand."""
    step = session.steps[number]
    is_again = any(earlier.program == step.program and earlier.run for earlier in session.steps[:number])
    start = f"step {number + 1} of {len(session.steps)}: start program {step.program}"
    if is_again:
        return [f"{start} again"]
    way = f" --direction {step.direction}" if step.direction else ""
    return [start, f"to record manually: rig record start {step.program} --test {step.test}{way}; rig record stop"]


def diagnosis_blocks(answer: Answer) -> list[Block]:
    head = Sentence(_TEXTS("session_after_runs", runs=counted(answer.runs, "run"), headline=answer.headline))
    return [head, _parts(answer.parts)] if answer.parts else [head]


def _parts(parts: Sequence[PartOfError]) -> Table:
    rows = tuple(
        (Cell(part.part, (part.size,) if part.size else ()),
         Cell(f"{100 * part.share:.0f} %", bar=max(0.0, min(1.0, part.share))), f"{part.um:.1f}")
        for part in parts
    )  # fmt: skip
    return Table(tuple(map(_TEXTS, ("part", "share", "rms_um"))), rows, frozenset({2}))


def before_after(session: Session, directory: Path, verdict: PageVerdict | None = None) -> BeforeAfter | None:
    """verdict: on the runs after the correction."""
    correction, judged = session.correction, session.judged
    if correction is None:
        return None
    return BeforeAfter(
        correction.sentence, correction.way, session.sides, work=correction.work,
        judged=(judged.before_there_um, judged.calibrated_um) if judged and judged.before_there_um else None,
        joined=session.answer.joined if session.answer else 0, own_programs=own_programs(session, directory),
        verdict=verdict, summary=session.summary,
    )  # fmt: skip


def end_blocks(session: Session, directory: Path) -> list[Block]:
    answer, after, blocks = session.answer, before_after(session, directory), list[Block]()
    if session.summary:
        blocks += summary_blocks(session.summary, _TEXTS)
    elif answer:  # a session of an earlier version
        blocks += [Sentence(answer.headline), Sentence((session.judged or answer).accuracy)]
        blocks += [_parts(answer.parts)] if answer.parts else []
    if after:
        now = now_sentence(after, _TEXTS)
        blocks += [*path_blocks(after, _TEXTS), *([Sentence(now, "strong")] if now else [])]
    if session.to_do:
        blocks += [Heading(_TEXTS("then")), *(Sentence(f"{k}. {act}") for k, act in enumerate(session.to_do, 1))]
        blocks += [Sentence(_TEXTS(f"after_cause_{after.way}"), "note")] if after and after.driven else []
    if session.instead and after:
        blocks += [Sentence(_TEXTS("instead_of_correction")), *map(Sentence, session.instead)]
    blocks += own_program_blocks(after, _TEXTS) if after else []
    if answer and answer.level != 1:
        level = f"--level {max(answer.level, 0.01):.2g}"
        blocks += [Sentence(_TEXTS("session_further_tests")),
                   Command(f"rig plan {as_argument(Path(session.rig_file))} {level}")]  # fmt: skip
    runs = counted(sum(len(step.tries) for step in session.steps), "run")
    minutes = counted(round(session.driven_minutes), "minute")
    driven = _TEXTS("session_driven", runs=runs, minutes=minutes, available=f"{session.minutes:g}")
    return [*blocks, Sentence(_TEXTS("session_report", file=directory / session.report)), Sentence(driven, "note")]


def status_blocks(session: Session, following: Following, directory: Path) -> list[Block]:
    """The progress of a session with a row for each step, and the next step or the end."""
    began, minutes = session.began.replace("T", " "), counted(round(session.driven_minutes), "minute")
    rows = []
    for number, step in enumerate(session.steps, start=1):
        again = _TEXTS("session_to_repeat", why=step.tries[-1].why) if step.tries else _TEXTS("session_to_drive")
        state = step.run or (_TEXTS("session_skipped", why=step.skipped) if step.skipped else again)
        rows.append((f"{number}", step.program, state))
    head = _TEXTS("session_status", rig=session.rig, began=began, aim=session.aim, minutes=minutes)
    blocks: list[Block] = [Sentence(head), Table(("step", "program", "state"), tuple(rows))]
    if session.report:
        return [*blocks, *end_blocks(session, directory)]
    action: str = _TEXTS(f"session_{_NEXT.get(following, 'diagnose')}")
    if isinstance(following, Drive):
        action = step_lines(session, following.number)[0].partition(": ")[2]
    blocks += diagnosis_blocks(session.answer) if session.answer else []
    command = SessionDirectory(directory).command(session.rig_file, session)
    return [*blocks, Sentence(_TEXTS("session_next", action=action)), Command(command)]

"""Plan of a session: the programs, places and repeats that fit into the available time.

A session drives the circle of the rig file repeatedly in both directions, which measures the scatter, and the same
circle at a second place, which only judges the model. After the correction both are driven again, starting at the
current place of the ball. The remaining time is used for the tests that make the most further parameters testable.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import get_args

import yaml

from analysis.apps.makers.motion_plan import MotionPlan, demand_of, seconds_of
from analysis.apps.makers.writing import encoded_programs, programs_of
from analysis.apps.planning.capability import plan as plan_tests
from analysis.apps.planning.circle_candidates import SET_UP_MIN
from analysis.apps.programs.planned import LONGEST_ARC_DEG, plans_of
from analysis.apps.session.session_state import (
    ELSEWHERE,
    MAIN,
    Aim,
    Answer,
    Emulated,
    ProgramStep,
    Purpose,
    Session,
    Stage,
    Way,
)
from analysis.diagnosis.plan.further_tests import FurtherTest, further_tests, places, with_circle
from analysis.robot.geometry.driven_programs import circle_program
from analysis.runs.written_files import write_all_over
from daq.store.manifest import DrivenWith
from rigs.errors import FileError, RigPlace, UseError
from rigs.readiness import require_test
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, Direction, DrivenTest, MakerName, TestName
from rigs.yaml_text import data_of

DWELL_S = 3.0
"""Pause at each target of radial and repeatability tests. Arms settle within 1 s; slow gauges need a few readings."""
FIXED = "-fixed"
"""Suffix of corrected programs. Names then have 23 characters; all controller languages accept 24."""
_BOTH: tuple[Direction, ...] = ("acw", "cw")
_MOST_MORE = 4
"""Maximum number of stages added to separate rivals or to decide. If they do not suffice, an expert is needed."""
_SEPARATING_RUNS = 2
"""Runs in each direction of a test that separates rivals: two are needed to measure the scatter."""


Addition = tuple[Stage, tuple[ProgramStep, ...]]
"""A further stage with its steps."""


@dataclass(frozen=True)
class SessionPace:
    """Time needed besides the motion, per stage and per program; thinking_min: inference, correction and report."""

    set_up_min: float
    handling_s: float
    thinking_min: float


BY_HAND = SessionPace(SET_UP_MIN, 45.0, 2.0)
"""Chosen: walk to the pendant, select a program, mount the link, start."""
BY_ITSELF = SessionPace(0.05, 1.5, 0.8)
"""Measured on two busy cores: 3 s per stage, 0.5 to 1 s per motion, 45 s at the end."""


@dataclass(frozen=True)
class SessionOptions:
    rig_file: str
    aim: Aim
    minutes: float
    maker: MakerName
    emulated: Emulated | None
    operator: str
    wait_min: float
    correct: Way | None = None
    entered: bool = False

    @property
    def pace(self) -> SessionPace:
        return BY_ITSELF if self.emulated and not self.emulated.fast else BY_HAND


@dataclass(frozen=True)
class SessionProgram:
    """corrected: kind of correction active while it is driven."""

    name: str
    stage: str
    test: DrivenTest
    direction: Direction | None
    plan: MotionPlan
    seconds: float
    corrected: DrivenWith = ""


def stage_rig(rig: Rig, stage: Stage) -> Rig:
    """Rig of a stage, without automatic runs, because the session records."""
    moved = rig.model_copy(update={"automatic": None})
    return moved if stage.circle is None else with_circle(moved, stage.circle)


def stage_text(text: str, stage: Stage) -> str:
    data = {key: value for key, value in data_of(text).items() if key != "automatic"}
    if stage.circle is not None:
        data["tests"] = {**(data.get("tests") or {}), "circle": stage.circle.model_dump(mode="json")}
    written: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110)
    return written


def planned(
    rig: Rig, aim: Aim, minutes: float, pace: SessionPace, progress: Callable[[str], None]
) -> tuple[tuple[Stage, ...], tuple[ProgramStep, ...]]:
    """Raises FileError if the arm cannot drive the circle, and UseError if the time is too short."""
    if not rig.gauges.recorded:
        problem = "does not have gauges, but a session needs two gauges to read circles"
        remedy = "measure poses (rig plan RIG --poses 60) or touches (rig record touch), then run rig diagnose"
        raise FileError(RigPlace.of(rig.name), problem, remedy, code="rig_file.invalid")
    require_test(rig, MAIN)
    minutes -= pace.thinking_min
    main = Stage(name=MAIN, words=_set_up(MAIN, None))
    backbones = list(_backbones(rig, aim, main))
    best = next((backbone for backbone in backbones if minutes_of(backbone[1], pace) <= minutes), None)
    if best is None:
        need = minutes_of(backbones[-1][1], pace) + pace.thinking_min
        problem = f"the shortest session of this cell takes {need:.1f} minutes"
        raise UseError("--minutes", problem, "give more time")
    stages, steps = best
    spare_min = minutes - minutes_of(steps, pace)
    if aim != "check" and spare_min > pace.set_up_min + 1:
        extra = _further_stages(rig, spare_min, pace, progress)
        stages = (*stages, *(stage for stage, _ in extra))
        steps = insert_find_steps(steps, (step for _, added in extra for step in added))
    return stages, numbered(steps)


def _backbones(rig: Rig, aim: Aim, main: Stage) -> Iterator[tuple[tuple[Stage, ...], tuple[ProgramStep, ...]]]:
    """The possible backbones, longest first."""
    main_programs = programs_for(rig, main, MAIN)
    if aim == "check":
        for repeats in (2, 1):
            yield (main,), _circles(main_programs, "find", repeats)
        return
    other_stage = elsewhere(rig)
    stages = (main, other_stage) if other_stage else (main,)
    other_programs = programs_for(rig, other_stage, MAIN) if other_stage else []
    for repeats, again in ((3, 2), (3, 1), (2, 2), (2, 1), (1, 1)):
        judged, after = _circles(other_programs, "judge", again), _circles(other_programs, "verify", again)
        find, verify = _circles(main_programs, "find", repeats), _circles(main_programs, "verify", again)
        yield stages, (*find, *judged, *after, *verify)


def elsewhere(rig: Rig) -> Stage | None:
    """Stage at a second place with the same link and tool, if the arm can drive one."""
    circle = rig.tests.circle
    assert circle is not None  # noqa: S101 - looked at before
    for words, centre in places(rig, circle):
        moved = with_circle(rig, circle, centre_mm=tuple(round(coordinate, 3) for coordinate in centre))
        if drives(moved):
            return Stage(name=ELSEWHERE, words=_set_up(MAIN, words), circle=moved.tests.circle)
    return None


def drives(rig: Rig) -> bool:
    """True if the arm can drive the circle of a rig in both directions with generated programs."""
    try:
        for direction in _BOTH:
            circle_program(rig, direction)
        plans_of(rig, MAIN, DWELL_S)
    except FileError:
        return False
    return True


def _set_up(test: DrivenTest, place: str | None) -> str:
    if test not in CIRCLES:
        return "mount the ball at the centre of the hemisphere, and one gauge on its link"
    where = f"mount the ball {place}" if place else "mount the ball at the centre of the circle of the rig file"
    return f"{where}, and the gauges for {test}"


def _circles(programs: Sequence[SessionProgram], purpose: Purpose, repeats: int) -> tuple[ProgramStep, ...]:
    once = [
        ProgramStep(
            program=program.name, stage=program.stage, test=program.test, direction=program.direction,
            purpose=purpose, seconds=round(program.seconds),
        )
        for program in programs
    ]  # fmt: skip
    return tuple(repeats * once)


def _addition(rig: Rig, further: FurtherTest, words: str, moved: Rig, number: int) -> Addition | None:
    """None if it needs another link or tool. Raises FileError if undrivable."""
    circle, rig_circle = moved.tests.circle, rig.tests.circle
    if moved.robot != rig.robot or (circle and rig_circle and circle.radius_mm != rig_circle.radius_mm):
        return None
    test: DrivenTest = next(candidate for candidate in get_args(DrivenTest) if candidate in further.tests)
    is_moved = circle != rig_circle
    name, where = (f"circle-{number}", words.removeprefix("circle ")) if is_moved else (test, None)
    stage = Stage(name=name, words=_set_up(test, where), circle=circle if is_moved else None)
    return stage, _circles(programs_for(rig, stage, test), "find", _SEPARATING_RUNS if test in CIRCLES else 1)


def separating(rig: Rig, words: str, tests: Sequence[TestName], number: int) -> Addition | None:
    """Stage and steps of a test named by `rig plan`; None if it needs another link or tool.

    number: in the name of the stage if the circle differs. Raises FileError if undrivable.
    """
    for further in further_tests(rig, tests):
        for called, moved in further.choices:
            if called == words:
                return _addition(rig, further, words, moved, number)
    return None


def _further_stages(rig: Rig, minutes: float, pace: SessionPace, progress: Callable[[str], None]) -> list[Addition]:
    """Tests for the remaining time, by the number of parameters made testable per minute."""
    possible: list[tuple[str, float, Addition]] = []
    for number, further in enumerate(further_tests(rig, (MAIN,)), start=2):
        for words, moved in further.choices:
            with suppress(FileError):
                if addition := _addition(rig, further, words, moved, number):
                    need = minutes_of(addition[1], pace)
                    possible += [(words, need, addition)] if need <= minutes else []
    if not possible:
        return []
    progress("planning further tests")
    gains = {gain.test: gain.parts + gain.shows for gain in plan_tests(rig, (MAIN,), 2).gains}
    chosen: dict[str, Addition] = {}
    for words, need, addition in sorted(possible, key=lambda one: -gains.get(one[0], 0) / one[1]):
        if gains.get(words, 0) > 0 and need <= minutes and addition[0].name not in chosen:
            chosen[addition[0].name] = addition
            minutes -= need
    return list(chosen.values())


def further_stage(session: Session, answer: Answer, rig: Rig, pace: SessionPace) -> Addition | None:
    """Steps that separate rivals or help to decide; None if none does, or if time is short."""
    if len(session.stages) >= 2 + _MOST_MORE:
        return None
    addition: Addition | None = None
    is_open = answer.condition == "undecided"
    # More repeats do not distinguish these causes.
    is_ambiguous = answer.condition == "ambiguous" or (is_open and answer.runs_to_decide is None)
    if answer.next_test and (is_ambiguous or session.is_last(answer)):
        tests = tuple(dict.fromkeys(step.test for step in session.runs_for("find")))
        addition = separating(rig, answer.next_test, tests, len(session.stages) + 1)
    elif is_open and answer.runs_to_decide is not None:
        # Repeat the main test in each direction, if that may decide.
        main = session.stages[0]
        main_steps = [step for step in session.steps if step.stage == main.name and step.purpose == "find"]
        once = list({step.program: step for step in main_steps}.values())
        if sum(bool(step.run) for step in main_steps) < len(once) * answer.runs_to_decide:
            addition = main, tuple(step.model_copy(update={"tries": (), "skipped": ""}) for step in once)
    # A test at the judging place is driven anyway, and its runs join the last diagnosis.
    judged_at = [stage.circle for stage in session.stages if stage.circle is not None]
    if addition is None or addition[0].circle in judged_at:
        return None
    need = minutes_of((*addition[1], *session.open_steps), pace)
    return addition if session.driven_minutes + need <= session.minutes else None


def insert_find_steps(steps: Sequence[ProgramStep], added: Iterable[ProgramStep]) -> tuple[ProgramStep, ...]:
    at = sum(step.purpose == "find" for step in steps)
    return (*steps[:at], *added, *steps[at:])


def minutes_of(steps: Sequence[ProgramStep], pace: SessionPace) -> float:
    changes = sum(k == 0 or steps[k - 1].stage != step.stage for k, step in enumerate(steps))
    driven_s = sum(step.seconds + pace.handling_s for step in steps)
    return changes * pace.set_up_min + driven_s / 60


def numbered(steps: Sequence[ProgramStep], written: Sequence[ProgramStep] = ()) -> tuple[ProgramStep, ...]:
    """Number the programs in the order of first use; the files in `written` keep their numbers."""
    names = {_bare(step.program): step.program for step in written}
    for bare in map(_bare, (step.program for step in steps)):
        names.setdefault(bare, f"p{len(names) + 1:02d}-{bare}")
    return tuple(step.model_copy(update={"program": names[_bare(step.program)]}) for step in steps)


def _bare(program: str) -> str:
    head, _, stem = program.partition("-")
    return stem if head[:1] == "p" and head[1:].isdigit() else program


def programs_for(rig: Rig, stage: Stage, test: DrivenTest, arc_deg: float = LONGEST_ARC_DEG) -> list[SessionProgram]:
    """Programs of a test at a stage, for each direction, without numbers."""
    at = stage_rig(rig, stage)
    ways: tuple[Direction | None, ...] = _BOTH if test in CIRCLES else (None,)
    place = stage.name if stage.circle else ""
    programs = []
    for way, plan in zip(ways, plans_of(at, test, DWELL_S, arc_deg=arc_deg), strict=True):
        name = "-".join(filter(None, (test, way, place)))
        programs.append(SessionProgram(name, stage.name, test, way, plan, seconds_of(plan)))
    return programs


def programs_of_steps(rig: Rig, stages: Sequence[Stage], steps: Sequence[ProgramStep]) -> dict[str, SessionProgram]:
    return programs_by_step(stages, steps, partial(programs_for, rig))


def programs_by_step(
    stages: Sequence[Stage],
    steps: Sequence[ProgramStep],
    programs_of_test: Callable[[Stage, DrivenTest], list[SessionProgram]],
    suffix: str = "",
) -> dict[str, SessionProgram]:
    """suffix: added to the names of the programs."""
    programs: dict[str, SessionProgram] = {}
    for stage in stages:
        stage_steps = [step for step in steps if step.stage == stage.name]
        for test in dict.fromkeys(step.test for step in stage_steps):
            by_way = {program.direction: program for program in programs_of_test(stage, test)}
            for step in stage_steps:
                if step.test == test and step.program not in programs:
                    name, program = f"{step.program}{suffix}", by_way[step.direction]
                    programs[step.program] = replace(program, name=name, plan=replace(program.plan, name=name))
    return programs


def write_programs(maker: MakerName, programs: Sequence[SessionProgram], directory: Path) -> list[Path]:
    files = programs_of(maker, [(program.plan, demand_of(program.plan)) for program in programs])
    return write_all_over(directory, encoded_programs(maker, files))

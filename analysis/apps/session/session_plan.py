"""The plan of a session: which programs are driven, where and how often, in the time at hand.

Every session that corrects has the same backbone: the circle of the rig file in both directions, repeated, so that the
scatter between runs is measured; the same at a place that finds nothing and judges everything; after the correction
both again, the ball first where it lies. What time is left goes to the tests that make most else testable
(`rig plan`). A session that only checks drives the circle alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import yaml

from analysis.apps.makers.programs.motion_plan import Plan, demand_of, seconds_of
from analysis.apps.makers.programs.planned import LONGEST_ARC_DEG, plans_of
from analysis.apps.makers.writing import encoded_programs, programs_of
from analysis.apps.session.session_state import ELSEWHERE, MAIN, Aim, Purpose, Stage, Step
from analysis.diagnosis.plan.detectability import further_tests, places, with_circle
from analysis.diagnosis.plan.detectability import plan as plan_tests
from analysis.diagnosis.plan.proposal import SET_UP_MIN
from analysis.robot.geometry.driven_programs import circle_program
from analysis.runs.written_files import write_all_over
from daq.store.manifest import DrivenWith
from rigs.errors import FileError, RigPlace, UseError
from rigs.readiness import require_test
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, Direction, DrivenTest, MakerName, TestName
from rigs.yaml_text import data_of

DWELL_S = 3.0
"""Seconds at each target of radial and repeatability: arms settle within one, and slow gauges answer a few times."""
FIXED = "-fixed"
"""What the names of corrected programs end with. With it they have 23 characters, of the 24 that all languages take."""
_BOTH: tuple[Direction, ...] = ("acw", "cw")
_SEPARATING_RUNS = 2
"""Runs in each direction of a test that separates rivals: two, so that its scatter is measured."""


@dataclass(frozen=True)
class Pace:
    """What a session takes beside the motion: minutes to set up a stage, seconds for a program, and minutes at its end
    for inference, correction and report."""

    set_up_min: float
    handling_s: float
    thinking_min: float


BY_HAND = Pace(SET_UP_MIN, 45.0, 2.0)
"""Chosen: somebody who has done it before walks to the pendant, selects a program, mounts the link and starts it."""
BY_ITSELF = Pace(0.05, 1.5, 0.8)
"""An emulated cell; measured on two busy cores: 3 s a stage, 0.5 to 1 s beside each motion, 45 s at the end."""


@dataclass(frozen=True)
class Program:
    """A program of a session: its name, its stage, what it drives, and how long it takes; corrected: what corrects the
    arm while it drives."""

    name: str
    stage: str
    test: DrivenTest
    direction: Direction | None
    plan: Plan
    seconds: float
    corrected: DrivenWith = ""


def stage_rig(rig: Rig, stage: Stage) -> Rig:
    """Return the rig of a stage: with its circle, and without rules for automatic runs, since a session records."""
    moved = rig.model_copy(update={"automatic": None})
    return moved if stage.circle is None else with_circle(moved, stage.circle)


def stage_text(text: str, stage: Stage) -> str:
    """Return the text of a rig file as it is for a stage."""
    data = {key: value for key, value in data_of(text).items() if key != "automatic"}
    if stage.circle is not None:
        data["tests"] = {**(data.get("tests") or {}), "circle": stage.circle.model_dump(mode="json")}
    written: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110)
    return written


def planned(
    rig: Rig, aim: Aim, minutes: float, pace: Pace, progress: Callable[[str], None]
) -> tuple[tuple[Stage, ...], tuple[Step, ...]]:
    """Return the stages and steps for the time at hand.

    Raises FileError where the arm cannot drive its circle, UseError where the time is too short for anything.
    """
    if not rig.gauges.recorded:
        problem = "does not have gauges, but a session needs two gauges to read circles"
        remedy = "measure poses (rig plan RIG --poses 60) or touches (rig record touch), then rig diagnose"
        raise FileError(RigPlace.of(rig.name), problem, remedy)
    require_test(rig, MAIN)
    minutes -= pace.thinking_min
    main = Stage(name=MAIN, words=_set_up(MAIN, None))
    backbones = list(_backbones(rig, aim, main))
    best = next((backbone for backbone in backbones if minutes_of(*backbone, pace) <= minutes), None)
    if best is None:
        need = minutes_of(*backbones[-1], pace) + pace.thinking_min
        raise UseError("--minutes", f"the shortest session of this cell takes {need:.1f} minutes", "give more time")
    stages, steps = best
    spare_min = minutes - minutes_of(stages, steps, pace)
    if aim != "check" and spare_min > pace.set_up_min + 1:
        extra = _extra(rig, spare_min, pace, progress)
        at = next((k for k, step in enumerate(steps) if step.purpose != "find"), len(steps))
        stages = (*stages, *(stage for stage, _ in extra))
        steps = (*steps[:at], *(step for _, extra_steps in extra for step in extra_steps), *steps[at:])
    return stages, numbered(steps)


def _backbones(rig: Rig, aim: Aim, main: Stage) -> Iterator[tuple[tuple[Stage, ...], tuple[Step, ...]]]:
    """Yield what every session drives, the most first."""
    main_programs = programs_for(rig, main, MAIN)
    if aim == "check":
        for repeats in (2, 1):
            yield (main,), _circles(main_programs, "find", repeats)
        return
    other_stage = elsewhere(rig)
    stages = (main, other_stage) if other_stage else (main,)
    other_programs = programs_for(rig, other_stage, MAIN) if other_stage else []
    for repeats in (3, 2, 1):
        for again in (2, 1):
            if again <= repeats:
                judged, after = _circles(other_programs, "judge", again), _circles(other_programs, "verify", again)
                yield (
                    stages,
                    (
                        *_circles(main_programs, "find", repeats),
                        *judged,
                        *after,
                        *_circles(main_programs, "verify", again),
                    ),
                )


def elsewhere(rig: Rig) -> Stage | None:
    """Return the stage at another place, with the same link and tool; None where the arm can drive none."""
    circle = rig.tests.circle
    assert circle is not None  # noqa: S101 - looked at before
    for words, centre in places(rig, circle):
        moved = with_circle(rig, circle, centre_mm=tuple(round(coordinate, 3) for coordinate in centre))
        if drives(moved):
            return Stage(name=ELSEWHERE, words=_set_up(MAIN, words), circle=moved.tests.circle)
    return None


def drives(rig: Rig) -> bool:
    """Whether the arm can drive the circle of a rig, in both directions, as programs drive it."""
    try:
        for direction in _BOTH:
            circle_program(rig, direction)
        plans_of(rig, MAIN, DWELL_S)
    except FileError:
        return False
    return True


def _set_up(test: DrivenTest, place: str | None) -> str:
    """What a person sets up, in words."""
    if test not in CIRCLES:
        return "the ball at the centre of the hemisphere, one gauge on the link of the hemisphere"
    where = f"the ball {place}" if place else "the ball at the centre of the circle of the rig file"
    return f"{where}, the gauges for {test}"


def _circles(programs: Sequence[Program], purpose: Purpose, repeats: int) -> tuple[Step, ...]:
    """Return so many runs of each program, in turn."""
    return tuple(
        Step(
            program=program.name,
            stage=program.stage,
            test=program.test,
            direction=program.direction,
            purpose=purpose,
            seconds=round(program.seconds),
        )
        for _ in range(repeats)
        for program in programs
    )


def separating(rig: Rig, words: str, tests: Sequence[TestName], number: int) -> tuple[Stage, tuple[Step, ...]] | None:
    """Return the stage and the steps of a further test by what `rig plan` calls it; None where it needs another link or
    tool, or the arm cannot drive it. number: of the stage, which its name ends with where the circle is another."""
    for further in further_tests(rig, tests):
        for called, moved in further.choices:
            if called != words:
                continue
            circle, rig_circle = moved.tests.circle, rig.tests.circle
            if moved.robot != rig.robot or (circle and rig_circle and circle.radius_mm != rig_circle.radius_mm):
                return None
            test: DrivenTest = next(candidate for candidate in get_args(DrivenTest) if candidate in further.tests)
            is_moved = circle != rig_circle
            name = f"circle-{number}" if is_moved else test
            where = words.removeprefix("circle ") if is_moved else None
            stage = Stage(name=name, words=_set_up(test, where), circle=circle if is_moved else None)
            return stage, _circles(programs_for(rig, stage, test), "find", _SEPARATING_RUNS if test in CIRCLES else 1)
    return None


def _extra(
    rig: Rig, minutes: float, pace: Pace, progress: Callable[[str], None]
) -> list[tuple[Stage, tuple[Step, ...]]]:
    """Return further tests in the time that is left, those that make most testable for their minutes first."""
    possible = []
    for number, further in enumerate(further_tests(rig, (MAIN,)), start=2):
        for words, _ in further.choices:
            try:
                addition = separating(rig, words, (MAIN,), number)
            except FileError:
                continue
            if addition and minutes_of((addition[0],), addition[1], pace) <= minutes:
                possible.append((words, addition))
    if not possible:
        return []
    progress("planning further tests")
    gains = {gain.test: gain.parts + gain.shows for gain in plan_tests(rig, (MAIN,), 2).gains}
    chosen: list[tuple[Stage, tuple[Step, ...]]] = []
    ranked = sorted(
        (
            (gains.get(words, 0) / minutes_of((addition[0],), addition[1], pace), k)
            for k, (words, addition) in enumerate(possible)
        ),
        reverse=True,
    )
    for gain, k in ranked:
        stage, steps = possible[k][1]
        need = minutes_of((stage,), steps, pace)
        if gain > 0 and need <= minutes and stage.name not in [taken.name for taken, _ in chosen]:
            chosen.append((stage, steps))
            minutes -= need
    return chosen


def minutes_of(stages: Sequence[Stage], steps: Sequence[Step], pace: Pace) -> float:
    """Return the minutes that steps take, with the set-up before each change of the stage."""
    changes = sum(k == 0 or steps[k - 1].stage != step.stage for k, step in enumerate(steps))
    driven_s = sum(step.seconds + pace.handling_s for step in steps)
    return changes * pace.set_up_min + driven_s / 60


def numbered(steps: Sequence[Step], written: Sequence[Step] = ()) -> tuple[Step, ...]:
    """Return the steps with programs whose names say the order in which they are first driven. written: steps whose
    programs are written, and keep their numbers."""
    names = {_bare(step.program): step.program for step in written}
    for bare in map(_bare, (step.program for step in steps)):
        names.setdefault(bare, f"p{len(names) + 1:02d}-{bare}")
    return tuple(step.model_copy(update={"program": names[_bare(step.program)]}) for step in steps)


def _bare(program: str) -> str:
    """A program's name without its number."""
    head, _, stem = program.partition("-")
    return stem if head[:1] == "p" and head[1:].isdigit() else program


def programs_for(rig: Rig, stage: Stage, test: DrivenTest, arc_deg: float = LONGEST_ARC_DEG) -> list[Program]:
    """Return the programs of a test at a stage, for each direction, without their numbers. Raises FileError."""
    at = stage_rig(rig, stage)
    ways: tuple[Direction | None, ...] = _BOTH if test in CIRCLES else (None,)
    place = stage.name if stage.circle else ""
    programs = []
    for way, plan in zip(ways, plans_of(at, test, DWELL_S, arc_deg=arc_deg), strict=True):
        name = "-".join(filter(None, (test, way, place)))
        programs.append(Program(name, stage.name, test, way, plan, seconds_of(plan)))
    return programs


def named_as(program: Program, name: str) -> Program:
    """Return a program under another name, which is that of its plan as well: its file is named by it."""
    return replace(program, name=name, plan=replace(program.plan, name=name))


def programs_of_steps(rig: Rig, stages: Sequence[Stage], steps: Sequence[Step]) -> dict[str, Program]:
    """Return the nominal programs that steps need, by their names."""
    programs: dict[str, Program] = {}
    for stage in stages:
        stage_steps = [step for step in steps if step.stage == stage.name]
        for test in dict.fromkeys(step.test for step in stage_steps):
            by_way = {program.direction: program for program in programs_for(rig, stage, test)}
            for step in stage_steps:
                if step.test == test and step.program not in programs:
                    programs[step.program] = named_as(by_way[step.direction], step.program)
    return programs


def write_programs(maker: MakerName, programs: Sequence[Program], directory: Path) -> list[Path]:
    """Write the files of programs for a maker's controllers, in place of those that are there. Raises FileError where
    there can be none, CellError when the disk refuses."""
    files = programs_of(maker, [(program.plan, demand_of(program.plan)) for program in programs])
    return write_all_over(directory, encoded_programs(maker, files))

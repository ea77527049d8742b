"""Which tests a rig file can drive, and what is missing for the others: one answer for every command.

A command that drives, simulates, plans, records or imports a test asks here before it starts, so that a missing gauge
is the first line that a person reads, and not the end of ten programs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar, get_args

from rigs.errors import FileError, RigPlace
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, DRIVEN_AXES, TEST_PARTS, DrivenTest, PartName, TestName

P = TypeVar("P")
_ADD_PART: dict[PartName, str] = {
    "circle": "add it: centre, posture, radius; rig circle fit --live --rig FILE --write finds them from a motion",
    "hemisphere": "add it: centre, posture, radius",
    "touch": "add it: touch: {sockets: [A, B]}",
    "iso9283": "add it: tests: {iso9283: {}} looks for a cube by itself",
}


@dataclass(frozen=True)
class Missing:
    """One thing that a test needs and a rig file lacks. key: its place in the file; problem: what is missing, in words
    that follow the file's name; remedy: what to add."""

    key: str
    problem: str
    remedy: str

    def error(self, rig: Rig) -> FileError:
        """The error that names it."""
        return FileError(RigPlace.of(rig.name), self.problem, self.remedy)


def gauges_needed(test: TestName) -> tuple[str, ...]:
    """Return the gauges that a test of rig's own is read with."""
    if test in CIRCLES:
        return ("g1", "g2")
    return ("g1",) if test in get_args(DrivenTest) else ()


def missing_for(rig: Rig, test: TestName) -> tuple[Missing, ...]:
    """Return what a rig file lacks to have a test driven and measured; nothing for a test of another package."""
    arm = missing_arm(rig) if gauges_needed(test) else ()
    part = _missing_part(rig, TEST_PARTS[test]) if test in TEST_PARTS else ()
    return (*arm, *missing_gauges(rig, test), *part)


def missing_gauges(rig: Rig, test: TestName) -> tuple[Missing, ...]:
    """Return the gauges that a test needs and a rig file lacks."""
    needed, present = gauges_needed(test), dict(rig.gauges)
    lacking = [name for name in needed if name not in present]
    if not lacking:
        return ()
    if not present:
        problem = f"has no gauges, which {', '.join(get_args(DrivenTest))} are measured with"
        return (Missing("gauges", problem, "add gauges and feedback to the rig file"),)
    problem = f"has one gauge, and {' and '.join(CIRCLES)} need two: an angle is the difference of two distances"
    return (Missing("gauges.g2", problem, "add gauges.g2 with its interface, port and offset_mm"),)


def _missing_part(rig: Rig, part: PartName) -> Iterator[Missing]:
    """Yield what to say of a part of `tests` that a rig file lacks."""
    if getattr(rig.tests, part) is None:
        yield Missing(f"tests.{part}", f"the rig file has no tests.{part}", _ADD_PART[part])


def require_part(rig: Rig, declared: P | None, part: PartName) -> P:
    """Return a part of `tests` as a rig file declares it. Raises FileError if it lacks the part."""
    if declared is None:
        raise next(_missing_part(rig, part)).error(rig)
    return declared


def unmeasurable(rig: Rig) -> tuple[Missing, ...]:
    """Return what is missing for tests that a rig file declares and has gauges for, but not enough: a mistake in it."""
    declared = [test for test, part in TEST_PARTS.items() if getattr(rig.tests, part) is not None]
    if not dict(rig.gauges):
        return ()
    return tuple(dict.fromkeys(missing for test in declared for missing in missing_gauges(rig, test)))


def readiness_lines(rig: Rig) -> list[str]:
    """Return which tests a rig file is ready for, and what is missing for each of the others, a line each."""
    lacks: dict[Missing, list[str]] = {}
    for test in get_args(TestName):
        for missing in missing_for(rig, test):
            lacks.setdefault(missing, []).append(test)
    ready = ", ".join(test for test in get_args(TestName) if not missing_for(rig, test)) or "none"
    lines = [f"ready for these tests: {ready}; tables of poses and touches can be imported with any rig file"]
    return lines + [f"not {', '.join(tests)}: {missing.problem}; {missing.remedy}" for missing, tests in lacks.items()]


def require_test(rig: Rig, test: TestName) -> None:
    """Raise FileError with the first thing that a rig file lacks for a test."""
    for missing in missing_for(rig, test):
        raise missing.error(rig)


def require_instruments(rig: Rig, test: TestName) -> None:
    """Raise FileError if readings of a test cannot be of a rig: of its arm, or of its gauges."""
    arm = missing_arm(rig) if gauges_needed(test) else ()
    for missing in (*arm, *missing_gauges(rig, test)):
        raise missing.error(rig)


def missing_arm(rig: Rig) -> Iterator[Missing]:
    """Yield why an arm cannot drive the tests of the ball link."""
    if (axes := len(rig.robot.axes)) != DRIVEN_AXES:
        problem = f"is an arm of {axes} axes, and circles, hemispheres and their programs are of {DRIVEN_AXES}"
        yield Missing("robot.axes", problem, "measure it by poses or touches: docs/any-arm.md")
    if rig.robot.rail:
        problem = "is an arm on a rail, and circles, hemispheres and their programs are of one that stands"
        yield Missing("robot.rail", problem, "measure it by poses or touches, or leave out robot.rail")

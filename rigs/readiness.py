"""Tests that a rig file can drive, and what the others lack. Every command checks it before it starts."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import TypeVar, get_args

from rigs.errors import FileError, RigPlace
from rigs.load import example_cell
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, DRIVEN_AXES, TEST_PARTS, DrivenTest, PartName, TestName

P = TypeVar("P")
_ADD_PART: dict[PartName, str] = {
    "circle": "add centre, posture and radius; rig circle fit --live --rig FILE --write determines them from a motion",
    "hemisphere": "add centre, posture and radius",
    "touch": "add touch: {sockets: [A, B]}",
    "iso9283": "add tests: {iso9283: {}}, and rig finds a suitable cube",
}


@dataclass(frozen=True)
class MissingEntry:
    """A part that a test needs and a rig file lacks. problem: text that follows the name of the file."""

    key: str
    problem: str
    remedy: str

    def error(self, rig: Rig) -> FileError:
        remedy = f"{cell_hint(rig)}{self.remedy}"
        return FileError(RigPlace.of(rig.name), self.problem, remedy, code="rig_file.invalid")


def cell_hint(rig: Rig) -> str:
    """First part of a remedy for someone who gave an arm but wants the shipped cell with it; otherwise empty."""
    cell = example_cell(rig)
    return f"for the shipped cell with this arm, give {cell}; otherwise " if cell else ""


def gauges_needed(test: TestName) -> tuple[str, ...]:
    if test in CIRCLES:
        return ("g1", "g2")
    return ("g1",) if test in get_args(DrivenTest) else ()


def missing_for(rig: Rig, test: TestName) -> tuple[MissingEntry, ...]:
    """Parts missing in a rig file for driving and measuring a test; none for a test of other packages."""
    arm = missing_arm(rig) if gauges_needed(test) else ()
    part = _missing_part(rig, TEST_PARTS[test]) if test in TEST_PARTS else ()
    return (*arm, *missing_gauges(rig, test), *part)


def missing_gauges(rig: Rig, test: TestName) -> tuple[MissingEntry, ...]:
    needed, present = gauges_needed(test), dict(rig.gauges)
    lacking = [name for name in needed if name not in present]
    if not lacking:
        return ()
    if not present:
        problem = f"has no gauges, which are needed for {', '.join(get_args(DrivenTest))}"
        return (MissingEntry("gauges", problem, "add gauges and feedback to the rig file"),)
    problem = f"has only one gauge, but {' and '.join(CIRCLES)} need two: an angle is the difference of two distances"
    return (MissingEntry("gauges.g2", problem, "add gauges.g2 with its interface, port and offset_mm"),)


def _missing_part(rig: Rig, part: PartName) -> Iterator[MissingEntry]:
    if getattr(rig.tests, part) is None:
        yield MissingEntry(f"tests.{part}", f"the rig file has no tests.{part}", _ADD_PART[part])


def require_part(rig: Rig, declared: P | None, part: PartName) -> P:
    if declared is None:
        raise next(_missing_part(rig, part)).error(rig)
    return declared


def unmeasurable(rig: Rig) -> tuple[MissingEntry, ...]:
    """Gauges missing for the declared tests; empty if the rig file has no gauges at all.

    Some gauges, but too few for a declared test, are a mistake in the file.
    """
    declared = [test for test, part in TEST_PARTS.items() if getattr(rig.tests, part) is not None]
    if not dict(rig.gauges):
        return ()
    return tuple(dict.fromkeys(missing for test in declared for missing in missing_gauges(rig, test)))


def readiness_lines(rig: Rig, unreachable: Collection[str] = ()) -> list[str]:
    """A line with what the file is ready for, and the missing parts with the tests that need them.

    unreachable: parts of `tests` with a path that the arm cannot drive.
    """
    lacks: dict[MissingEntry, list[str]] = {}
    for test in get_args(TestName):
        lacking = missing_for(rig, test)
        if not lacking and (part := TEST_PARTS.get(test)) in unreachable:
            lacking = (MissingEntry(f"tests.{part}", f"the arm cannot drive tests.{part}", "see the error below"),)
        for missing in lacking:
            lacks.setdefault(missing, []).append(test)
    lacking_tests = {test for tests in lacks.values() for test in tests}
    ready = ", ".join(test for test in get_args(TestName) if test not in lacking_tests)
    lines = [f"ready for: {f'{ready}; ' if ready else ''}tables of tracker poses and of touches (rig import)"]
    if not dict(rig.gauges) and not unreachable:
        parts = ", ".join(f"{missing.key} ({', '.join(tests)})" for missing, tests in lacks.items())
        return lines + [f"other tests need {parts} in the rig file"] * bool(parts)
    return lines + [
        f"not possible: {', '.join(tests)}: {missing.problem}; {missing.remedy}" for missing, tests in lacks.items()
    ]


def require_test(rig: Rig, test: TestName) -> None:
    for missing in missing_for(rig, test):
        raise missing.error(rig)


def require_instruments(rig: Rig, test: TestName) -> None:
    arm = missing_arm(rig) if gauges_needed(test) else ()
    for missing in (*arm, *missing_gauges(rig, test)):
        raise missing.error(rig)


def missing_arm(rig: Rig) -> Iterator[MissingEntry]:
    if (axes := len(rig.robot.axes)) != DRIVEN_AXES:
        problem = f"is an arm of {axes} axes, but circles, hemispheres and their programs need {DRIVEN_AXES}"
        yield MissingEntry("robot.axes", problem, "measure poses or touches: docs/any-arm.md")
    if rig.robot.rail:
        problem = "is an arm on a rail, but circles, hemispheres and their programs need a fixed arm"
        yield MissingEntry("robot.rail", problem, "measure poses or touches, or remove robot.rail")

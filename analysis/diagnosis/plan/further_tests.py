"""Further tests that separate effects: other tests of the rig file, circles with a different set-up, their cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, permutations
from operator import itemgetter
from typing import Any

import numpy as np

from analysis.diagnosis.evidence.blocks import Block, SharedBlock
from analysis.diagnosis.fit.candidates import HEALTHY, Level
from analysis.diagnosis.fit.responses import extend_linearisation
from analysis.diagnosis.judge.acts import Cost
from analysis.diagnosis.plan.expected import (
    ExpectedPosterior,
    planned_blocks,
    without_bands,
)
from analysis.procedures.shared.test_kind import labels_of
from analysis.robot.kinematics.arm import transform
from analysis.robot.predict import SetUps
from analysis.runs.tables import TESTS
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle, KnownSocketDistance
from rigs.schema.effect import phases, size_of
from rigs.schema.vocabulary import CIRCLES, TestName

# ----------------------------------------------------------------------------------------------------------------------
# Further tests: the other tests of the rig file, and circles with a different set-up.

_RADII_MM = (140.0, 50.0)
"""Radii of further circles. Chosen: twice the 70 mm of the paper's circle, and one possible for most arms."""
_NEAR = 0.2
"""Difference of the logarithms of two radii that count as equal. Chosen."""
_ASIDE_MM = 100.0
"""Displacement of the centre of a further circle. Chosen: it changes the posture by several degrees."""
FASTER = 4
"""Speed factor of a further circle. Chosen: time effects grow by the same factor."""
OFF_AXIS_MM = 40.0
"""Offset of the ball from axis 6 in a further circle. Chosen: a bracket of that length is easily made."""


_APART_MM = 100.0
"""Distance between two sockets measured in a further test. Chosen: suits a caliper."""


@dataclass(frozen=True)
class FurtherTest:
    """Further test. `choices`: rigs set up for it, each with a description; the first that can be driven is used."""

    tests: tuple[TestName, ...]
    why: str
    choices: tuple[tuple[str, Rig], ...]


def further_tests(rig: Rig, tests: Sequence[TestName]) -> list[FurtherTest]:
    """The tests that are not among `tests`, including set-ups outside the rig file."""
    missing: tuple[TestName, ...] = tuple(test for test in CIRCLES if test not in tests)
    further = []
    if missing and rig.tests.circle:
        words = f"{' and '.join(missing)} on the circle"
        further.append(FurtherTest(missing, "the tool's other tilt", ((words, rig),)))
    for test in TESTS:
        labels = labels_of(test)
        if labels.further and getattr(rig.tests, labels.part, None) and test not in tests:
            words, why = labels.further
            further.append(FurtherTest((test,), why, ((words, rig),)))
    if "touch" in tests and (touch := rig.tests.touch) and len(touch.sockets) > 1 and not touch.distances:
        between = touch.sockets[:2]
        apart = touch.model_copy(update={"distances": (KnownSocketDistance(between=between, distance_mm=_APART_MM),)})
        measured = rig.model_copy(update={"tests": rig.tests.model_copy(update={"touch": apart})})
        words = f"touch with a measured distance between {' and '.join(between)} (tests.touch.distances)"
        further.append(FurtherTest(("touch",), "touches alone do not show the scale of the arm", ((words, measured),)))
    # The first of equally useful tests is reported, so tests of the rig file precede new set-ups.
    return further + (_other_circles(rig, rig.tests.circle, tests) if rig.tests.circle else [])


def _other_circles(rig: Rig, circle: Circle, tests: Sequence[TestName]) -> list[FurtherTest]:
    circles: tuple[TestName, ...] = tuple(test for test in CIRCLES if test in tests) or CIRCLES
    nearby = places(rig, circle)
    further = []
    for radius in other_radii(circle):
        words = f"circle of radius {radius:g} mm"
        choices = [(words, with_circle(rig, circle, radius_mm=radius))]
        choices += [(f"{words}, {w}", with_circle(rig, circle, radius_mm=radius, centre_mm=at)) for w, at in nearby]
        further.append(
            FurtherTest(
                circles, "the effect of an angle grows with the radius, that of a length does not", tuple(choices)
            )
        )
    elsewhere = tuple((f"circle {words}", with_circle(rig, circle, centre_mm=at)) for words, at in nearby)
    further.append(FurtherTest(circles, "a different posture changes the effect of each joint and link", elsewhere))
    speed = FASTER * circle.speed_mm_s
    faster = ((f"circle at {speed:g} mm/s", with_circle(rig, circle, speed_mm_s=speed)),)
    further.append(
        FurtherTest(circles, "the effect of a delay grows with the speed, that of a play or a length does not", faster)
    )
    off_axis = ball_off_axis(rig)
    if off_axis:
        words = f"circle with the ball {OFF_AXIS_MM:g} mm off axis 6"
        further.append(FurtherTest(circles, "the ball moves when axis 6 turns", ((words, off_axis),)))
    return further


def other_radii(circle: Circle) -> tuple[float, ...]:
    return tuple(radius for radius in _RADII_MM if abs(np.log(radius / circle.radius_mm)) > _NEAR)


def ball_off_axis(rig: Rig) -> Rig | None:
    """A rig with the ball OFF_AXIS_MM away from axis 6, None if it already is."""
    x, y, z = rig.robot.tool.xyz_mm
    if np.hypot(x, y) >= OFF_AXIS_MM / 2:
        return None
    tool = rig.robot.tool.model_copy(update={"xyz_mm": (x + OFF_AXIS_MM, y, z)})
    return rig.model_copy(update={"robot": rig.robot.model_copy(update={"tool": tool})})


def with_circle(rig: Rig, circle: Circle, **changed: Any) -> Rig:
    tests = rig.tests.model_copy(update={"circle": circle.model_copy(update=changed)})
    return rig.model_copy(update={"tests": tests})


def places(rig: Rig, circle: Circle) -> list[tuple[str, tuple[float, ...]]]:
    """Displaced circle centres, each with a description: towards axis 1 and away, along it down and up."""
    T, centre = transform(rig.robot.base), np.array(circle.centre_mm)
    up, out = T[:3, 2], centre - T[:3, 3]
    out = out - (out @ up) * up
    out /= max(float(np.linalg.norm(out)), 1e-9)
    ways = {"nearer to axis 1": -out, "lower": -up, "further from axis 1": out, "higher": up}
    return [(f"{_ASIDE_MM:g} mm {words}", tuple((centre + _ASIDE_MM * way).tolist())) for words, way in ways.items()]


# ----------------------------------------------------------------------------------------------------------------------
# Further tests that separate names indistinguishable in the existing tests, tried with all set-ups possible for the
# arm.

_ELSEWHERE = " further"
"""Suffix of the set-ups of a further test, different from those of the existing runs."""


@dataclass(frozen=True)
class PossibleTest:
    """Further test, reason, expected posterior in combination with the existing runs, and cost."""

    test: str
    why: str
    expected: ExpectedPosterior
    cost: Cost
    is_other_kind: bool = False
    """Whether it measures a different quantity than the runs used, and not only at a different place or speed."""


def sigma_between(effect: Effect, rival: Effect) -> Callable[[PossibleTest], float]:
    """A function for the separation in sigmas of two effects at their sizes, whichever is present: an effect of size
    zero is not.
    """

    def sigma(test: PossibleTest) -> float:
        present = [(a, b) for a, b in permutations((effect, rival)) if size_of(a)]
        return min((test.expected.separation_sigma([a], phases(b)) for a, b in present), default=0.0)

    return sigma


def shortest(
    possible: Sequence[PossibleTest], sigma: Callable[[PossibleTest], float], enough: Callable[[float], bool]
) -> tuple[PossibleTest, float] | None:
    """The shortest test with a sufficient separation, and that separation; None if no test suffices.

    A simulation takes some seconds for a circle, so tests longer than the result are not simulated. Tests of a
    different kind come first, because an error outside the library may change the same kind in the same way.
    """

    def effort(test: PossibleTest) -> tuple[bool, float]:
        return not test.is_other_kind, test.cost.minutes or 0.0

    def measured(test: PossibleTest) -> tuple[PossibleTest, float]:
        sigmas = sigma(test)
        test.expected.release_columns()
        return test, sigmas

    for _, group in groupby(sorted(possible, key=effort), key=effort):
        best, sigmas = max(map(measured, group), key=itemgetter(1))
        if enough(sigmas):
            return best, sigmas
    return None


def possible_tests(
    rig: Rig,
    tests: Sequence[TestName],
    blocks: Sequence[Block],
    setups: SetUps,
    level: Level = HEALTHY,
    runs: int = 3,
    noise_share: float = 1.0,
) -> tuple[list[PossibleTest], list[tuple[str, str]]]:
    """Each further test that the arm can drive in addition to the existing blocks, and the undrivable tests with the
    reason.

    `noise_share`: ratio of the noise shown by the runs used to the assumed noise, as a standard deviation.
    """
    possible, impossible = [], []
    shared = [SharedBlock(block, (), setups[block.setup]) for block in without_bands(blocks)]
    for further in further_tests(rig, tests):
        refused = ""
        for words, moved in further.choices:
            try:
                added, places = planned_blocks(moved, further.tests, runs, _ELSEWHERE)
            except FileError as error:
                refused = refused or error.what
                continue
            added = [replace(block, sd_mm=noise_share * block.sd_mm) for block in added]
            expected = ExpectedPosterior(extend_linearisation(shared, without_bands(added), places), level)
            set_ups = len({block.setup for block in added})
            minutes = sum(block.count * float(np.ptp(block.path.t_s)) for block in added) / 60
            is_other = not set(further.tests) <= set(tests)
            possible.append(PossibleTest(words, further.why, expected, Cost(minutes, len(added), set_ups), is_other))
            break
        else:
            impossible.append((further.choices[0][0], refused))
    return possible, impossible

"""Test planning: prediction of effects that tests can detect and distinguish, and of useful further tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, permutations
from operator import itemgetter
from typing import Any

import numpy as np

from analysis.diagnosis.evidence.blocks import Block, SharedBlock
from analysis.diagnosis.fit.candidates import LARGEST_FAULT, Candidate
from analysis.diagnosis.fit.responses import extend_linearisation
from analysis.diagnosis.plan.expected import (
    DETECTABLE,
    SEPARABLE,
    ExpectedPosterior,
    expected_posterior,
    is_detectable,
    is_separable,
    planned_blocks,
    without_bands,
)
from analysis.procedures.facts import labels_of
from analysis.robot.kinematics.arm import Array, transform
from analysis.robot.model.predict import SetUp
from analysis.runs.parts_of_tests import TESTS
from rigs.effects import Effect, turned
from rigs.errors import FileError, UseError
from rigs.readiness import missing_for, require_test
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle, KnownSocketDistance
from rigs.schema.effect import healthy, healthy_size, label_of, name_of, phases, scaled, size_of
from rigs.schema.vocabulary import CIRCLES, TestName

# ----------------------------------------------------------------------------------------------------------------------
# Further tests: the other tests of the rig file, and circles with a different set-up.

_RADII_MM = (140.0, 50.0)
"""Radii of further circles. Chosen: twice the 70 mm of the paper's circle, and a smaller radius possible for most
arms.
"""
_NEAR = 0.2
"""Difference of the logarithms of two radii that count as equal. Chosen."""
_ASIDE_MM = 100.0
"""Displacement of the centre of a further circle. Chosen: enough to change the posture by several degrees on a
one-metre arm.
"""
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
    """Return the tests that are not among `tests`, including set-ups outside the rig file."""
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
    """Return the radii in mm of further circles different from a circle's."""
    return tuple(radius for radius in _RADII_MM if abs(np.log(radius / circle.radius_mm)) > _NEAR)


def ball_off_axis(rig: Rig) -> Rig | None:
    """Return a rig with the ball OFF_AXIS_MM away from axis 6, None if it already is."""
    x, y, z = rig.robot.tool.xyz_mm
    if np.hypot(x, y) >= OFF_AXIS_MM / 2:
        return None
    tool = rig.robot.tool.model_copy(update={"xyz_mm": (x + OFF_AXIS_MM, y, z)})
    return rig.model_copy(update={"robot": rig.robot.model_copy(update={"tool": tool})})


def with_circle(rig: Rig, circle: Circle, **changed: Any) -> Rig:
    """Return a rig with the circle changed."""
    tests = rig.tests.model_copy(update={"circle": circle.model_copy(update=changed)})
    return rig.model_copy(update={"tests": tests})


def places(rig: Rig, circle: Circle) -> list[tuple[str, tuple[float, ...]]]:
    """Return displaced circle centres, each with a description: towards axis 1 and away, along it down and up."""
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
class SeparatingTest:
    """Further test, separation in sigmas of the two closest rivals if combined with the existing tests, and reason."""

    test: str
    sigma: float
    why: str


@dataclass(frozen=True)
class PossibleTest:
    """Further test, reason, expected posterior in combination with the existing runs, and cost: minutes of driving,
    programs, and set-ups of ball and gauges.
    """

    test: str
    why: str
    expected: ExpectedPosterior
    minutes: float
    programs: int
    set_ups: int
    is_other_kind: bool = False
    """Whether it measures a different quantity than the runs used, and not only at a different place or speed."""


FurtherTests = Callable[[], tuple[list[PossibleTest], list[tuple[str, str]]]]
"""Function that returns the further tests possible for an arm, and the impossible tests with the reason; simulated
on demand.
"""


def sigma_between(effect: Effect, rival: Effect) -> Callable[[PossibleTest], float]:
    """Return a function for the separation in sigmas of two effects at their sizes, whichever is present: an effect
    of size zero is not.
    """

    def sigma(test: PossibleTest) -> float:
        present = [(a, b) for a, b in permutations((effect, rival)) if size_of(a)]
        return min((test.expected.separation_sigma([a], phases(b)) for a, b in present), default=0.0)

    return sigma


def shortest(
    possible: Sequence[PossibleTest], sigma: Callable[[PossibleTest], float], enough: Callable[[float], bool]
) -> tuple[PossibleTest, float] | None:
    """Return the shortest test with a sufficient separation, and the separation in sigmas; None if no test suffices.

    The complete simulation of a test takes some seconds for a circle, so tests longer than the result are not
    simulated. Tests of a different kind precede the same kind at a different place or speed, because an error outside
    the library may change the latter in the same way.
    """

    def effort(test: PossibleTest) -> tuple[bool, float]:
        return not test.is_other_kind, test.minutes

    for _, group in groupby(sorted(possible, key=effort), key=effort):
        best, sigmas = max(((test, sigma(test)) for test in group), key=itemgetter(1))
        if enough(sigmas):
            return best, sigmas
    return None


def possible_tests(
    rig: Rig,
    tests: Sequence[TestName],
    blocks: Sequence[Block],
    setups: Mapping[str, SetUp],
    level: float = 1.0,
    runs: int = 3,
    noise_share: float = 1.0,
) -> tuple[list[PossibleTest], list[tuple[str, str]]]:
    """Return each further test that the arm can drive in addition to the existing blocks, and the undrivable tests with
    the reason.

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
            possible.append(PossibleTest(words, further.why, expected, minutes, len(added), set_ups, is_other))
            break
        else:
            impossible.append((further.choices[0][0], refused))
    return possible, impossible


# ----------------------------------------------------------------------------------------------------------------------
# Detectability of one name in planned runs: expected uncertainty of its size, or the reason against detection.

_ON_AXIS = 0.02
"""Share of the largest response of a joint's zero below which the axis passes through the ball. Chosen: a ball
within 2 % of the reach.
"""
_NUDGE_DEG = 0.02
"""Joint rotation for comparing responses; only ratios matter."""
_OWN_SHARE = 0.02
"""Share of the response of an effect that no set-up absorbs, below which the set-up is reported as the reason.

Smaller shares are within the error of the linear approximation.
"""
_NOTHING = 1e-3
"""Sigmas below which a response counts as zero: well below any detection, and above rounding errors."""


@dataclass(frozen=True)
class Detectability:
    """Detectability of an effect.

    `effect`: at a healthy size. `sd`: standard uncertainty of a fault's size in the unit of the effect. `hidden`:
    reason against detection, or empty. `further`: tests by the sigmas of a healthy size.
    """

    name: str
    effect: Effect
    sd: float
    hidden: str
    further: tuple[SeparatingTest, ...] = ()

    @property
    def limit(self) -> float:
        """Size detected at 7 sigma, in the unit of the effect."""
        return DETECTABLE * self.sd


def detectabilities_of(expected: ExpectedPosterior) -> tuple[list[Candidate], list[Detectability]]:
    """Return the candidates representing each effect (for a gear by order, in the median form), and their
    detectabilities.
    """
    forms: dict[str, list[Candidate]] = {}
    for candidate in expected.candidates:
        forms.setdefault(label_of(candidate.effect), []).append(candidate)
    linear, chosen, detectabilities = expected.linear, [], []
    nudges = [turned(axis, _NUDGE_DEG) for axis in range(1, linear.axes + 1)]
    # sigmas of each joint's zero, for a known set-up
    zeros: Array = np.linalg.norm(linear.columns(nudges), axis=0)
    for label, candidates in forms.items():
        candidate = sorted(candidates, key=lambda form: form.size)[len(candidates) // 2]
        effect, sd, hidden = healthy(candidate.effect), expected.sd(candidate), ""
        if not is_detectable(sd):
            column, axis = linear.columns([effect])[:, 0], getattr(effect, "axis", None)
            whole, remaining = float(np.linalg.norm(column)), float(np.linalg.norm(linear.without_set_up(column)))
            if whole > _NOTHING and remaining < _OWN_SHARE * whole:
                terms = sorted({labels_of(block.table.test).setup for block in linear.blocks})
                hidden = f"absorbed by the set-up: {'; '.join(terms)}, which are always fitted"
            elif axis is not None and zeros[axis - 1] < _ON_AXIS * zeros.max():
                hidden = f"the ball lies on axis {axis}"
            elif LARGEST_FAULT * whole < _NOTHING:
                hidden = effect.idle
            elif LARGEST_FAULT * remaining < DETECTABLE:
                hidden = f"too small: below {DETECTABLE:g} sigma even at {LARGEST_FAULT:g} times the usual size"
            else:
                hidden = "hidden by the other effects of a healthy arm"
        chosen.append(candidate)
        detectabilities.append(Detectability(label, effect, sd * healthy_size(effect), hidden))
    return chosen, detectabilities


@dataclass(frozen=True)
class Detected:
    """Detectability of each effect, gears by order."""

    detectabilities: tuple[Detectability, ...]

    @property
    def names(self) -> dict[str, tuple[Detectability, ...]]:
        """Each effect with its detectabilities, for gears with an entry per order."""
        named: dict[str, tuple[Detectability, ...]] = {}
        for detectability in self.detectabilities:
            name = name_of(detectability.effect)
            named[name] = (*named.get(name, ()), detectability)
        return named

    @property
    def undetectable(self) -> tuple[str, ...]:
        """Effects never detected, at any gear order."""
        return tuple(name for name, forms in self.names.items() if all(form.hidden for form in forms))


# ----------------------------------------------------------------------------------------------------------------------
# Judgement of planned runs: detection limit of each name, and names that look alike.
#
# Two names look alike if one of them, at a detectable fault size, is so close to the other at some size that the odds
# dismiss neither.


@dataclass(frozen=True)
class ClosePair:
    """Closest forms of two effects at a detectable fault size, in healthy sizes, their separation in sigmas, and the
    number of other close forms of these effects.
    """

    candidates: tuple[Candidate, Candidate]
    sizes: tuple[float, float]
    sigma: float
    others: int = 0

    @property
    def names(self) -> tuple[str, str]:
        """The two effects."""
        first, second = self.candidates
        return first.name, second.name

    @property
    def first(self) -> tuple[Effect, ...]:
        """First effect of the pair at the given size."""
        return _at_size(self.candidates[0], self.sizes[0])

    @property
    def second(self) -> tuple[Effect, ...]:
        """Second effect of the pair at the given size."""
        return _at_size(self.candidates[1], self.sizes[1])


@dataclass(frozen=True)
class Judgement(Detected):
    """Capability of runs: detectability of each effect, and pairs that look alike, closest first."""

    pairs: tuple[ClosePair, ...]


def judged(expected: ExpectedPosterior) -> Judgement:
    """Return the judgement of an expected posterior."""
    chosen, detectabilities = detectabilities_of(expected)
    seen = [k for k, detectability in enumerate(detectabilities) if not detectability.hidden]
    sizes = [max(expected.least, detectabilities[k].limit / healthy_size(detectabilities[k].effect)) for k in seen]
    closest: dict[tuple[str, str], ClosePair] = {}
    for i, j in expected.close_pairs([chosen[k] for k in seen], np.array(sizes)):
        bare = ClosePair((chosen[seen[i]], chosen[seen[j]]), (sizes[i], sizes[j]), 0.0)
        pair = replace(bare, sigma=separation_sigma(expected, bare))
        if pair.sigma < SEPARABLE:
            earlier = closest.get(pair.names)
            nearer = pair if earlier is None or pair.sigma < earlier.sigma else earlier
            closest[pair.names] = replace(nearer, others=earlier.others + 1 if earlier else 0)
    return Judgement(tuple(detectabilities), tuple(sorted(closest.values(), key=lambda pair: pair.sigma)))


def separation_sigma(expected: ExpectedPosterior, pair: ClosePair) -> float:
    """Return the separation in sigmas of the two names of a pair, whichever is present."""
    first, second = pair.first, pair.second
    return min(expected.separation_sigma(first, second), expected.separation_sigma(second, first))


def _at_size(candidate: Candidate, size: float) -> tuple[Effect, ...]:
    return tuple(scaled(healthy(effect), size) for effect in candidate.effects)


# ----------------------------------------------------------------------------------------------------------------------
# Plan: effects that a set of tests can detect and distinguish, and further tests that separate names that look alike.


@dataclass(frozen=True)
class Pair:
    """Two effects that look alike. For a gear error, the order closest to the other effect counts.

    sigma: separation of a detectable fault from the other effect at any size. others: number of further orders that
    look alike. further: further tests that separate the two.
    """

    names: tuple[str, str]
    sigma: float
    others: int
    further: tuple[SeparatingTest, ...]


@dataclass(frozen=True)
class Gain:
    """Benefit of a further test: number of pairs it separates, and of undetectable effects it makes detectable."""

    test: str
    why: str
    parts: int
    shows: int


@dataclass(frozen=True, kw_only=True)
class CapabilityOfTests(Detected):
    """Capability of a set of tests.

    `gains`: further tests, most useful first. `impossible`: tests this arm cannot drive, each with the reason. `level`:
    of all other errors of the arm, 1 if usual.
    """

    tests: tuple[TestName, ...]
    runs: int
    groups: tuple[tuple[str, ...], ...]
    pairs: tuple[Pair, ...]
    gains: tuple[Gain, ...]
    impossible: tuple[tuple[str, str], ...]
    level: float = 1.0

    @property
    def hidden(self) -> tuple[Detectability, ...]:
        """Undetectable effects, with a separate entry per gear order."""
        return tuple(detectability for detectability in self.detectabilities if detectability.hidden)


def plan(rig: Rig, tests: Sequence[TestName], runs: int = 3, level: float = 1.0) -> CapabilityOfTests:
    """Return the capability of tests of a rig, each driven `runs` times in each direction.

    The prediction uses the model of a diagnosis: noise of real cells and a healthy background, at the `level` found by
    a diagnosis of the arm (`Diagnosis.level`), or 1 before measurements. The ball is off centre, by the rig file's
    eccentricity_mm if given. Raises FileError if the arm cannot drive a test.
    """
    blocks, setups = planned_blocks(rig, tests, runs)
    judgement = judged(expected_posterior(blocks, setups, level))
    possible, impossible = possible_tests(rig, tests, blocks, setups, level, runs=runs)
    further, gains = _further_tests(possible, judgement)
    # groups of names connected by pairs
    groups: list[list[str]] = []
    for pair in [pair.names for pair in judgement.pairs]:
        joined = [group for group in groups if set(group) & set(pair)]
        groups = [group for group in groups if group not in joined]
        groups.append(list(dict.fromkeys([name for group in joined for name in group] + list(pair))))
    return CapabilityOfTests(
        detectabilities=tuple(
            replace(detectability, further=further.get(name_of(detectability.effect), ()))
            for detectability in judgement.detectabilities
        ),
        tests=tuple(tests),
        runs=runs,
        groups=tuple(tuple(group) for group in groups),
        pairs=tuple(
            Pair((label_of(pair.first[0]), label_of(pair.second[0])), pair.sigma, pair.others, further[pair.names])
            for pair in judgement.pairs
        ),
        gains=gains,
        impossible=tuple(impossible),
        level=level,
    )


def tests_named(rig: Rig, names: str | None) -> tuple[TestName, ...]:
    """Return the tests of a comma-separated list, or, for None, the tests that the rig is set up for.

    Raises UseError for an unknown name, and FileError for a rig that is not set up for a named test, or for any test.
    """
    if names is None:
        at_targets = next(test for test in TESTS if labels_of(test).part == "hemisphere")
        offered: tuple[TestName, ...] = (*CIRCLES, at_targets)
        ready = tuple(test for test in offered if not missing_for(rig, test))
        if not ready and rig.tests.touch:
            return ("touch",)
        if not ready:
            require_test(rig, offered[0])
        return ready
    every: tuple[TestName, ...] = (*CIRCLES, *(test for test in TESTS if labels_of(test).further))
    asked = [name.strip() for name in names.split(",")]
    for name in asked:
        if name not in every:
            raise UseError("--tests", f"{name!r} is not a test", f"give some of {','.join(every)}")
    tests = tuple(name for name in every if name in asked)
    for test in tests:
        require_test(rig, test)
    return tests


def _further_tests(
    possible: Sequence[PossibleTest], judgement: Judgement
) -> tuple[dict[str | tuple[str, str], tuple[SeparatingTest, ...]], tuple[Gain, ...]]:
    """Return the further tests for each pair of effects and each undetectable effect, best first, and the benefit of
    each test, largest first.
    """
    hidden, near = judgement.undetectable, judgement.pairs
    asked: list[str | tuple[str, str]] = [*hidden, *(pair.names for pair in near)]
    further: dict[str | tuple[str, str], list[SeparatingTest]] = {key: [] for key in asked}
    gains = []
    for test in possible:
        sigma: dict[str | tuple[str, str], float] = {pair.names: separation_sigma(test.expected, pair) for pair in near}
        parted = sum(map(is_separable, sigma.values()))
        sds = {name: test.expected.sd_of_name(name) for name in hidden}
        gains.append(Gain(test.test, test.why, parted, sum(map(is_detectable, sds.values()))))
        sigma |= {name: 1 / sd for name, sd in sds.items()}
        for key, value in sigma.items():
            further[key].append(SeparatingTest(test.test, value, test.why))
    return (
        {key: tuple(sorted(tests, key=lambda test: -test.sigma)) for key, tests in further.items()},
        tuple(sorted(gains, key=lambda gain: -(gain.parts + gain.shows))),
    )

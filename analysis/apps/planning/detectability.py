"""Effects that planned tests can detect and distinguish, and useful further tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.evidence.significance import CERTAIN_SIGMA
from analysis.diagnosis.fit.candidates import LARGEST_FAULT, Candidate, Level
from analysis.diagnosis.fit.responses import Linearisation
from analysis.diagnosis.plan.expected import (
    SEPARABLE,
    ExpectedPosterior,
    expected_posterior,
    is_detectable,
    is_separable,
    planned_blocks,
)
from analysis.diagnosis.plan.further_tests import PossibleTest, possible_tests
from analysis.procedures.shared.test_kind import labels_of
from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.cell_noise import BALL_MM, JOINT_DEG, SLOW_MM, TARGET_MM, WHITE_MM
from analysis.runs.tables import TESTS
from rigs.effects import Effect, turned
from rigs.errors import UseError
from rigs.readiness import missing_for, require_test
from rigs.rig import Rig
from rigs.schema.effect import healthy, healthy_size, label_of, name_of, scaled
from rigs.schema.vocabulary import CIRCLES, TEST_WITHOUT_GAUGES, WITHOUT_GAUGES, TestName

# ----------------------------------------------------------------------------------------------------------------------
# Planned tests: names, and assumed noise.

_ASSUMED_UM = {
    "gauges, white": 1e3 * WHITE_MM.rms,
    "along a lap, slow": 1e3 * SLOW_MM.rms,
    "the ball, from run to run": 1e3 * BALL_MM.rms,
    "a target, from stop to stop": 1e3 * TARGET_MM.rms,
}
"""Assumed noise of planned runs, rms in µm of a run, from the ranges of `analysis.runs.noise.cell_noise`."""
ASSUMED_JOINT_DEG = JOINT_DEG.rms
"""Assumed scatter of each joint between planned runs, from the range of real cells."""


def assumed_noise_um(tests: Sequence[TestName]) -> dict[str, float]:
    if set(tests) <= set(WITHOUT_GAUGES):
        return {"a touch, each coordinate": 1e3 * TARGET_MM.rms}
    return _ASSUMED_UM


@dataclass(frozen=True)
class SeparatingTest:
    test: str
    sigma: float
    """Separation of the two closest rivals with this and the existing tests."""
    why: str


# ----------------------------------------------------------------------------------------------------------------------
# Detectability of one name in planned runs: expected uncertainty of its size, or the reason against detection.

_ON_AXIS = 0.02
"""Share of the largest response of a joint's zero below which the axis passes through the ball. Chosen."""
_NUDGE_DEG = 0.02
"""Joint rotation for comparing responses; only ratios matter."""
_OWN_SHARE = 0.02
"""Share of a response below which the set-up absorbs it: the error of the linear approximation."""
_NOTHING = 1e-3
"""Sigmas below which a response counts as zero, above rounding errors."""


@dataclass(frozen=True)
class Detectability:
    name: str
    effect: Effect
    """The effect at a healthy size."""
    sd: float
    """Standard uncertainty of a fault's size, in the unit of the effect."""
    hidden: str
    """Reason against detection, or empty."""
    further: tuple[SeparatingTest, ...] = ()
    """Further tests by the sigmas of a healthy size."""

    @property
    def limit(self) -> float:
        """Size detected at 7 sigma, in the unit of the effect."""
        return CERTAIN_SIGMA * self.sd


def detectabilities_of(expected: ExpectedPosterior) -> tuple[list[Candidate], list[Detectability]]:
    """Candidate of each effect (for a gear by order, in the median form), and its detectability."""
    forms: dict[str, list[Candidate]] = {}
    for candidate in expected.candidates:
        forms.setdefault(label_of(candidate.effect), []).append(candidate)
    nudges = [turned(axis, _NUDGE_DEG) for axis in range(1, expected.linear.axes + 1)]
    zeros: Array = np.linalg.norm(expected.linear.columns(nudges), axis=0)
    chosen, detectabilities = [], []
    for label, candidates in forms.items():
        candidate = sorted(candidates, key=lambda form: form.size)[len(candidates) // 2]
        effect, sd = healthy(candidate.effect), expected.sd(candidate)
        hidden = "" if is_detectable(sd) else _why_hidden(effect, expected.linear, zeros)
        chosen.append(candidate)
        detectabilities.append(Detectability(label, effect, sd * healthy_size(effect), hidden))
    return chosen, detectabilities


def _why_hidden(effect: Effect, linear: Linearisation, zeros: Array) -> str:
    """Why tests cannot detect an effect. zeros (axes,): sigmas of each joint's zero, for a known set-up."""
    column, axis = linear.columns([effect])[:, 0], getattr(effect, "axis", None)
    whole, remaining = float(np.linalg.norm(column)), float(np.linalg.norm(linear.without_set_up(column)))
    if whole > _NOTHING and remaining < _OWN_SHARE * whole:
        terms = sorted({labels_of(block.table.test).setup for block in linear.blocks})
        return f"absorbed by the set-up: {'; '.join(terms)}, which are always fitted"
    if axis is not None and zeros[axis - 1] < _ON_AXIS * zeros.max():
        return f"the ball lies on axis {axis}"
    if LARGEST_FAULT * whole < _NOTHING:
        return effect.idle
    if LARGEST_FAULT * remaining < CERTAIN_SIGMA:
        return f"too small: below {CERTAIN_SIGMA:g} sigma even at {LARGEST_FAULT:g} times the usual size"
    return "hidden by the other effects of a healthy arm"


# ----------------------------------------------------------------------------------------------------------------------
# Judgement of planned runs: detection limit of each name, and names that look alike.
#
# Two names look alike if one of them, at a detectable fault size, is so close to the other at some size that the odds
# dismiss neither.


@dataclass(frozen=True)
class ClosePair:
    """Closest forms of two effects at a detectable fault size."""

    candidates: tuple[Candidate, Candidate]
    sizes: tuple[float, float]
    """In healthy sizes."""
    sigma: float
    """Separation of the two."""
    others: int = 0
    """Number of other close forms of these effects."""
    further: tuple[SeparatingTest, ...] = ()

    @property
    def names(self) -> tuple[str, str]:
        first, second = self.candidates
        return first.name, second.name

    @property
    def effects(self) -> tuple[tuple[Effect, ...], tuple[Effect, ...]]:
        first, second = (
            tuple(scaled(healthy(effect), size) for effect in candidate.effects)
            for candidate, size in zip(self.candidates, self.sizes, strict=True)
        )
        return first, second

    @property
    def labels(self) -> tuple[str, str]:
        """The two effects, for a gear error with its order."""
        (first, *_), (second, *_) = self.effects
        return label_of(first), label_of(second)


@dataclass(frozen=True)
class Judgement:
    detectabilities: tuple[Detectability, ...]
    pairs: tuple[ClosePair, ...]
    """Pairs that look alike, closest first."""

    @property
    def names(self) -> dict[str, tuple[Detectability, ...]]:
        """Each effect with its detectabilities, for gears one per order."""
        named: dict[str, tuple[Detectability, ...]] = {}
        for detectability in self.detectabilities:
            name = name_of(detectability.effect)
            named[name] = (*named.get(name, ()), detectability)
        return named

    @property
    def undetectable(self) -> tuple[str, ...]:
        return tuple(name for name, forms in self.names.items() if all(form.hidden for form in forms))

    @property
    def groups(self) -> list[list[str]]:
        groups: list[list[str]] = []
        for names in [pair.names for pair in self.pairs]:
            joined = [group for group in groups if set(group) & set(names)]
            groups = [group for group in groups if group not in joined]
            groups.append(list(dict.fromkeys([name for group in joined for name in group] + list(names))))
        return groups


def judge_posterior(expected: ExpectedPosterior) -> Judgement:
    chosen, detectabilities = detectabilities_of(expected)
    pairs = zip(chosen, detectabilities, strict=True)
    seen = [(candidate, one) for candidate, one in pairs if not one.hidden]
    sizes = [max(expected.least(one.effect), one.limit / healthy_size(one.effect)) for _, one in seen]
    closest: dict[tuple[str, str], ClosePair] = {}
    for i, j in expected.close_pairs([candidate for candidate, _ in seen], np.array(sizes)):
        bare = ClosePair((seen[i][0], seen[j][0]), (sizes[i], sizes[j]), 0.0)
        pair = replace(bare, sigma=separation_sigma(expected, bare))
        if pair.sigma < SEPARABLE:
            earlier = closest.get(pair.names)
            nearer = pair if earlier is None or pair.sigma < earlier.sigma else earlier
            closest[pair.names] = replace(nearer, others=earlier.others + 1 if earlier else 0)
    return Judgement(tuple(detectabilities), tuple(sorted(closest.values(), key=lambda pair: pair.sigma)))


def separation_sigma(expected: ExpectedPosterior, pair: ClosePair) -> float:
    """Separation in sigmas of the two names of a pair, whichever is present."""
    first, second = pair.effects
    return min(expected.separation_sigma(first, second), expected.separation_sigma(second, first))


# ----------------------------------------------------------------------------------------------------------------------
# Plan: effects that a set of tests can detect and distinguish, and further tests that separate names that look alike.


@dataclass(frozen=True)
class Gain:
    test: str
    why: str
    parts: int
    """Number of pairs that it separates."""
    shows: int
    """Number of undetectable effects that it makes detectable."""


@dataclass(frozen=True, kw_only=True)
class CapabilityOfTests(Judgement):
    tests: tuple[TestName, ...]
    runs: int
    gains: tuple[Gain, ...]
    """Further tests, most useful first."""
    impossible: tuple[tuple[str, str], ...]
    """Other tests and the reasons against them."""
    level: float = 1.0
    """Size of all other errors of the arm, 1 if usual."""

    @property
    def hidden(self) -> tuple[Detectability, ...]:
        return tuple(detectability for detectability in self.detectabilities if detectability.hidden)


def plan(rig: Rig, tests: Sequence[TestName], runs: int = 3, level: float = 1.0) -> CapabilityOfTests:
    """Capability of tests of a rig, each driven `runs` times in each direction.

    It uses the model of a diagnosis: noise of real cells and a healthy background, at the `level` that a diagnosis of
    the arm found (`Diagnosis.levels`). Raises FileError if the arm cannot drive a test.
    """
    blocks, setups = planned_blocks(rig, tests, runs)
    judgement = judge_posterior(expected_posterior(blocks, setups, Level(level)))
    possible, impossible = possible_tests(rig, tests, blocks, setups, Level(level), runs=runs)
    further, gains = _further_tests(possible, judgement)
    return CapabilityOfTests(
        detectabilities=tuple(
            replace(detectability, further=further.get(name_of(detectability.effect), ()))
            for detectability in judgement.detectabilities
        ),
        pairs=tuple(replace(pair, further=further[pair.names]) for pair in judgement.pairs),
        tests=tuple(tests),
        runs=runs,
        gains=gains,
        impossible=tuple(impossible),
        level=level,
    )


def tests_named(rig: Rig, names: str | None) -> tuple[TestName, ...]:
    """Tests of a comma-separated list; for None those that the rig is set up for.

    Raises FileError for a rig that is not set up for a named test, or for any.
    """
    if names is None:
        at_targets = next(test for test in TESTS if labels_of(test).part == "hemisphere")
        offered: tuple[TestName, ...] = (*CIRCLES, at_targets)
        ready = tuple(test for test in offered if not missing_for(rig, test))
        if not ready and rig.tests.touch:
            return (TEST_WITHOUT_GAUGES["sockets"],)
        if not ready:
            require_test(rig, offered[0])
        return ready
    every: tuple[TestName, ...] = (*CIRCLES, *(test for test in TESTS if labels_of(test).further))
    asked = [name.strip() for name in names.split(",")]
    for name in asked:
        if name not in every:
            remedy = f"give some of {','.join(every)}"
            raise UseError("--tests", f"{name!r} is not a test", remedy, code="usage")
    tests = tuple(name for name in every if name in asked)
    for test in tests:
        require_test(rig, test)
    return tests


def _further_tests(
    possible: Sequence[PossibleTest], judgement: Judgement
) -> tuple[dict[str | tuple[str, str], tuple[SeparatingTest, ...]], tuple[Gain, ...]]:
    """Further tests for each pair and each undetectable effect, best first, and their benefits, largest first."""
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

"""Plan: effects that a set of tests can detect and distinguish, and tests that separate names that look alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from analysis.apps.planning.detectability import (
    Detectability,
    Judgement,
    SeparatingTest,
    judge_posterior,
    separation_sigma,
)
from analysis.diagnosis.fit.candidates import Level
from analysis.diagnosis.plan.expected import (
    expected_posterior,
    is_detectable,
    is_separable,
    planned_blocks,
)
from analysis.diagnosis.plan.further_tests import PossibleTest, possible_tests
from analysis.procedures.shared.test_kind import labels_of
from analysis.runs.tables import TESTS
from rigs.errors import UseError
from rigs.readiness import missing_for, require_test
from rigs.rig import Rig
from rigs.schema.effect import name_of
from rigs.schema.vocabulary import CIRCLES, TEST_WITHOUT_GAUGES, TestName


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
        test.expected.release_columns()
        for key, value in sigma.items():
            further[key].append(SeparatingTest(test.test, value, test.why))
    return (
        {key: tuple(sorted(tests, key=lambda test: -test.sigma)) for key, tests in further.items()},
        tuple(sorted(gains, key=lambda gain: -(gain.parts + gain.shows))),
    )

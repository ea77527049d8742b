"""Further tests that separate names which the existing tests cannot distinguish; each is tried with the set-ups that
the arm can drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.expected_posterior import ExpectedPosterior, expected_posterior
from analysis.diagnosis.further_tests import further_tests
from analysis.diagnosis.planned_runs import planned_blocks
from analysis.model.predict import SetUp
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import phases
from rigs.schema.vocabulary import TestName

_ELSEWHERE = " further"
"""Suffix of the set-ups of a further test, which differ from those of the existing runs."""


@dataclass(frozen=True)
class SeparatingTest:
    """A further test, the sigmas by which it separates the two closest of some rivals together with the existing tests,
    and the reason."""

    test: str
    sigma: float
    why: str


@dataclass(frozen=True)
class PossibleTest:
    """A further test, the reason why it may help, and the expected posterior of it together with the existing runs."""

    test: str
    why: str
    expected: ExpectedPosterior


def separating(possible: Sequence[PossibleTest], effects: Sequence[Effect]) -> tuple[SeparatingTest, ...]:
    """Return possible tests with the sigmas by which they separate the two closest of some effects at their sizes, the
    best first; empty for fewer than two effects."""
    pairs = list(permutations(effects, 2))
    found = [
        SeparatingTest(one.test, min(one.expected.separation_sigma([a], phases(b)) for a, b in pairs), one.why)
        for one in possible
        if pairs
    ]
    return best_first(found)


def possible_tests(
    rig: Rig,
    tests: Sequence[TestName],
    blocks: Sequence[Block],
    setups: Mapping[str, SetUp],
    level: float = 1.0,
    runs: int = 3,
) -> tuple[list[PossibleTest], list[tuple[str, str]]]:
    """Return each further test that the arm can drive, beside the existing blocks, and those that it cannot drive, with
    the reason."""
    found, impossible = [], []
    for further in further_tests(rig, tests):
        refused = ""
        for words, moved in further.choices:
            try:
                more, places = planned_blocks(moved, further.tests, runs, _ELSEWHERE)
            except FileError as error:
                refused = refused or error.what
                continue
            found.append(
                PossibleTest(words, further.why, expected_posterior([*blocks, *more], {**setups, **places}, level))
            )
            break
        else:
            impossible.append((further.choices[0][0], refused))
    return found, impossible


def best_first(found: Sequence[SeparatingTest]) -> tuple[SeparatingTest, ...]:
    """Return the tests ordered by the sigmas by which they separate."""
    return tuple(sorted(found, key=lambda one: -one.sigma))

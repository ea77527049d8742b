"""The plan: which effects a set of tests can detect and distinguish before anything is measured, and which further test
separates names that look alike.

Two names look alike if one of them, at a detectable fault size, is so close to the other at some size that the odds
between them dismiss neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.candidates import Candidate
from analysis.diagnosis.detectability import Detectability, by_name, detectabilities_of, undetectable
from analysis.diagnosis.expected_posterior import SEPARABLE, ExpectedPosterior, is_detectable, is_separable
from analysis.diagnosis.planned_runs import planned_blocks
from analysis.diagnosis.separating_tests import PossibleTest, SeparatingTest, best_first, possible_tests
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import healthy, healthy_size, label_of, name_of, scaled
from rigs.schema.vocabulary import CIRCLES, TestName


@dataclass(frozen=True)
class Pair:
    """Two names that look alike, for a gear with the order at which they are closest. `sigma` is the separation of one,
    as a detectable fault, from the other at any size; `others` counts the other orders that look alike too."""

    names: tuple[str, str]
    sigma: float
    others: int
    further: tuple[SeparatingTest, ...]


@dataclass(frozen=True)
class Gain:
    """What a further test adds: the number of pairs that it separates, and the number of undetectable names that it
    makes detectable."""

    test: str
    why: str
    parts: int
    shows: int


@dataclass(frozen=True)
class Plan:
    """What a set of tests can and cannot distinguish. `gains` lists further tests, the one that adds most first;
    `impossible` lists tests that this arm cannot drive, each with the reason."""

    tests: tuple[TestName, ...]
    runs: int
    detectabilities: tuple[Detectability, ...]
    groups: tuple[tuple[str, ...], ...]
    pairs: tuple[Pair, ...]
    gains: tuple[Gain, ...]
    impossible: tuple[tuple[str, str], ...]

    @property
    def hidden(self) -> tuple[Detectability, ...]:
        """What these tests cannot detect, with a separate entry for each order of a gear."""
        return tuple(one for one in self.detectabilities if one.hidden)

    @property
    def undetectable(self) -> tuple[str, ...]:
        """Names of which these tests detect nothing, at any order of a gear."""
        return undetectable(self.detectabilities)

    @property
    def names(self) -> dict[str, tuple[Detectability, ...]]:
        """Each name with its detectabilities: one, or one for each order of a gear."""
        return by_name(self.detectabilities)


def plan(rig: Rig, tests: Sequence[TestName], runs: int = 3) -> Plan:
    """Return what tests of a rig, each driven `runs` times in each direction, can and cannot distinguish.

    The prediction uses the model of a diagnosis: the noise of real cells and the same healthy background. The ball is
    off centre, by the rig file's eccentricity_mm where given. Raises FileError where the arm cannot drive a test.
    """
    blocks, setups = planned_blocks(rig, tests, runs)
    expected = ExpectedPosterior(blocks, setups)
    chosen, detectabilities = detectabilities_of(expected)
    near = _close_pairs(expected, chosen, detectabilities)
    possible, impossible = possible_tests(rig, tests, blocks, setups, runs=runs)
    further, gains = _further_tests(possible, near, undetectable(detectabilities))
    return Plan(
        tuple(tests),
        runs,
        tuple(replace(one, further=further.get(name_of(one.effect), ())) for one in detectabilities),
        _groups([(name_of(one.first[0]), name_of(one.second[0])) for one in near]),
        tuple(
            Pair((label_of(one.first[0]), label_of(one.second[0])), one.sigma, one.others, further[one.names])
            for one in near
        ),
        gains,
        tuple(impossible),
    )


def tests_named(rig: Rig, names: str | None) -> tuple[TestName, ...]:
    """Return the tests of a comma-separated list, or, for None, those that the rig is set up for. Raises FileError for
    an unknown name."""
    if names is None:
        circle: tuple[TestName, ...] = CIRCLES if rig.tests.circle else ()
        return (*circle, "radial") if rig.tests.hemisphere else circle or CIRCLES
    known: tuple[TestName, ...] = (*CIRCLES, "radial", "repeatability")
    asked = [name.strip() for name in names.split(",")]
    for name in asked:
        if name not in known:
            raise FileError("--tests", f"knows no {name!r}", f"give some of {','.join(known)}")
    return tuple(name for name in known if name in asked)


@dataclass(frozen=True)
class _ClosePair:
    """The closest forms of two names at a detectable fault size, their separation in sigmas, and the number of other
    forms of these names that are close too."""

    first: tuple[Effect, ...]
    second: tuple[Effect, ...]
    sigma: float
    others: int = 0

    @property
    def names(self) -> tuple[str, str]:
        return name_of(self.first[0]), name_of(self.second[0])


def _close_pairs(
    expected: ExpectedPosterior, chosen: Sequence[Candidate], detectabilities: Sequence[Detectability]
) -> list[_ClosePair]:
    """Return the pairs of names separated by less than SEPARABLE in either direction, the closest first. Orders of one
    gear are not rivals."""
    detectable = [k for k, one in enumerate(detectabilities) if not one.hidden]
    sizes = np.array(
        [max(expected.least, detectabilities[k].limit / healthy_size(detectabilities[k].effect)) for k in detectable]
    )
    faults = [
        tuple(scaled(healthy(effect), size) for effect in chosen[k].effects)
        for k, size in zip(detectable, sizes, strict=True)
    ]
    found: dict[tuple[str, str], _ClosePair] = {}
    for i, j in expected.close_pairs([chosen[k] for k in detectable], sizes):
        one = _ClosePair(faults[i], faults[j], _separation_sigma(expected, faults[i], faults[j]))
        if one.sigma < SEPARABLE:
            known = found.get(one.names)
            nearer = one if known is None or one.sigma < known.sigma else known
            found[one.names] = replace(nearer, others=known.others + 1 if known else 0)
    return sorted(found.values(), key=lambda one: one.sigma)


def _separation_sigma(expected: ExpectedPosterior, first: Sequence[Effect], second: Sequence[Effect]) -> float:
    """Return the sigmas by which two names are separated, whichever of them is present."""
    return min(expected.separation_sigma(first, second), expected.separation_sigma(second, first))


def _groups(pairs: Sequence[tuple[str, str]]) -> tuple[tuple[str, ...], ...]:
    """Return groups of names that are connected by pairs."""
    groups: list[list[str]] = []
    for pair in pairs:
        joined = [group for group in groups if set(group) & set(pair)]
        groups = [group for group in groups if group not in joined]
        groups.append(list(dict.fromkeys([name for group in joined for name in group] + list(pair))))
    return tuple(tuple(group) for group in groups)


def _further_tests(
    possible: Sequence[PossibleTest], near: Sequence[_ClosePair], hidden: Sequence[str]
) -> tuple[dict[str | tuple[str, str], tuple[SeparatingTest, ...]], tuple[Gain, ...]]:
    """Return the further tests for each pair of names and for each undetectable name, the best first, and what each
    test gains, the most first."""
    asked: list[str | tuple[str, str]] = [*hidden, *(one.names for one in near)]
    further: dict[str | tuple[str, str], list[SeparatingTest]] = {one: [] for one in asked}
    gains = []
    for one in possible:
        sigma: dict[str | tuple[str, str], float] = {
            pair.names: _separation_sigma(one.expected, pair.first, pair.second) for pair in near
        }
        parted = sum(map(is_separable, sigma.values()))
        sds = {name: one.expected.sd_of_name(name) for name in hidden}
        gains.append(Gain(one.test, one.why, parted, sum(map(is_detectable, sds.values()))))
        sigma |= {name: 1 / sd for name, sd in sds.items()}
        for what, own in sigma.items():
            further[what].append(SeparatingTest(one.test, own, one.why))
    return (
        {what: best_first(found) for what, found in further.items()},
        tuple(sorted(gains, key=lambda gain: -(gain.parts + gain.shows))),
    )

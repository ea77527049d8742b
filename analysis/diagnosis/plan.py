"""The plan: which effects a set of tests can detect and distinguish before anything is measured, and which further test
separates names that look alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from analysis.diagnosis.detectability import Detectability, by_name, undetectable
from analysis.diagnosis.expected_posterior import expected_posterior
from analysis.diagnosis.form_posterior import is_detectable, is_separable
from analysis.diagnosis.judgement import Judgement, judged, separation_sigma
from analysis.diagnosis.planned_runs import planned_blocks
from analysis.diagnosis.separating_tests import PossibleTest, SeparatingTest, best_first, possible_tests
from rigs.errors import UseError
from rigs.rig import Rig
from rigs.schema.effect import label_of, name_of
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
    judgement = judged(expected_posterior(blocks, setups))
    possible, impossible = possible_tests(rig, tests, blocks, setups, runs=runs)
    further, gains = _further_tests(possible, judgement)
    return Plan(
        tuple(tests),
        runs,
        tuple(replace(one, further=further.get(name_of(one.effect), ())) for one in judgement.detectabilities),
        _groups([one.names for one in judgement.pairs]),
        tuple(
            Pair((label_of(one.first[0]), label_of(one.second[0])), one.sigma, one.others, further[one.names])
            for one in judgement.pairs
        ),
        gains,
        tuple(impossible),
    )


def tests_named(rig: Rig, names: str | None) -> tuple[TestName, ...]:
    """Return the tests of a comma-separated list, or, for None, those that the rig is set up for. Raises UseError for
    an unknown name."""
    if names is None:
        circle: tuple[TestName, ...] = CIRCLES if rig.tests.circle else ()
        return (*circle, "radial") if rig.tests.hemisphere else circle or CIRCLES
    known: tuple[TestName, ...] = (*CIRCLES, "radial", "repeatability")
    asked = [name.strip() for name in names.split(",")]
    for name in asked:
        if name not in known:
            raise UseError("--tests", f"{name!r} is not a test", f"give one or more of {','.join(known)}")
    return tuple(name for name in known if name in asked)


def _groups(pairs: Sequence[tuple[str, str]]) -> tuple[tuple[str, ...], ...]:
    """Return groups of names that are connected by pairs."""
    groups: list[list[str]] = []
    for pair in pairs:
        joined = [group for group in groups if set(group) & set(pair)]
        groups = [group for group in groups if group not in joined]
        groups.append(list(dict.fromkeys([name for group in joined for name in group] + list(pair))))
    return tuple(tuple(group) for group in groups)


def _further_tests(
    possible: Sequence[PossibleTest], judgement: Judgement
) -> tuple[dict[str | tuple[str, str], tuple[SeparatingTest, ...]], tuple[Gain, ...]]:
    """Return the further tests for each pair of names and for each undetectable name, the best first, and what each
    test gains, the most first."""
    hidden, near = judgement.undetectable, judgement.pairs
    asked: list[str | tuple[str, str]] = [*hidden, *(one.names for one in near)]
    further: dict[str | tuple[str, str], list[SeparatingTest]] = {one: [] for one in asked}
    gains = []
    for one in possible:
        sigma: dict[str | tuple[str, str], float] = {pair.names: separation_sigma(one.expected, pair) for pair in near}
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

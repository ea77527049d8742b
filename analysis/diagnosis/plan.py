"""What tests can and cannot tell apart, before anything is measured, and which further test parts what is alike.

Two names are alike where one, a fault that shows, is so near to what the other can do at any size that the odds between
them leave both standing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.candidates import Candidate
from analysis.diagnosis.foresight import ALIKE, Foresight, parts, shows
from analysis.diagnosis.parting import Beside, Parting, beside, best_first
from analysis.diagnosis.planned import planned
from analysis.diagnosis.sights import Sight, by_name, sights_of, unseen
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import healthy, healthy_size, label_of, name_of, scaled
from rigs.schema.vocabulary import CIRCLES, TestName


@dataclass(frozen=True)
class Pair:
    """Two names that are alike, a gear with the order at which it is most. sigma: by which one, a fault that shows, is
    parted from the other at any size; others: how many other orders of them are alike too."""

    names: tuple[str, str]
    sigma: float
    others: int
    further: tuple[Parting, ...]


@dataclass(frozen=True)
class Gain:
    """What a further test adds: how many of the pairs that are alike it parts, how many of the names that show nowhere
    it shows."""

    test: str
    why: str
    parts: int
    shows: int


@dataclass(frozen=True)
class Plan:
    """What tests can and cannot tell apart. gains: of further tests, the one that adds most first; impossible: tests
    that this arm cannot drive, each with the reason."""

    tests: tuple[TestName, ...]
    runs: int
    sights: tuple[Sight, ...]
    groups: tuple[tuple[str, ...], ...]
    pairs: tuple[Pair, ...]
    gains: tuple[Gain, ...]
    impossible: tuple[tuple[str, str], ...]

    @property
    def hidden(self) -> tuple[Sight, ...]:
        """What these tests cannot show, each order of a gear for itself."""
        return tuple(sight for sight in self.sights if sight.hidden)

    @property
    def unseen(self) -> tuple[str, ...]:
        """Names of which these tests show nothing, no order of a gear."""
        return unseen(self.sights)

    @property
    def names(self) -> dict[str, tuple[Sight, ...]]:
        """Each name with its sights: one, or those of the orders of a gear."""
        return by_name(self.sights)


def plan(rig: Rig, tests: Sequence[TestName], runs: int = 3) -> Plan:
    """What tests of a rig, each driven `runs` times in each direction, can and cannot tell apart.

    It is foreseen by the law of a diagnosis: the same noise, as wide as real cells have it, and the same healthy
    background. The ball is off centre, where given by the rig file's eccentricity_mm. Raises FileError where the arm
    cannot do a test.
    """
    blocks, setups = planned(rig, tests, runs)
    foresight = Foresight(blocks, setups)
    chosen, sights = sights_of(foresight)
    near = _alike(foresight, chosen, sights)
    possible, impossible = beside(rig, tests, blocks, setups, runs=runs)
    further, gains = _helps(possible, near, unseen(sights))
    return Plan(
        tuple(tests),
        runs,
        tuple(replace(sight, further=further.get(name_of(sight.effect), ())) for sight in sights),
        _groups([(name_of(one.first[0]), name_of(one.second[0])) for one in near]),
        tuple(
            Pair((label_of(one.first[0]), label_of(one.second[0])), one.sigma, one.others, further[one.names])
            for one in near
        ),
        gains,
        tuple(impossible),
    )


def tests_named(rig: Rig, names: str | None) -> tuple[TestName, ...]:
    """Tests by their names with commas, None for those the rig is set up for. Raises FileError for an unknown one."""
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
class _Near:
    """The nearest forms of two names, at a size at which each shows as a fault; how near, and how many other forms of
    these names are near too."""

    first: tuple[Effect, ...]
    second: tuple[Effect, ...]
    sigma: float
    others: int = 0

    @property
    def names(self) -> tuple[str, str]:
        return name_of(self.first[0]), name_of(self.second[0])


def _alike(foresight: Foresight, chosen: Sequence[Candidate], sights: Sequence[Sight]) -> list[_Near]:
    """Pairs of names nearer than ALIKE either way, the nearest first. Orders of one gear are not rivals."""
    seen = [k for k, sight in enumerate(sights) if not sight.hidden]
    sizes = np.array([max(foresight.least, sights[k].limit / healthy_size(sights[k].effect)) for k in seen])
    faults = [
        tuple(scaled(healthy(effect), size) for effect in chosen[k].effects)
        for k, size in zip(seen, sizes, strict=True)
    ]
    found: dict[tuple[str, str], _Near] = {}
    for i, j in foresight.near([chosen[k] for k in seen], sizes):
        one = _Near(faults[i], faults[j], _apart(foresight, faults[i], faults[j]))
        if one.sigma < ALIKE:
            known = found.get(one.names)
            nearer = one if known is None or one.sigma < known.sigma else known
            found[one.names] = replace(nearer, others=known.others + 1 if known else 0)
    return sorted(found.values(), key=lambda one: one.sigma)


def _apart(foresight: Foresight, first: Sequence[Effect], second: Sequence[Effect]) -> float:
    """Sigmas by which two names are parted, whichever of them is there."""
    return min(foresight.apart(first, second), foresight.apart(second, first))


def _groups(pairs: Sequence[tuple[str, str]]) -> tuple[tuple[str, ...], ...]:
    """Names that hang together by pairs."""
    groups: list[list[str]] = []
    for pair in pairs:
        joined = [group for group in groups if set(group) & set(pair)]
        groups = [group for group in groups if group not in joined]
        groups.append(list(dict.fromkeys([name for group in joined for name in group] + list(pair))))
    return tuple(tuple(group) for group in groups)


def _helps(
    possible: Sequence[Beside], near: Sequence[_Near], hidden: Sequence[str]
) -> tuple[dict[str | tuple[str, str], tuple[Parting, ...]], tuple[Gain, ...]]:
    """What further tests do for each pair of names and for each name that is hidden, best first; and what each test
    gains, the most first."""
    asked: list[str | tuple[str, str]] = [*hidden, *(one.names for one in near)]
    further: dict[str | tuple[str, str], list[Parting]] = {one: [] for one in asked}
    gains = []
    for one in possible:
        sigma: dict[str | tuple[str, str], float] = {
            pair.names: _apart(one.foresight, pair.first, pair.second) for pair in near
        }
        parted = sum(map(parts, sigma.values()))
        sds = {name: one.foresight.sd_of_name(name) for name in hidden}
        gains.append(Gain(one.test, one.why, parted, sum(map(shows, sds.values()))))
        sigma |= {name: 1 / sd for name, sd in sds.items()}
        for what, own in sigma.items():
            further[what].append(Parting(one.test, own, one.why))
    return (
        {what: best_first(found) for what, found in further.items()},
        tuple(sorted(gains, key=lambda gain: -(gain.parts + gain.shows))),
    )

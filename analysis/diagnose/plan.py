"""What tests can and cannot tell apart, before anything is measured, and which further test parts what is alike.

Two names are alike where one, at a plausible size, is so near to what the other can do at any size that the odds
between them leave both standing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnose.candidates import Candidate, candidates_for
from analysis.diagnose.parting import Answer, Parting, answers, best_first
from analysis.diagnose.sights import Sight, by_name, sights_of, unseen
from analysis.diagnose.signatures import ALIKE, DETECTABLE, NOTHING, Signatures, View, parts, shows
from analysis.kinematics.arm import Array
from rigs.effect import label_of, name_of
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.vocabulary import CIRCLES, TestName


@dataclass(frozen=True)
class Pair:
    """Two names that are alike, a gear with the order at which it is most. sigma: by which one, at a plausible size, is
    parted from the other at any; others: how many other forms of them (orders, widths) are alike too."""

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

    Noise and scatter are assumed as wide as real cells have them; the ball is off centre, where given by the rig file's
    eccentricity_mm. The plausible size of an effect is a healthy arm's, or that of 7 sigma where this is larger. Raises
    FileError where the arm cannot do a test.
    """
    view = View(rig, tests, runs)
    candidates = candidates_for(view.linear)
    signatures = Signatures([one.effects for one in candidates], np.array([one.size for one in candidates]))
    products = signatures.products(view)
    sigma = signatures.lengths(products)
    sights = sights_of(candidates, sigma, view)
    alike = _alike(candidates, signatures.apart(products, np.maximum(sigma, DETECTABLE)), sigma)
    hidden = [sight for sight in sights if sight.hidden]

    rivals = [candidates[k] for near in alike.values() for k in near.candidates]
    forms = [one.effects for one in rivals] + [(sight.effect,) for sight in hidden]
    asked = Signatures(forms, np.array([one.size for one in rivals] + [1.0] * len(hidden)))
    known = asked.products(view)
    possible, impossible = answers(rig, tests, runs, asked)
    nowhere = unseen(sights)
    names = [name_of(sight.effect) for sight in hidden]
    further, gains = _helps(possible, asked, known, [name if name in nowhere else "" for name in names])
    helped = iter(further[len(alike) :])
    return Plan(
        tuple(tests),
        runs,
        tuple(replace(sight, further=next(helped)) if sight.hidden else sight for sight in sights),
        _groups(list(alike)),
        tuple(_pair(near, candidates, found) for near, found in zip(alike.values(), further, strict=False)),
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
    """Two candidates by number, the nearest of two names; how near, and how many others of these names are too."""

    sigma: float
    candidates: tuple[int, int]
    others: int


def _alike(candidates: Sequence[Candidate], apart: Array, sigma: Array) -> dict[tuple[str, str], _Near]:
    """Pairs of names nearer than ALIKE either way. Orders of one gear are no rivals of each other."""
    seen = np.array([shows(one) for one in sigma])
    near = np.minimum(apart, apart.T)
    alike: dict[tuple[str, str], _Near] = {}
    places = np.argwhere(np.triu(near < ALIKE, 1) & np.outer(seen, seen))
    for i, j in places[np.argsort(near[tuple(places.T)])].tolist():
        names = candidates[i].name, candidates[j].name
        first = alike.get(names)
        if first:
            alike[names] = replace(first, others=first.others + 1)
        elif names[0] != names[1]:
            alike[names] = _Near(float(near[i, j]), (i, j), 0)
    return alike


def _pair(near: _Near, candidates: Sequence[Candidate], further: tuple[Parting, ...]) -> Pair:
    first, second = (label_of(candidates[k].effect) for k in near.candidates)
    return Pair((first, second), near.sigma, near.others, further)


def _groups(pairs: Sequence[tuple[str, str]]) -> tuple[tuple[str, ...], ...]:
    """Names that hang together by pairs."""
    groups: list[list[str]] = []
    for pair in pairs:
        joined = [group for group in groups if set(group) & set(pair)]
        groups = [group for group in groups if group not in joined]
        groups.append(list(dict.fromkeys([name for group in joined for name in group] + list(pair))))
    return tuple(tuple(group) for group in groups)


def _helps(
    answers: Sequence[Answer], asked: Signatures, known: Array, hidden: Sequence[str]
) -> tuple[list[tuple[Parting, ...]], tuple[Gain, ...]]:
    """What further tests do for the items asked: both of each pair first, then the hidden ones, by their names where
    these show nowhere else. Returns for each pair and each hidden one the tests, best first; and what each test gains,
    the most first."""
    plausible = np.maximum(1.0, DETECTABLE / np.maximum(asked.lengths(known), NOTHING))
    items = len(plausible) - len(hidden)
    gains = []
    further: list[list[Parting]] = []
    for answer in answers:
        length = asked.lengths(known + answer.products)
        apart = asked.apart(known + answer.products, length * plausible)
        parted = [float(min(apart[k, k + 1], apart[k + 1, k])) for k in range(0, items, 2)]
        shown = length[items:].tolist()
        further.append([Parting(answer.test, sigma, answer.why) for sigma in (*parted, *shown)])
        names = {name for name, sigma in zip(hidden, shown, strict=True) if name and shows(sigma)}
        gains.append(Gain(answer.test, answer.why, sum(map(parts, parted)), len(names)))
    questions = range(items // 2 + len(hidden))
    return (
        [best_first([of_test[k] for of_test in further]) for k in questions],
        tuple(sorted(gains, key=lambda gain: -(gain.parts + gain.shows))),
    )

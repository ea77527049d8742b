"""Which further test parts what the tests there are cannot: each tried as far as the arm can drive it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.foresight import Foresight
from analysis.diagnosis.further import further_tests
from analysis.diagnosis.planned import planned
from analysis.model.predict import SetUp
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import phases
from rigs.schema.vocabulary import TestName

_ELSEWHERE = " further"
"""Set-ups of a further test are not those of the runs there are."""


@dataclass(frozen=True)
class Parting:
    """A further test in words, the sigma by which it, beside the tests there are, parts the two nearest of some rivals,
    and why it does."""

    test: str
    sigma: float
    why: str


@dataclass(frozen=True)
class Beside:
    """A further test in words, why it may help, and what is foreseen of it and of the runs there are together."""

    test: str
    why: str
    foresight: Foresight


def parting(
    rig: Rig,
    effects: Sequence[Effect],
    tests: Sequence[TestName],
    blocks: Sequence[Block],
    setups: Mapping[str, SetUp],
    level: float = 1.0,
    runs: int = 3,
) -> tuple[Parting, ...]:
    """For rival effects at their sizes, each possible further test with the sigma by which it parts the two nearest.

    tests, blocks, setups: those there are already; a further test is taken as driven `runs` times in each direction.
    Best first; empty for fewer than two effects.
    """
    if len(effects) < 2:
        return ()
    found = [
        Parting(one.test, min(one.foresight.apart([a], phases(b)) for a, b in permutations(effects, 2)), one.why)
        for one in beside(rig, tests, blocks, setups, level, runs)[0]
    ]
    return best_first(found)


def beside(
    rig: Rig,
    tests: Sequence[TestName],
    blocks: Sequence[Block],
    setups: Mapping[str, SetUp],
    level: float = 1.0,
    runs: int = 3,
) -> tuple[list[Beside], list[tuple[str, str]]]:
    """Each further test that the arm can drive, beside the blocks there are; and those that it cannot, with the
    reason."""
    found, impossible = [], []
    for further in further_tests(rig, tests):
        refused = ""
        for words, moved in further.choices:
            try:
                more, places = planned(moved, further.tests, runs, _ELSEWHERE)
            except FileError as error:
                refused = refused or error.what
                continue
            found.append(Beside(words, further.why, Foresight([*blocks, *more], {**setups, **places}, level)))
            break
        else:
            impossible.append((further.choices[0][0], refused))
    return found, impossible


def best_first(found: Sequence[Parting]) -> tuple[Parting, ...]:
    """By how much they part."""
    return tuple(sorted(found, key=lambda one: -one.sigma))

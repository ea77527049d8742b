"""Which further test parts what the tests there are cannot: each tried as far as the arm can drive it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from analysis.diagnose.further import further_tests
from analysis.diagnose.signatures import Signatures, View
from analysis.kinematics.arm import Array
from rigs.effect import is_play, phases, scaled
from rigs.effects import Effect, healthy_size, size_field
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.vocabulary import TestName

_SMALL = 1e-3
"""Of a healthy size: signatures of rivals are taken there."""


@dataclass(frozen=True)
class Parting:
    """A further test in words, the sigma by which it, beside the tests there are, parts the two nearest of some rivals,
    and why it does."""

    test: str
    sigma: float
    why: str


def parting(rig: Rig, effects: Sequence[Effect], tests: Sequence[TestName], runs: int = 3) -> list[Parting]:
    """For rival effects at their sizes, each possible further test with the sigma by which it parts the two nearest.

    tests: those there are already, a pose test left out, for it has no program; all are taken as driven `runs` times in
    each direction. Best first; empty for fewer than two effects. Raises FileError where the arm cannot do `tests`.
    """
    if len(effects) < 2:
        return []
    asked = Signatures(
        [phases(scaled(effect, _smaller(effect))) for effect in effects], np.array([_smaller(one) for one in effects])
    )
    programmed = [test for test in tests if test != "pose"]
    known = asked.products(View(rig, programmed, runs)) if programmed else np.array(0.0)
    found = []
    for answer in answers(rig, tests, runs, asked)[0]:
        products = known + answer.products
        apart = asked.apart(products, asked.lengths(products))
        nearest = min(float(apart[i, j]) for i, j in permutations(range(len(effects)), 2))
        found.append(Parting(answer.test, nearest, answer.why))
    return list(best_first(found))


@dataclass(frozen=True)
class Answer:
    """A further test in words, why it may help, and the products (p, p) of what is asked in it."""

    test: str
    why: str
    products: Array


def answers(
    rig: Rig, tests: Sequence[TestName], runs: int, asked: Signatures
) -> tuple[list[Answer], list[tuple[str, str]]]:
    """Of each further test that the arm can drive, what it shows; and those that it cannot, with the reason."""
    found, impossible = [], []
    for further in further_tests(rig, tests):
        refused = ""
        for words, moved in further.choices:
            try:
                view = View(moved, further.tests, runs)
            except FileError as error:
                refused = refused or error.what
                continue
            found.append(Answer(words, further.why, asked.products(view)))
            break
        else:
            impossible.append((further.choices[0][0], refused))
    return found, impossible


def best_first(found: Sequence[Parting]) -> tuple[Parting, ...]:
    """By how much they part."""
    return tuple(sorted(found, key=lambda one: -one.sigma))


def _smaller(effect: Effect) -> float:
    """The share of an effect that is so small that its signature is straight; the set-up would take up what bends of a
    large one. A play is not twice itself, and stays."""
    size: float = abs(getattr(effect, size_field(effect)))
    return 1.0 if is_play(effect) or size == 0 else _SMALL * healthy_size(effect) / size

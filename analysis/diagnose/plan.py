"""What a set of tests can and cannot tell apart, before anything is measured, and which further test parts what is alike.

The tests are simulated without noise; each effect's signature is whitened by the assumed noise, less what the set-up could
do as well. Two names are alike where one, at a plausible size, stands nearer than 20 to 1 to what the other can do at
any size. A further test has a set-up of its own, so that products of signatures simply add: those of the tests planned
and those of the further one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.diagnose.blocks import blocks_of
from analysis.diagnose.candidates import Candidate, candidates_for, name_of
from analysis.diagnose.evidence import DETECTABLE, one_sided
from analysis.diagnose.further import Further, further_tests
from analysis.diagnose.linear import Linear
from analysis.fitting.estimate import Fit
from analysis.fitting.observation import Observation, observe
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp, model_of, nominal_setup
from analysis.model.programs import circle_of
from analysis.model.simulate import simulate
from analysis.reading.tables import CircleTable, Table
from rigs.effects import Effect, JointOffset, healthy_size, size_field
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.vocabulary import Direction, TestName

ALIKE = float(np.sqrt(2 * np.log(20)))
"""Sigmas below which the odds between two names stay within 20 to 1."""
LARGEST = 25.0
"""Healthy sizes at which an effect must at least be seen; a larger one would be no small error of an arm."""
_OWN_SHARE = 0.02
"""Of a signature that no set-up term can do; less is what straight lines leave of a circle."""
_NOTHING = 1e-3
"""Sigmas at 25 healthy sizes that are none."""
_ON_AXIS = 0.02
"""An axis that moves the readings by less than this share of what the strongest does goes through the ball."""
_IDLE = {
    "backlash": "axis {axis} does not turn back",
    "reversal_spike": "axis {axis} does not turn back",
    "compliance": "gravity does not load axis {axis}",
    "link_bending": "gravity does not bend the link of axis {axis} here",
}


@dataclass(frozen=True)
class Parting:
    """A further test in words, the sigma by which it, with the planned ones, parts the two nearest of some effects, and
    why it may."""

    test: str
    sigma: float
    why: str


@dataclass(frozen=True)
class Sight:
    """How one name shows. effect: at a healthy size; sigma: of that; limit: the size that shows at 7 sigma, in the
    effect's own unit; hidden: why it cannot be seen, empty where it can; further: the tests that would show it, with the
    sigmas of a healthy size, best first."""

    name: str
    effect: Effect
    sigma: float
    limit: float
    hidden: str
    further: tuple[Parting, ...] = ()


@dataclass(frozen=True)
class Pair:
    """Two names that are alike, at the sizes (own unit) that were compared; further: tests that part them, best first."""

    names: tuple[str, str]
    sizes: tuple[float, float]
    sigma: float
    further: tuple[Parting, ...]


@dataclass(frozen=True)
class Gain:
    """What a further test adds: pairs it parts, of how many; names it shows that were hidden, of how many."""

    test: str
    why: str
    parts: int
    shows: int


@dataclass(frozen=True)
class Plan:
    """What tests can and cannot tell apart. gains: of further tests, the one that adds the most first; impossible: tests
    that this arm cannot drive, with the reason."""

    tests: tuple[TestName, ...]
    runs: int
    sights: tuple[Sight, ...]
    groups: tuple[tuple[str, ...], ...]
    pairs: tuple[Pair, ...]
    gains: tuple[Gain, ...]
    impossible: tuple[tuple[str, str], ...]

    @property
    def hidden(self) -> tuple[Sight, ...]:
        """The names that these tests cannot show."""
        return tuple(sight for sight in self.sights if sight.hidden)


def parting(rig: Rig, effects: Sequence[Effect], tests: Sequence[TestName], runs: int = 3) -> list[Parting]:
    """For rival effects at their sizes, each possible further test with the sigma by which it parts the two nearest.

    tests: planned or driven already, each `runs` times in each direction; best first. Raises FileError where the arm
    cannot do them.
    """
    forms = [_forms(effect) for effect in effects]
    columns = _Columns(forms, np.ones(len(forms)))
    known = columns.products(_View(rig, tests, runs))
    found = []
    for test in further_tests(rig, tests):
        view = _driven(test, runs)
        if isinstance(view, _View):
            apart = columns.apart(known + columns.products(view), 0.0)
            found.append(Parting(view.words, float(apart.min()), test.why))
    return sorted(found, key=lambda one: -one.sigma)


def plan(rig: Rig, tests: Sequence[TestName], runs: int = 3) -> Plan:
    """What tests of a rig, each driven `runs` times in each direction, can and cannot tell apart.

    The ball is taken as far off as the rig file's eccentricity_mm has it, the noise as that of a good cell. Raises
    FileError where the arm cannot do a test.
    """
    view = _View(rig, tests, runs)
    candidates = candidates_for(view.linear)
    columns = _Columns([one.effects for one in candidates], np.array([one.size for one in candidates]))
    K = columns.products(view)
    sigma = columns.lengths(K)
    seen = LARGEST * sigma >= DETECTABLE
    labels = [_label(one) for one in candidates]
    pairs = _alike(labels, columns.apart(K, DETECTABLE), seen)
    sights = _sights(labels, candidates, sigma, view)
    hidden = [k for k, sight in enumerate(sights) if sight.hidden]

    # Only what is alike or hidden is asked of further tests.
    rivals = [(candidates[i], candidates[j]) for i, j, _ in pairs.values()]
    forms = [one.effects for pair in rivals for one in pair] + [(sights[k].effect,) for k in hidden]
    sizes = [one.size for pair in rivals for one in pair] + [1.0] * len(hidden)
    asked = _Columns(forms, np.array(sizes))
    known = asked.products(view)
    plausible = np.maximum(1.0, DETECTABLE / np.maximum(asked.lengths(known), 1e-12))
    partings: list[list[Parting]] = [[] for _ in pairs]
    showings: list[list[Parting]] = [[] for _ in hidden]
    gains, impossible = [], []
    for test in further_tests(rig, tests):
        more = _driven(test, runs)
        if not isinstance(more, _View):
            impossible.append((test.words, more))
            continue
        both = known + asked.products(more)
        apart = asked.apart(both, 0.0, plausible)
        for n, found in enumerate(partings):
            found.append(Parting(more.words, float(apart[2 * n, 2 * n + 1]), test.why))
        for n, found in enumerate(showings):
            found.append(Parting(more.words, float(asked.lengths(both)[2 * len(pairs) + n]), test.why))
        parts = sum(found[-1].sigma >= ALIKE for found in partings)
        shows = sum(LARGEST * found[-1].sigma >= DETECTABLE for found in showings)
        gains.append(Gain(more.words, test.why, parts, shows))
    for k, found in zip(hidden, showings, strict=True):
        shown = [one for one in found if LARGEST * one.sigma >= DETECTABLE]
        sights[k] = replace(sights[k], further=tuple(sorted(shown, key=lambda one: -one.sigma)))
    return Plan(
        tuple(tests),
        runs,
        tuple(sights),
        _groups(list(pairs)),
        tuple(
            Pair(
                names,
                (_size(candidates[i], plausible[2 * n]), _size(candidates[j], plausible[2 * n + 1])),
                now,
                tuple(sorted(partings[n], key=lambda one: -one.sigma)),
            )
            for n, (names, (i, j, now)) in enumerate(pairs.items())
        ),
        tuple(sorted(gains, key=lambda gain: -(gain.parts + gain.shows))),
        tuple(impossible),
    )

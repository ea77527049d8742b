"""The proposal: circles to drive in addition, so that effects become testable which the planned tests cannot show, or
cannot distinguish.

The information of independent runs adds up: what a circle says about the sizes of all forms, its set-up and scatter
eliminated, is one matrix G, and the posterior covariance beside a choice of circles is (V⁻¹ + Σ G)⁻¹. So every circle
is simulated once. The choice is greedy: of the circles that make something testable, the one that gains most
information per minute about what is not testable yet, until the time is used or none is left. The judgement with the
chosen circles is then computed in full.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.circle_candidates import CircleCandidate, circle_candidates
from analysis.diagnosis.expected_posterior import expected_posterior
from analysis.diagnosis.form_information import FormInformation
from analysis.diagnosis.judgement import Judgement, judged
from analysis.diagnosis.planned_runs import planned_blocks
from analysis.diagnosis.testable_aims import Aims
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.errors import UseError
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, TestName


@dataclass(frozen=True)
class ProposedCircle:
    """A circle to drive, the names that it makes testable and the pairs that it separates, beside those before it."""

    candidate: CircleCandidate
    testable: tuple[str, ...]
    separated: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Proposal:
    """Circles to drive in addition to `tests`, the best first, with the judgements without and with them.

    `runs` is the number of runs of each test in each direction and `minutes` the time allowed; `feasible` counts the
    circles that the arm can drive and `refused` those that it cannot, by reason.
    """

    rig: Rig
    tests: tuple[TestName, ...]
    runs: int
    minutes: float
    circles: tuple[ProposedCircle, ...]
    before: Judgement
    after: Judgement
    feasible: int
    refused: Mapping[str, int]

    @property
    def used_min(self) -> float:
        """The minutes that the proposed circles take."""
        return sum(one.candidate.minutes for one in self.circles)


@dataclass(frozen=True)
class _Simulated:
    """A circle with the blocks of its planned runs, their set-ups, and its information (p, p)."""

    candidate: CircleCandidate
    blocks: list[Block]
    setups: dict[str, SetUp]
    information: Array


def propose(
    rig: Rig, tests: Sequence[TestName], runs: int, minutes: float, progress: Callable[[str], None] = lambda _: None
) -> Proposal:
    """Return circles that make testable what `tests`, driven `runs` times in each direction, cannot show.

    Raises UseError for tests without a circle, and FileError for a rig without one and where the arm cannot drive a
    test.
    """
    circle_tests = [test for test in tests if test in CIRCLES]
    if not circle_tests:
        raise UseError("--tests", "has no test on a circle", "give yaw or roll: circles are proposed beside them")
    candidates = circle_candidates(rig, circle_tests, runs)
    progress("simulating the tests")
    blocks, setups = planned_blocks(rig, tests, runs)
    expected = expected_posterior(blocks, setups)
    before = judged(expected)
    forms = FormInformation(expected.candidates)
    affordable = [one for one in candidates.found if one.minutes <= minutes]
    simulated = []
    for k, one in enumerate(affordable, start=1):
        progress(f"simulating circle {k} of {len(affordable)}")
        own, places = planned_blocks(one.rig, circle_tests, runs, f" circle {k}")
        simulated.append(_Simulated(one, own, places, forms.of(own, places)))
    circles = []
    for chosen, testable, separated in _chosen(Aims(forms, before), forms.of(blocks, setups), simulated, minutes):
        blocks, setups = [*blocks, *chosen.blocks], {**setups, **chosen.setups}
        circles.append(ProposedCircle(chosen.candidate, testable, separated))
    progress("judging the tests with the proposed circles")
    after = judged(expected_posterior(blocks, setups)) if circles else before
    return Proposal(
        rig, tuple(tests), runs, minutes, tuple(circles), before, after, len(candidates.found), candidates.refused
    )


def _chosen(
    aims: Aims, information: Array, simulated: Sequence[_Simulated], minutes: float
) -> list[tuple[_Simulated, tuple[str, ...], tuple[tuple[str, str], ...]]]:
    """Return the circles to drive beside tests with an information (p, p), the best first, each with the names that it
    makes testable and the pairs that it separates."""
    found = []
    rest, now = list(simulated), aims.reached(information)
    while rest := [one for one in rest if one.candidate.minutes <= minutes]:
        reached = [aims.reached(information + one.information) for one in rest]
        worth = [
            then.gain_over(now) / one.candidate.minutes if then.newly(now) else 0.0
            for one, then in zip(rest, reached, strict=True)
        ]
        best = int(np.argmax(worth))
        if not worth[best]:
            break
        one, then = rest.pop(best), reached[best]
        found.append((one, *then.split(then.newly(now))))
        information, now, minutes = information + one.information, then, minutes - one.candidate.minutes
    return found

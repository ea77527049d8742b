"""Additional circles that make effects testable which planned tests cannot show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.apps.planning.circle_candidates import CircleCandidate, circle_candidates
from analysis.apps.planning.detectability import Judgement, judge_posterior
from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.evidence.significance import CERTAIN_SIGMA
from analysis.diagnosis.fit.candidates import LARGEST_FAULT
from analysis.diagnosis.plan.expected import SEPARABLE, FormInformation, expected_posterior, planned_blocks
from analysis.robot.geometry.driven_programs import require_drivable_arm
from analysis.robot.kinematics.arm import Array
from analysis.robot.predict import SetUp
from rigs.errors import UseError
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, TestName

# Goals of a proposal: undetectable names and pairs that look alike, and the progress of runs towards them.

_FAINT = 0.1
"""Share of a goal below which additional information does not count: an undetectable effect must not outweigh all
others. Chosen.
"""


@dataclass(frozen=True)
class Reached:
    """Progress of runs: `share` (n,) of the required sigmas for each goal, `names` first and then `pairs`."""

    names: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    share: Array

    def gain_over(self, before: Reached) -> float:
        """Information in nats gained about all goals, limited by their testability."""
        then, now = (np.clip(reached.share, _FAINT, 1.0) for reached in (self, before))
        return float(np.log(then / now).sum())

    def newly(self, before: Reached) -> tuple[tuple[str, ...], tuple[tuple[str, str], ...]]:
        new, count = (self.share >= 1) & (before.share < 1), len(self.names)
        return (
            tuple(name for name, is_new in zip(self.names, new[:count], strict=True) if is_new),
            tuple(pair for pair, is_new in zip(self.pairs, new[count:], strict=True) if is_new),
        )


class Aims:
    """Goals of a proposal: effects and pairs that a judgement found untestable."""

    def __init__(self, forms: FormInformation, judgement: Judgement) -> None:
        self._forms = forms
        self._names = judgement.undetectable
        self._pairs = judgement.pairs
        self._of_name = {
            name: [candidate for candidate in forms.candidates if candidate.name == name] for name in self._names
        }
        self._ones = [candidate for pair in self._pairs for candidate in pair.candidates]
        self._sizes = np.array([size for pair in self._pairs for size in pair.sizes])

    def reached(self, information: Array) -> Reached:
        """Progress of runs with an information (p, p). Shapes count as known; the final judgement fits them."""
        posterior = self._forms.posterior(information)
        sds = np.array([min(map(posterior.sd, self._of_name[name])) for name in self._names])
        named = LARGEST_FAULT / (CERTAIN_SIGMA * sds)
        apart = np.empty(0)
        if self._pairs:
            pairs = np.arange(len(self._ones), dtype=np.int64).reshape(-1, 2)
            apart = posterior.sigmas_apart(self._ones, self._sizes, pairs) / SEPARABLE
        return Reached(self._names, tuple(pair.names for pair in self._pairs), np.concatenate([named, apart]))


# Proposal: circles to drive in addition, which make effects testable that the planned tests cannot show or distinguish.
#
# The information of independent runs is additive. The information of a circle about the sizes of all forms, with set-up
# and scatter eliminated, is a matrix G, and the posterior covariance with a choice of circles is (V⁻¹ + Σ G)⁻¹. Every
# circle is therefore simulated only once. The choice is greedy: among the circles that reach a goal, select the circle
# that gains most information per minute about the remaining goals, until the time is used or no such circle remains.
# The judgement with the chosen circles is then computed in full.


@dataclass(frozen=True)
class ProposedCircle:
    candidate: CircleCandidate
    testable: tuple[str, ...]
    separated: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class CircleProposal:
    rig: Rig
    tests: tuple[TestName, ...]
    runs: int
    minutes: float
    """Available time."""
    circles: tuple[ProposedCircle, ...]
    before: Judgement
    after: Judgement
    feasible: int
    """Number of circles that the arm can drive."""
    refused: Mapping[str, int]
    """Number of the other circles by reason."""


@dataclass(frozen=True)
class _Simulated:
    """A circle with the blocks of the planned runs, their set-ups, and the information (p, p)."""

    candidate: CircleCandidate
    blocks: list[Block]
    setups: dict[str, SetUp]
    information: Array


def propose(
    rig: Rig, tests: Sequence[TestName], runs: int, minutes: float, progress: Callable[[str], None] = lambda _: None
) -> CircleProposal:
    """Propose circles that make effects testable which `tests`, driven `runs` times in each direction, cannot show.

    Raises UseError if no test is a circle, FileError for a rig without a circle and a test that the arm cannot drive.
    """
    require_drivable_arm(rig)
    circle_tests = [test for test in tests if test in CIRCLES]
    if not circle_tests:
        remedy = "give yaw or roll: further circles are proposed for these tests"
        raise UseError("--tests", "has no test on a circle", remedy, code="usage")
    found, refused = circle_candidates(rig, circle_tests, runs)
    progress("simulating the tests")
    blocks, setups = planned_blocks(rig, tests, runs)
    expected = expected_posterior(blocks, setups)
    before = judge_posterior(expected)
    forms = FormInformation(expected.candidates)
    affordable = [candidate for candidate in found if candidate.minutes <= minutes]
    simulated = []
    for k, candidate in enumerate(affordable, start=1):
        progress(f"simulating circle {k} of {len(affordable)}")
        driven, places = planned_blocks(candidate.rig, circle_tests, runs, f" circle {k}")
        simulated.append(_Simulated(candidate, driven, places, forms.of(driven, places)))
    circles = []
    for chosen, testable, separated in _choose_circles(
        Aims(forms, before), forms.of(blocks, setups), simulated, minutes
    ):
        blocks, setups = [*blocks, *chosen.blocks], {**setups, **chosen.setups}
        circles.append(ProposedCircle(chosen.candidate, testable, separated))
    progress("judging the tests with the proposed circles")
    after = judge_posterior(expected_posterior(blocks, setups)) if circles else before
    return CircleProposal(rig, tuple(tests), runs, minutes, tuple(circles), before, after, len(found), refused)


def _choose_circles(
    aims: Aims, information: Array, simulated: Sequence[_Simulated], minutes: float
) -> list[tuple[_Simulated, tuple[str, ...], tuple[tuple[str, str], ...]]]:
    """Circles besides tests with an information (p, p), best first, each with newly testable effects and pairs."""
    chosen = []
    remaining, now = list(simulated), aims.reached(information)
    while remaining := [circle for circle in remaining if circle.candidate.minutes <= minutes]:
        reached = [aims.reached(information + circle.information) for circle in remaining]
        values = [
            then.gain_over(now) / circle.candidate.minutes if any(then.newly(now)) else 0.0
            for circle, then in zip(remaining, reached, strict=True)
        ]
        best = int(np.argmax(values))
        if not values[best]:
            break
        circle, then = remaining.pop(best), reached[best]
        chosen.append((circle, *then.newly(now)))
        information, now, minutes = information + circle.information, then, minutes - circle.candidate.minutes
    return chosen

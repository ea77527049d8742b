"""When recordings start and end by themselves, and how long runs are kept: `automatic` and `retention` of a rig file.

A rule waits either for the robot's signal to take a value, or for a motion: the robot stands at one posture and
goes from there to another. Postures are joint angles as the controller reports them, which `rig automatic RUN` takes
from a recorded lap: nothing here needs to know the arm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import Annotated

from pydantic import Field, model_validator

from rigs.schema.part import Part
from rigs.schema.robot import Posture
from rigs.schema.vocabulary import Direction, DrivenTest

NEAR_DEG = 0.5
"""A robot whose joints are all so near to a posture stands there; programs come back to within 0.02°."""
_LEAST_MOVE_DEG = 4 * NEAR_DEG
Circling = ("yaw", "roll")


class When(Part):
    """What starts a recording: a signal's value, or a motion."""

    signal: int | None = Field(default=None, ge=-(2**31), lt=2**31)
    from_deg: Posture | None = None
    """Where the robot stands before it moves."""
    to_deg: Posture | None = None
    """Where it then goes: some degrees on, which distinguishes cw from acw."""

    @model_validator(mode="after")
    def _one_kind(self) -> When:
        if (self.from_deg is None) != (self.to_deg is None):
            raise ValueError("a motion needs both from_deg and to_deg; rig automatic RUN writes them")
        if (self.signal is None) == (self.from_deg is None):
            raise ValueError("give either signal, or from_deg and to_deg")
        if self.from_deg and self.to_deg and _apart(self.from_deg, self.to_deg) < _LEAST_MOVE_DEG:
            raise ValueError(f"to_deg is less than {_LEAST_MOVE_DEG:g}° from from_deg; give a posture further on")
        return self

    def overlaps(self, when: When) -> bool:
        """Whether one and the same event would be both."""
        if self.from_deg and self.to_deg and when.from_deg and when.to_deg:
            reach = (math.dist(self.from_deg, self.to_deg) + math.dist(when.from_deg, when.to_deg)) / 2
            same_start = _apart(self.from_deg, when.from_deg) <= 2 * NEAR_DEG
            return same_start and math.dist(self.to_deg, when.to_deg) < reach
        return self.signal is not None and self.signal == when.signal


class Rule(Part):
    """One event of the robot, and what is recorded from then on."""

    when: When
    test: DrivenTest
    direction: Direction | None = None
    still_s: float = Field(default=2.0, ge=0.2, le=3600)
    """The run ends when the robot has stood still for so long; after a signal, counted from the signal's end."""

    @model_validator(mode="after")
    def _directed(self) -> Rule:
        if self.test in Circling and self.direction is None:
            raise ValueError(f"a {self.test} test has a direction; add direction: cw or acw")
        if self.test not in Circling and self.direction is not None:
            raise ValueError(f"a {self.test} test has no direction; leave it out")
        return self

    @property
    def title(self) -> str:
        """`yaw cw`, say."""
        return f"{self.test} {self.direction}" if self.direction else self.test

    @property
    def event(self) -> str:
        """`signal 1: yaw cw`, say."""
        return f"{'a motion' if self.when.signal is None else f'signal {self.when.signal}'}: {self.title}"


class Automatic(Part):
    """The rules by which recordings start without a person."""

    rules: Annotated[tuple[Rule, ...], Field(min_length=1, max_length=100)]

    @model_validator(mode="after")
    def _distinct(self) -> Automatic:
        numbered = combinations(enumerate(self.rules, 1), 2)
        pairs = [f"{i} and {j}" for (i, rule), (j, second_rule) in numbered if rule.when.overlaps(second_rule.when)]
        if pairs:
            raise ValueError(f"rules {', '.join(pairs)} wait for the same event; give each a signal of its own")
        return self

    def lacking(self, *, signal: bool, gauges: int) -> list[str]:
        """What the rules need and the rig has not: a signal, a second gauge."""
        unheard = [str(number) for number, rule in enumerate(self.rules, 1) if rule.when.signal is not None]
        paired = [str(number) for number, rule in enumerate(self.rules, 1) if rule.test in Circling]
        lacks = []
        if unheard and not signal:
            lacks.append(
                f"rule {', '.join(unheard)} waits for a signal, and feedback carries none (ur_rtde and line_feed can)"
            )
        if paired and gauges < 2:
            lacks.append(f"rule {', '.join(paired)} needs two gauges: add gauges.g2")
        return lacks


class Retention(Part):
    """How long and how much is kept of what was exported; what was not is never deleted."""

    days: float | None = Field(default=None, ge=1, le=36500)
    gigabytes: float | None = Field(default=None, ge=0.001, le=1e6)

    @model_validator(mode="after")
    def _some_limit(self) -> Retention:
        if self.days is None and self.gigabytes is None:
            raise ValueError("give days, gigabytes or both; without retention everything is kept")
        return self


def _apart(a_deg: Sequence[float], b_deg: Sequence[float]) -> float:
    """The largest difference of any joint, in degrees."""
    return max(abs(a - b) for a, b in zip(a_deg, b_deg, strict=True))

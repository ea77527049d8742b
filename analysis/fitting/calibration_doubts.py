"""What a person should know before a calibration is used: sizes at their bounds, shapes that were not fitted, wild
readings, and joints beyond the ranges that were covered."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from analysis.fitting.estimate import Fit
from analysis.fitting.identifiability import parameter_label
from analysis.fitting.joint_coverage import JointRange, outside_coverage
from analysis.fitting.observation import Observation
from analysis.fitting.weighting import Weighting
from rigs.effects import bounds
from rigs.schema.effect import label_of

_AT_BOUND = 1e-3
"""Share of a bound within which a size ends there. Chosen: an optimizer that stays inside of its bounds stops just
before them."""


def doubts_of_sizes(after: Fit) -> list[str]:
    """Return a message for each size that ends at a bound, and for each shape that was not fitted with its size."""
    return [*_at_bounds(after), *_held(after)]


def _at_bounds(after: Fit) -> list[str]:
    """Return a message for each size that ends at the bound of a rig file: the robot may err by more, and the sizes of
    other effects then take up what is left."""
    found = []
    for one in after.free:
        effect = after.model.effects[one.effect]
        value, low, high = float(getattr(effect, one.field)), *bounds(effect, one.field)
        # Zero is no limit of what a robot does: a play is zero where there is none.
        ended = [bound for bound in (low, high) if bound and abs(value - bound) < _AT_BOUND * abs(bound)]
        found += [
            f"{parameter_label(effect, one.field)} ends at the limit of a rig file, {bound:g} "
            f"{effect.unit(one.field)}: the robot may err by more, and other sizes are then wrong as well; correct "
            "it in the model first"
            for bound in ended
        ]
    return found


def _held(after: Fit) -> list[str]:
    """Return a message for each shape that was held at its default, on which the fitted size depends."""
    effects = [after.model.effects[k] for k in dict.fromkeys(one.effect for one in after.free)]
    return [
        f"{label_of(effect)}: its {shape.field} was held at {getattr(effect, shape.field):g}, on which its size "
        "depends; rig diagnose fits both"
        for effect in effects
        for shape in effect.STRETCHED
        if shape.field not in re.compile(effect.PLACE.pattern).groupindex
    ]


def doubts_of_readings(
    observations: Sequence[Observation],
    left_out: Sequence[Observation],
    weighting: Weighting,
    covered: Sequence[JointRange],
) -> list[str]:
    """Return a message for each set-up with wild readings, and for each joint that the readings (m, k) mm that were
    left out turn beyond where the effects were determined."""
    wild: dict[str, tuple[int, int]] = {}
    for one, count in zip(observations, weighting.wild, strict=True):
        left, whole = wild.get(one.setup, (0, 0))
        wild[one.setup] = left + count, whole + len(one.rows)
    found = [
        f"{setup}: {count} of {whole} readings are wild and left out" for setup, (count, whole) in wild.items() if count
    ]
    if left_out:
        judged = np.concatenate([one.table.q[one.rows] for one in left_out])
        found += outside_coverage(covered, judged, "the model")
    return found

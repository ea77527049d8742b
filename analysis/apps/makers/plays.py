"""Compensation of backlash in a program: the joints turn further, so that the links reach the targets."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from analysis.apps.makers.programs.compensated import reached, targets_of
from analysis.apps.makers.programs.motion_plan import MotionPlan
from analysis.correction.support import known_plays
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.model.motion import Motion
from analysis.robot.model.predict import Path, driven, model_of
from rigs.rig import Rig

_BETWEEN = 16
"""Intermediate positions for detecting joint reversals between two targets."""


def ahead_of_plays(rig: Rig, plan: MotionPlan) -> Array:
    """Return the lead (n, 6) rad of the joints at the targets of a plan, in the order of `targets_of`.

    With this lead the links reach the targets despite the backlash in the rig file.
    """
    targets = targets_of(plan)
    model = model_of(rig, known_plays(rig))
    if not model.effects:
        return np.zeros((len(targets), 6))
    places = {id(target): number for number, target in enumerate(targets)}
    visits = [places[id(target)] for target in reached(plan)]
    q, rows = interpolate_moves([targets[number].q for number in 2 * visits])
    motion = Motion(np.arange(len(q), dtype=float), q)
    lag = (driven(model, Path(motion, rows)).link_q - q)[rows]
    last = {number: row for row, number in enumerate(2 * visits)}
    return -np.array([lag[last[number]] for number in range(len(targets))])


def interpolate_moves(q: Sequence[Array]) -> tuple[Array, Integers]:
    """Return joint angles (m, 6) rad on linear moves between positions q (6,) rad, and the indices of the positions."""
    share = np.arange(_BETWEEN) / _BETWEEN
    ways = [begin + share[:, None] * (end - begin) for begin, end in pairwise(q)]
    return np.concatenate([*ways, q[-1][None]]), _BETWEEN * np.arange(len(q))

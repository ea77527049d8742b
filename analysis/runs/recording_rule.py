"""Derive from a recorded run the rule that would have started it: a signal that changed, or the departure of the robot
from a posture as its controller reports it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from analysis.robot.kinematics.arm import Array
from daq.store import Run
from daq.store.ledger import first_error
from rigs.errors import FileError
from rigs.schema.declared_tests import STILL_DEG, STOOD_S, Rule
from rigs.schema.feedback import SIGNAL
from rigs.schema.vocabulary import CIRCLES, OF_ISO9283

_ON_THE_WAY_DEG = 3.0
_STEP_S = 0.05
_LEAST_STILL_S = 2.0
_FIRST_BLOCK = 64


def rule_of(run: Run) -> Rule:
    manifest, where = run.manifest, str(run.path)
    if "robot" not in run.streams:
        raise FileError(
            where, "contains a table without a robot stream", "give a run recorded by rigd", code="readings.unsuitable"
        )
    if manifest.test in OF_ISO9283:
        problem = f"is a {manifest.test} test, which rigd cannot record"
        raise FileError(where, problem, "give a recorded run of a different test", code="readings.unsuitable")
    robot = run.streams["robot"]
    # the value that lasted longest after a change of the signal, if any
    signal = robot[SIGNAL][np.isfinite(robot[SIGNAL])] if SIGNAL in robot else np.empty(0)
    values, counts = np.unique(signal[signal != signal[:1]], return_counts=True)
    when: dict[str, Any]
    if len(values):
        when, still_s = {"signal": int(values[counts.argmax()])}, _LEAST_STILL_S
    else:
        when, still_s = _departure(robot, where)
    direction = manifest.direction if manifest.test in CIRCLES else None  # other tests have no direction
    try:
        return Rule.model_validate({"when": when, "test": manifest.test, "direction": direction, "still_s": still_s})
    except ValidationError as error:
        problem = f"cannot be turned into a rule: {first_error(error)}"
        raise FileError(where, problem, "record its program again", code="readings.unsuitable") from None


def _departure(robot: Mapping[str, np.ndarray[Any, Any]], where: str) -> tuple[dict[str, Any], float]:
    """Posture and first movement of the departure, and the standstill in s that ends the run.

    The standstill is twice the longest on the path. Raises FileError if the robot stood still or moved from the
    beginning.
    """
    t_s = (robot["last_byte_ns"] - robot["last_byte_ns"][:1]) / 1e9
    q_deg = np.column_stack([robot[f"q{axis}_deg"] for axis in range(1, 7)])
    kept = np.unique(t_s // _STEP_S, return_index=True)[1]  # sufficient to detect a standstill
    t_s, q_deg = t_s[kept], q_deg[kept]
    if not len(t_s) or _leaves(q_deg, _ON_THE_WAY_DEG) == len(t_s):
        raise FileError(
            where, "the robot stood still", "start the recording before the program", code="readings.unsuitable"
        )
    begins = _leaves(q_deg, STILL_DEG)
    if t_s[begins - 1] < STOOD_S:
        raise FileError(
            where,
            "the robot is already moving at the start of the run",
            "record from before the program starts",
            code="readings.unsuitable",
        )
    start, onwards = np.median(q_deg[:begins], axis=0), q_deg[_leaves(q_deg, _ON_THE_WAY_DEG)]
    begin, longest_s = begins, 0.0
    while begin < len(t_s):
        after = _leaves(q_deg, STILL_DEG, begin)
        if after < len(t_s):  # the last one is the end
            longest_s = max(longest_s, t_s[after - 1] - t_s[begin])
        begin = after
    still_s = max(_LEAST_STILL_S, float(math.ceil(2 * longest_s)))
    return {"from_deg": start.round(3).tolist(), "to_deg": onwards.round(3).tolist()}, still_s


def _leaves(q_deg: Array, by_deg: float, begin: int = 0) -> int:
    """First row from `begin` on in which a joint has moved by more than by_deg, or the number of rows."""
    end = begin
    while end < len(q_deg):
        block = q_deg[end : end + max(end - begin, _FIRST_BLOCK)]
        away = (np.abs(block - q_deg[begin]) > by_deg).any(axis=1)
        if away.any():
            return end + int(away.argmax())
        end += len(block)
    return len(q_deg)

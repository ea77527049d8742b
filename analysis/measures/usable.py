"""Whether a recorded run is a measurement, asked while the robot can still drive it again."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.conventions.check import why_no_measurement
from analysis.measures.results import result_of
from analysis.traces.align import robot_alone
from analysis.traces.loading import measured_of
from daq.store import read_run
from rigs.errors import DirectionError, FileError
from rigs.schema.vocabulary import WITHOUT_GAUGES, Direction

_END_S, _MOVES_RAD = 0.5, float(np.radians(0.05))
"""A robot drives at the end of a run where a joint turns by so much in so long: five times what a stand shows."""


@dataclass(frozen=True)
class Fitness:
    """What is to be said of a run that has just ended: `why` `rig analyse` would refuse it, empty where it would not;
    the direction that the robot `drove`, where another label mends it; whether it was `still_driving` at the end."""

    why: str
    drove: Direction | None
    still_driving: bool


def fitness(run: Path) -> Fitness:
    """Return whether a run can be used, and what would mend it."""
    why, drove, still_driving = "", None, False
    try:
        recorded = read_run(run)
        with suppress(FileError):
            t_s, q, _ = robot_alone(run, recorded)
            still_driving = bool(np.ptp(q[t_s >= t_s[-1] - _END_S], axis=0).max() > _MOVES_RAD)
        if recorded.manifest.test not in WITHOUT_GAUGES:  # which has a table of its own
            measured = measured_of(recorded)
            why = why_no_measurement(measured)
            if not why:
                result_of(measured)
    except DirectionError as error:
        why, drove = error.what, error.drove
    except FileError as error:
        why = error.what
    return Fitness(why, drove, still_driving)


def why_unusable(run: Path) -> str:
    """Return why `rig analyse` would refuse a run, or a convention shows that it is none; empty where it is good."""
    return fitness(run).why

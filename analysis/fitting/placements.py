"""Placements: runs of one test and placement share a set-up unless their readings show that something was moved.

A placement has a name if the user gave one when the run was recorded or imported; otherwise the readings decide.
Circles of one direction repeat each other, so model errors displace their balls equally, and two balls further apart
than the scatter of a real cell were mounted separately. A play moves the ball of one direction relative to that of the
other, so frames of both directions are only matched. Runs at targets, and poses, that cannot share one rigid frame have
far larger residuals together than each alone. Poses of all placements share the tool, so that a placement of few poses
needs only its frame from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.fitting.observation import Observation, observe, predicted, residuals_of, rms, thinned, with_placement
from analysis.fitting.setups import FRAME_TERMS, fit_setups, terms_of
from analysis.kinematics.arm import Arm, Array, arm_of
from analysis.model.predict import Model, model_of
from analysis.noise.cell import BALL_MM, JOINT_DEG
from analysis.traces.loading import Measured
from analysis.traces.tables import CircleTable, PoseTable
from rigs.errors import FileError
from rigs.rig import Rig

_APART = 3.0
"""Ratio of the residual of two runs together to that of each alone, above which they have separate frames. Chosen: a
wrong model increases both."""
_APART_MM = 5 * BALL_MM.high
"""Smallest difference between these residuals: five times the largest scatter of a ball between runs in real cells."""
_MOVED_MM = 3 * float(np.hypot(BALL_MM.high, 1000 * np.radians(JOINT_DEG.high)))
"""Change of the readings from a circle to its repeat above which the ball was moved: three times the largest scatter of
ball and joints of real cells, at the end of an arm of one metre."""
_ENOUGH_ROWS = 256
"""Number of readings of a circle by which its frame is found. Chosen: with a micrometre of noise they place the ball to
a tenth of a micrometre, and a ball that was moved is a thousand times further off."""
TO_SPARE = 9
"""Number of readings beyond the terms of a set-up from which on the residual of a run alone is meaningful. Chosen:
three poses, of three coordinates each."""


def observe_runs(rig: Rig, runs: Sequence[Measured]) -> list[Observation]:
    """Return runs as observations of (m, k) mm, each with the set-up of its placement. Raises FileError for a run of
    another robot."""
    model = model_of(rig)
    for run in runs:
        if not same_arm(arm_of(run.rig.robot), model.arm):
            what = f"is of another robot than {rig.name}: its link constants differ"
            raise FileError(
                str(run.path), what, "give the runs of one robot at a time, or the --rig that they were made with"
            )
    return [with_placement(observe(model, run.table, str(run.path)), run.run.manifest.placement) for run in runs]


def split_by_frame(
    model: Model, observations: Sequence[Observation], names: Sequence[str]
) -> tuple[list[Observation], list[str]]:
    """Return the observations, of (m, k) mm, with a set-up for each frame that they show, and messages about them."""
    found, messages = list(observations), []
    for setup in dict.fromkeys(one.setup for one in observations):
        places = [k for k, one in enumerate(observations) if one.setup == setup]
        split = _circle_frames if isinstance(observations[places[0]].table, CircleTable) else _target_frames
        frames = sorted(sorted(frame) for frame in split(model, observations, places))
        for number, frame in enumerate(frames[1:], start=2):
            for k in frame:
                found[k] = replace(found[k], setup=f"{setup}, frame {number}")
        if len(frames) > 1:
            runs = "; ".join(", ".join(names[k] for k in frame) for frame in frames)
            what = f"runs of {setup} do not share one frame: fitted as {len(frames)} placements ({runs})"
            messages.append(f"{what}, which rig relabel --placement can name")
    return found, messages


def with_enough_readings(observations: Sequence[Observation]) -> tuple[list[int], list[str]]:
    """Return the indices of observations whose readings (m, k) determine their set-ups, and messages about the others.
    Raises FileError if there are none."""
    tool_known = any(isinstance(one.table, PoseTable) and _spare(observations, one.setup) > 0 for one in observations)
    reasons: dict[str, str] = {}
    for one in observations:
        shares = tool_known and isinstance(one.table, PoseTable)
        terms = FRAME_TERMS if shares else terms_of(one.table)
        readings = _readings(observations, one.setup)
        if readings <= terms:
            reasons[one.setup] = f"its {readings} readings are too few for the {terms} terms of the set-up alone"
    kept = [k for k, one in enumerate(observations) if one.setup not in reasons]
    if not kept:
        setup, why = next(iter(reasons.items()))
        raise FileError(f"set-up {setup}", why, "give more runs of it, or more readings in each")
    return kept, [f"{setup} is left out: {why}" for setup, why in reasons.items()]


def same_arm(one: Arm, other: Arm) -> bool:
    """Whether two arms have the same link constants and couplings."""
    return all(
        np.allclose(getattr(one, constant), getattr(other, constant), atol=1e-9)
        for constant in ("a", "alpha", "beta", "d", "offset", "coupling")
    )


def _readings(observations: Sequence[Observation], setup: str) -> int:
    return sum(one.values.size for one in observations if one.setup == setup)


def _spare(observations: Sequence[Observation], setup: str) -> int:
    table = next(one.table for one in observations if one.setup == setup)
    return _readings(observations, setup) - terms_of(table)


def _circle_frames(model: Model, observations: Sequence[Observation], places: Sequence[int]) -> list[list[int]]:
    """Return circles grouped by frame: first those of each direction, which are then matched."""
    few = {k: thinned(observations[k], _ENOUGH_ROWS) for k in places}
    alone = {k: fit_setups([(model, one)])[one.setup] for k, one in few.items()}

    def moved_mm(one: int, other: int) -> float:
        here, there = (predicted(model, few[other], alone[k]) for k in (one, other))
        return rms([there - here])

    ways: dict[str, list[list[int]]] = {}
    for k in places:
        table = observations[k].table
        assert isinstance(table, CircleTable)  # noqa: S101 - of one test, all are
        frames = ways.setdefault(table.direction, [])
        home = next((frame for frame in frames if moved_mm(frame[0], k) < _MOVED_MM), None)
        if home is None:
            frames.append([k])
        else:
            home.append(k)
    most, *others = sorted(ways.values(), key=len, reverse=True)
    for frames in others:
        apart = np.array([[moved_mm(home[0], frame[0]) for home in most] for frame in frames])
        for row, column in _nearest(apart):
            most[column] = most[column] + frames[row]
    return most


def _nearest(apart: Array) -> list[tuple[int, int]]:
    """Return the pairs of rows and columns of a matrix (r, c) with the least sum; each row has one column."""
    if apart.shape == (1, 1):
        return [(0, 0)]
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - slow to import, needed here only

    return list(zip(*(side.tolist() for side in linear_sum_assignment(apart)), strict=True))


def _target_frames(model: Model, observations: Sequence[Observation], places: Sequence[int]) -> list[list[int]]:
    """Return runs at targets, or of poses, grouped by frame."""
    frames: list[list[int]] = []
    # Runs with most readings come first, because a run of few readings can only join a frame.
    for k in sorted(places, key=lambda k: -observations[k].values.size):
        home = next((frame for frame in frames if _one_frame(model, [observations[j] for j in (*frame, k)])), None)
        if home is None:
            frames.append([k])
        else:
            home.append(k)
    return frames


def _one_frame(model: Model, runs: Sequence[Observation]) -> bool:
    """Return whether the last run can be in the frame of the others."""
    *others, last = runs
    together = _left(model, runs)
    if last.values.size < terms_of(last.table) + TO_SPARE:
        alone = rms(_left(model, others))
    else:
        alone = max(rms(_left(model, others)), rms(_left(model, [last])))
    apart = max(rms(together[:-1]), rms(together[-1:]))
    return apart < _APART * alone or apart < alone + _APART_MM


def _left(model: Model, runs: Sequence[Observation]) -> list[Array]:
    """Return the residuals (m, k) mm of runs with their set-ups fitted."""
    return residuals_of(model, runs, fit_setups([(model, one) for one in runs]))

"""Which runs share a set-up: those of one test and placement, unless they show that something stands elsewhere.

A placement is what a person calls it when a run is recorded or imported. Where nobody said, runs show it. Circles of
one direction repeat each other, so whatever the model lacks moves their balls alike: two balls further apart than a
real cell scatters were mounted anew. A play moves the ball of one direction against that of the other, so frames of
both directions are only matched. Runs at targets, and poses, that cannot be one rigid frame leave far more together
than each by itself. Poses of all placements share the tool, so that a placement of few poses takes no more than its
frame from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.fitting.observation import Observation, observe, predicted, residuals_of, rms, with_placement
from analysis.fitting.setups import FRAME_TERMS, settled, terms_of
from analysis.kinematics.arm import Arm, Array, arm_of
from analysis.model.predict import Model, model_of
from analysis.noise.cell import BALL_MM, JOINT_DEG
from analysis.traces.loading import Measured
from analysis.traces.tables import CircleTable, PoseTable
from rigs.errors import FileError
from rigs.rig import Rig

_APART = 3.0
"""Together two runs leave as many times what each leaves alone: a wrong model makes up for less in either way."""
_APART_MM = 5 * BALL_MM.high
"""And so much more than what real cells scatter from run to run."""
_ELSEWHERE_MM = 3 * float(np.hypot(BALL_MM.high, 1000 * np.radians(JOINT_DEG.high)))
"""Readings that move by more from a circle to its repeat: three times what ball and joints of real cells do, at the end
of an arm of a metre."""
_TO_SPARE = 9
"""Readings beyond the terms of a set-up, from which on what a run leaves alone says how good it is."""


def observed(rig: Rig, runs: Sequence[Measured]) -> list[Observation]:
    """Runs as a fit sees them, each with the set-up of its placement. Raises FileError for one of another robot."""
    model = model_of(rig)
    for run in runs:
        if not _same_arm(arm_of(run.rig.robot), model.arm):
            what = f"is of another robot than {rig.name}: its link constants differ"
            raise FileError(
                str(run.path), what, "give the runs of one robot at a time, or the --rig that they were made with"
            )
    return [with_placement(observe(model, run.table, str(run.path)), run.run.manifest.placement) for run in runs]


def parted(
    model: Model, observations: Sequence[Observation], names: Sequence[str]
) -> tuple[list[Observation], list[str]]:
    """The same observations with a set-up of its own for each frame that they show, and what was found, in words."""
    found, told = list(observations), []
    for setup in dict.fromkeys(one.setup for one in observations):
        places = [k for k, one in enumerate(observations) if one.setup == setup]
        split = _circle_frames if isinstance(observations[places[0]].table, CircleTable) else _target_frames
        frames = sorted(sorted(frame) for frame in split(model, observations, places))
        for number, frame in enumerate(frames[1:], start=2):
            for k in frame:
                found[k] = replace(found[k], setup=f"{setup}, frame {number}")
        if len(frames) > 1:
            runs = "; ".join(", ".join(names[k] for k in frame) for frame in frames)
            what = f"runs of {setup} do not stand in one frame: fitted as {len(frames)} placements ({runs})"
            told.append(f"{what}, which rig relabel --placement can name")
    return found, told


def with_enough(observations: Sequence[Observation]) -> tuple[list[int], list[str]]:
    """Which observations belong to set-ups that their readings can tell, and why others do not, in words. Raises
    FileError where none does."""
    tool_known = any(isinstance(one.table, PoseTable) and _spare(observations, one.setup) > 0 for one in observations)
    told: dict[str, str] = {}
    for one in observations:
        shares = tool_known and isinstance(one.table, PoseTable)
        terms = FRAME_TERMS if shares else terms_of(one.table)
        readings = _readings(observations, one.setup)
        if readings <= terms:
            told[one.setup] = f"its {readings} readings are too few for the {terms} terms of the set-up alone"
    kept = [k for k, one in enumerate(observations) if one.setup not in told]
    if not kept:
        setup, why = next(iter(told.items()))
        raise FileError(f"set-up {setup}", why, "give more runs of it, or leave out less")
    return kept, [f"{setup} is left out: {why}" for setup, why in told.items()]


def _same_arm(one: Arm, other: Arm) -> bool:
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
    """Circles by the frames that they stand in: those of each direction by themselves, then matched."""
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - slow to import, needed here only

    alone = {k: settled([(model, observations[k])])[observations[k].setup] for k in places}

    def moved_mm(one: int, other: int) -> float:
        here, there = (predicted(model, observations[other], alone[k]) for k in (one, other))
        return rms([there - here])

    ways: dict[str, list[list[int]]] = {}
    for k in places:
        table = observations[k].table
        assert isinstance(table, CircleTable)  # noqa: S101 - of one test, all are
        frames = ways.setdefault(table.direction, [])
        home = next((frame for frame in frames if moved_mm(frame[0], k) < _ELSEWHERE_MM), None)
        if home is None:
            frames.append([k])
        else:
            home.append(k)
    most, *others = sorted(ways.values(), key=len, reverse=True)
    for frames in others:
        apart = np.array([[moved_mm(home[0], frame[0]) for home in most] for frame in frames])
        for row, column in zip(*linear_sum_assignment(apart), strict=True):
            most[column] = most[column] + frames[row]
    return most


def _target_frames(model: Model, observations: Sequence[Observation], places: Sequence[int]) -> list[list[int]]:
    """Runs at targets, or of poses, by the frames that they stand in."""
    frames: list[list[int]] = []
    # The runs that say most come first: a run of few readings can only join one.
    for k in sorted(places, key=lambda k: -observations[k].values.size):
        home = next((frame for frame in frames if _one_frame(model, [observations[j] for j in (*frame, k)])), None)
        if home is None:
            frames.append([k])
        else:
            home.append(k)
    return frames


def _one_frame(model: Model, runs: Sequence[Observation]) -> bool:
    """Whether the last run may stand in the frame of the others."""
    *others, last = runs
    together = _left(model, runs)
    if last.values.size < terms_of(last.table) + _TO_SPARE:
        alone = rms(_left(model, others))
    else:
        alone = max(rms(_left(model, others)), rms(_left(model, [last])))
    apart = max(rms(together[:-1]), rms(together[-1:]))
    return apart < _APART * alone or apart < alone + _APART_MM


def _left(model: Model, runs: Sequence[Observation]) -> list[Array]:
    """What a model leaves of runs, (m, k) mm each, their set-ups fitted."""
    return residuals_of(model, runs, settled([(model, one) for one in runs]))

"""Which runs share a set-up: those of one test and placement, unless they show that something stands elsewhere.

A placement is what a person calls it when a run is recorded or imported. Where nobody said, runs show it: two runs that
cannot be one rigid frame leave far more together than each by itself, and more than a real cell scatters from run to
run. Poses of all placements share the tool, so that a placement of few poses takes no more than its frame from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.fitting.estimate import fit
from analysis.fitting.observation import Observation, observe, rms, with_placement
from analysis.fitting.setups import FRAME_TERMS, terms_of
from analysis.kinematics.arm import Arm, arm_of
from analysis.model.predict import Model, model_of
from analysis.noise.cell import BALL_MM
from analysis.reading.loading import Measured
from analysis.reading.tables import PoseTable
from rigs.errors import FileError
from rigs.rig import Rig

_APART = 3.0
"""Together two runs leave as many times what each leaves alone: a wrong model makes up for less in either way."""
_APART_MM = 5 * BALL_MM.high
"""And so much more than what real cells scatter from run to run."""
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
        frames: list[list[int]] = []
        # The runs that say most come first: a run of few readings can only join one.
        for k in sorted(places, key=lambda k: -observations[k].values.size):
            home = next((frame for frame in frames if _one_frame(model, [observations[j] for j in (*frame, k)])), None)
            if home is None:
                frames.append([k])
            else:
                home.append(k)
        frames = sorted(sorted(frame) for frame in frames)
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


def _one_frame(model: Model, runs: Sequence[Observation]) -> bool:
    """Whether the last run may stand in the frame of the others."""
    *others, last = runs
    together = fit(model, runs)
    if last.values.size < terms_of(last.table) + _TO_SPARE:
        alone = rms(fit(model, others).residuals)
    else:
        alone = max(rms(fit(model, others).residuals), rms(fit(model, [last]).residuals))
    apart = max(rms(together.residuals[:-1]), rms(together.residuals[-1:]))
    return apart < _APART * alone or apart < alone + _APART_MM

"""Placements: which runs share a set-up.

Runs of one test and placement share a set-up unless their readings show that something was moved. A placement has a
name if the user gave one when the run was recorded or imported; otherwise the readings decide.

Circles of one direction repeat each other, so model errors displace their balls equally, and two balls further apart
than the scatter of a real cell were mounted separately. A play moves the ball of one direction relative to that of the
other, so frames of both directions are only matched. Runs at targets, and poses, that cannot share one rigid frame have
far larger residuals together than each alone. Poses of all placements share the target on the tool, so that a placement
of few poses needs only its frame from them; the data prove it where a reflector was put elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.inference.observation import (
    Observation,
    observe,
    predicted,
    residuals_of,
    rms,
    thinned,
    with_placement,
    without_socket,
)
from analysis.inference.setups import FRAME, fit_setups, placement_of, target_of, targeted
from analysis.kinematics.arm import Arm, Array, arm_of
from analysis.model.predict import Model, SetUp, model_of
from analysis.noise.cell import BALL_MM, JOINT_DEG
from analysis.traces.loading import Measured
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
            problem = f"is of another robot than {rig.name}: its link constants differ"
            raise FileError(
                str(run.path), problem, "give the runs of one robot at a time, or the --rig that they were made with"
            )
    return [with_placement(observe(model, run.table, str(run.path)), run.run.manifest.placement) for run in runs]


def split_by_frame(
    model: Model, observations: Sequence[Observation], names: Sequence[str]
) -> tuple[list[Observation], list[str]]:
    """Return the observations, of (m, k) mm, with a set-up for each frame that they show, and messages about them; of
    poses `split_by_target` has those."""
    split_up, messages = list(observations), []
    for setup in dict.fromkeys(observation.setup for observation in observations):
        places = [k for k, observation in enumerate(observations) if observation.setup == setup]
        split = _circle_frames if observations[places[0]].table.kind.swept else _target_frames
        frames = sorted(sorted(frame) for frame in split(model, observations, places))
        for number, frame in enumerate(frames[1:], start=2):
            for k in frame:
                split_up[k] = replace(split_up[k], setup=f"{setup}{FRAME}{number}")
        if len(frames) > 1 and not observations[places[0]].table.kind.of_tracker:
            messages.append(_of_frames(setup, [[names[k] for k in frame] for frame in frames]))
    return split_up, messages


def _of_frames(setup: str, frames: Sequence[Sequence[str]]) -> str:
    """Return what a person should know of runs of a set-up that have several frames."""
    runs = "; ".join(", ".join(names) for names in frames)
    message = f"runs of {setup} do not share one frame: fitted as {len(frames)} placements ({runs})"
    return f"{message}, which rig relabel --placement can name"


def split_by_target(
    model: Model, observations: Sequence[Observation], names: Sequence[str]
) -> tuple[list[Observation], list[str]]:
    """Return the observations, of (m, k) mm, with a target of its own for each place on the tool that placements of
    poses show, and a message about each. A reflector that was put elsewhere under an instrument that stood keeps the
    frame of that placement."""
    split_up = list(observations)
    members: dict[str, list[int]] = {}
    for k, observation in enumerate(observations):
        if observation.table.kind.of_tracker:
            members.setdefault(observation.setup, []).append(k)
    settled: dict[str, list[Observation]] = {}
    for setup in sorted(members, key=lambda name: -_readings(observations, name)):
        runs = [observations[k] for k in members[setup]]
        name = _settled(model, settled, setup, runs)
        settled[name] = [replace(observation, setup=name) for observation in runs]
        for k, observation in zip(members[setup], settled[name], strict=True):
            split_up[k] = observation
    named = {split_up[places[0]].setup: [names[k] for k in places] for places in members.values()}
    return split_up, _of_targets(named) if any(map(target_of, named)) else _of_placements(named)


def _settled(model: Model, settled: dict[str, list[Observation]], setup: str, runs: Sequence[Observation]) -> str:
    """Return the name that runs of a set-up get beside those that are settled: with the target of one of these, in the
    frame of one with a target of their own, or with both."""
    if not settled:
        return setup
    targets = list(dict.fromkeys(map(target_of, settled)))
    another = targeted(setup, str(len(targets) + 1))
    trials = {
        targeted(setup, target): [observation for observation in settled if target_of(observation) == target]
        for target in targets
    }
    frame = setup.partition(FRAME)[0]
    if frame != setup:
        trials[targeted(frame, str(len(targets) + 1))] = [
            observation for observation in settled if placement_of(observation) == frame
        ]
    fits = []
    for name, homes in trials.items():
        if homes:
            together_mm = _beside(model, settled[homes[0]], runs, name)
            if together_mm is not None:
                fits.append((together_mm, name))
    return min(fits)[1] if fits else another


def _beside(model: Model, home: Sequence[Observation], runs: Sequence[Observation], name: str) -> float | None:
    """Return what runs leave, rms mm, as the set-up `name` beside those at home, None where that is more than both
    leave alone. Few poses are not judged: they have the target of the others."""
    moved_mm = rms(_left(model, [*home, *(replace(observation, setup=name) for observation in runs)]))
    if sum(observation.values.size for observation in runs) < runs[0].table.kind.setup_terms + TO_SPARE:
        return moved_mm if target_of(name) == target_of(home[0].setup) else None
    apart_mm = max(rms(_left(model, home)), rms(_left(model, runs)))
    return moved_mm if moved_mm < max(_APART * apart_mm, apart_mm + _APART_MM) else None


def _of_placements(named: Mapping[str, list[str]]) -> list[str]:
    """Return a message for each placement of poses, of runs named by set-up, that shows several frames."""
    frames: dict[str, list[list[str]]] = {}
    for setup, names in sorted(named.items()):
        frames.setdefault(setup.partition(FRAME)[0], []).append(names)
    return [_of_frames(setup, members) for setup, members in frames.items() if len(members) > 1]


def _of_targets(named: Mapping[str, list[str]]) -> list[str]:
    """Return the line that says which runs of poses, named by set-up, have which target on the tool, and from how many
    places of the instrument they were seen."""
    targets: dict[str, list[str]] = {}
    for setup, names in named.items():
        targets.setdefault(target_of(setup), []).extend(names)
    runs = "; ".join(", ".join(names) for _, names in sorted(targets.items()))
    frames = len({placement_of(setup) for setup in named})
    stood = "one place of the instrument" if frames == 1 else f"{frames} places of the instrument"
    return [
        f"the poses show {len(targets)} places of the target on the tool ({runs}) and {stood}: each is a set-up of its "
        "own, as of several reflectors, and the arm is one"
    ]


def with_enough_readings(observations: Sequence[Observation]) -> tuple[list[int], list[str]]:
    """Return the indices of observations whose readings (m, k) determine their set-ups, and messages about the others.
    Raises FileError if there are none."""
    tool_known = {
        (observation.table.test, target_of(observation.setup))
        for observation in observations
        if _spare(observations, observation.setup) > 0
    }
    reasons: dict[str, str] = {}
    for observation in observations:
        shares = (
            observation.table.kind.of_places and (observation.table.test, target_of(observation.setup)) in tool_known
        )
        terms = observation.table.kind.setup_terms - 3 * shares
        readings = _readings(observations, observation.setup)
        if readings <= terms:
            reasons[observation.setup] = (
                f"its {readings} readings are too few for the {terms} terms of the set-up alone"
            )
    kept = [k for k, observation in enumerate(observations) if observation.setup not in reasons]
    if not kept:
        setup, why = next(iter(reasons.items()))
        raise FileError(f"set-up {setup}", why, "give more runs of it, or more readings in each")
    return kept, [f"{setup} is left out: {why}" for setup, why in reasons.items()]


def reach_mm(judged: Mapping[str, SetUp], used: Mapping[str, SetUp]) -> float:
    """Return how far at most (mm) a socket that was judged is from all used ones of other placements, or beside one
    placement from all others: what an arm does farther away shows nowhere, and real ones did up to four times u."""
    several = len({without_socket(name) for name in used}) > 1
    place = {name: setup.T_instrument_world[:3, 3] for name, setup in judged.items()}

    def nearest(name: str) -> float:
        apart = (other for other in used if other != name)
        others = [other for other in apart if not several or without_socket(other) != without_socket(name)]
        return min((float(np.linalg.norm(place[name] - place[other])) for other in others), default=0.0)

    return max(map(nearest, judged))


def same_arm(first: Arm, second: Arm) -> bool:
    """Whether two arms have the same link constants and couplings, and rails."""
    rail, other_rail = (np.zeros(3) if arm.rail is None else arm.rail for arm in (first, second))
    return np.allclose(rail, other_rail, atol=1e-9) and all(
        np.allclose(getattr(first, constant), getattr(second, constant), atol=1e-9)
        for constant in ("a", "alpha", "beta", "d", "offset", "coupling")
    )


def _readings(observations: Sequence[Observation], setup: str) -> int:
    return sum(observation.values.size for observation in observations if observation.setup == setup)


def _spare(observations: Sequence[Observation], setup: str) -> int:
    table = next(observation.table for observation in observations if observation.setup == setup)
    return _readings(observations, setup) - table.kind.setup_terms


def _circle_frames(model: Model, observations: Sequence[Observation], places: Sequence[int]) -> list[list[int]]:
    """Return circles grouped by frame: first those of each direction, which are then matched."""
    few = {k: thinned(observations[k], _ENOUGH_ROWS) for k in places}
    placed = {k: fit_setups([(model, observation)])[observation.setup] for k, observation in few.items()}

    def moved_mm(first: int, second: int) -> float:
        at_first, at_second = (predicted(model, few[second], placed[k]) for k in (first, second))
        return rms([at_second - at_first])

    ways: dict[str, list[list[int]]] = {}
    for k in places:
        table = observations[k].table
        frames = ways.setdefault(table.kind.direction(table) or "", [])
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
    if last.values.size < last.table.kind.setup_terms + TO_SPARE:
        apart_mm = rms(_left(model, others))
    else:
        apart_mm = max(rms(_left(model, others)), rms(_left(model, [last])))
    apart = max(rms(together[:-1]), rms(together[-1:]))
    return apart < _APART * apart_mm or apart < apart_mm + _APART_MM


def _left(model: Model, runs: Sequence[Observation]) -> list[Array]:
    """Return the residuals (m, k) mm of runs with their set-ups fitted."""
    return residuals_of(model, runs, fit_setups([(model, observation) for observation in runs]))

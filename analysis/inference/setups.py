"""Set-ups: their terms, their fit to a frozen model, which runs share one, and parts of runs to judge by.

Runs of one placement share a set-up unless their readings show that something was moved. What judges a fit is left out
before: readings at random, or whole neighbourhoods of joint space.

"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from analysis.geometry.rigid import best_rigid, moved_by
from analysis.inference.observation import (
    Observation,
    ObservedRun,
    observe,
    predicted,
    predicted_in_scene,
    residuals_of,
    rms,
    thinned,
    with_placement,
)
from analysis.kinematics.arm import Arm, Array, Integers, arm_of
from analysis.model.predict import Model, SetUp, model_of, moved, nominal_setup
from analysis.model.scene import Scene
from analysis.noise.cell import BALL_MM, JOINT_DEG
from analysis.traces.loading import Measured
from analysis.traces.tables import CircleTable, PlaceTable, PoseTable, Table, TouchTable
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig

# ----------------------------------------------------------------------------------------------------------------------
# Set-ups: their terms, how they are changed, and how they are fitted while a model is frozen.
#
# The terms of a set-up are numbers in mm: the ball's position and the zeros of the gauges; for poses the position of
# the instrument, its rotation (in mm at a distance of 100 mm) and the position of its target; for touches the position
# of the socket, as an instrument that is not turned, and that of the ball on the tool.

_REACH_MM = 100.0
"""Distance at which the rotation of an instrument is expressed in mm. It scales the unknowns and has no effect on the
result."""
_STEP_MM = 0.01
"""Step of the derivatives by a set-up term. Readings are linear over such a step."""
_ROUNDS = 30
"""Largest number of Gauss-Newton steps. Chosen: a set-up 20 mm off needs twenty steps of 1 mm."""
_ENOUGH_MM = 1e-4
"""Change below which a set-up has converged: a tenth of a micrometre, below the resolution of any gauge."""
_FURTHEST_MM = 1.0
"""Longest step of a ball. Its height at the centre of a circle has no effect, so the derivatives do not bound it.
Instruments start far off and have no such term."""
BALL_PRIOR_MM = 5.0
"""Prior standard deviation of a ball's position: a weak prior that decides only what the readings do not determine,
such as the height above the plane of a circle, where a wrong model would move it far."""
_STRAIGHT_MM = 0.2
"""Step above which the derivatives are computed again. Chosen: a change of 0.2 mm turns the link by 0.2° at most."""


Parts = Sequence[tuple[Model, Observation]]


def terms_of(table: Table) -> int:
    """Return the number of terms that a set-up of a table's test has."""
    if isinstance(table, PlaceTable):
        return frame_terms(table) + 3
    return 5 if isinstance(table, CircleTable) else 4


def frame_terms(table: PlaceTable) -> int:
    """Return the number of the first terms of a set-up of places, those of the instrument or of the socket; the others
    are those of the target or ball on the tool, which all placements of a test share."""
    return 6 if isinstance(table, PoseTable) else 3


def moved_setup(setup: SetUp, table: Table, change: Array) -> SetUp:
    """Return a set-up with its terms changed by (terms,) mm."""
    if isinstance(table, PlaceTable):
        target = setup.T_tool_target.copy()
        frame = frame_terms(table)
        target[:3, 3] += change[frame:]
        turn = change[3:6] / _REACH_MM if frame > 3 else np.zeros(3)
        instrument = moved_by(setup.T_instrument_world, change[:3], turn)
        return replace(setup, T_instrument_world=instrument, T_tool_target=target)
    return replace(setup, ball=setup.ball + change[:3], zeros_mm=setup.zeros_mm + change[3:])


def columns_of(tables: Mapping[str, Table]) -> dict[str, list[int]]:
    """Return the indices of the unknowns that are the terms of each set-up; all placements of poses, and all
    sockets of touches, share those of the tool."""
    columns: dict[str, list[int]] = {}
    tools: dict[type[Table], list[int]] = {}
    count = 0
    for name, table in tables.items():
        own = list(range(count, count + (frame_terms(table) if isinstance(table, PlaceTable) else terms_of(table))))
        count += len(own)
        if isinstance(table, PlaceTable) and type(table) not in tools:
            tools[type(table)] = list(range(count, count + 3))
            count += 3
        columns[name] = own + tools.get(type(table), [])
    return columns


def tool_shift(one: Observation, before: Scene, after: Scene) -> Array:
    """Return how far (3,) mm the tool moves at the readings of an observation, on the mean, from one scene to another.

    The ball of a circle or hemisphere moves with it, because people set a ball up where the tool really goes round it.
    """
    rows = one.rows if one.path.alone else one.samples
    shift: Array = (after.T[rows, :3, 3] - before.T[rows, :3, 3]).mean(axis=0)
    return shift


def _starting_setups(parts: Parts) -> list[SetUp]:
    """Return where the ball of a circle or hemisphere may have been set up: moved as far as the model's effects move
    the tool, or at its nominal place, where it still is after a collision and in simulated runs.

    A fit could not find this by itself: a ball along the normal of its circle hardly shows, but where it stands decides
    how steep the link is. A zero that is wrong by 1.6° moved the circle by 18 mm.
    """
    model, one = parts[0]
    nominal = nominal_setup(model.rig, one.table)
    if not model.effects:
        return [nominal]
    shift = tool_shift(one, moved(replace(model, effects=()), one.path), moved(model, one.path))
    there = replace(nominal, ball=nominal.ball + shift)
    return [there, nominal] if np.abs(shift).max() > _FURTHEST_MM else [there]


def fit_setups(parts: Parts, setups: Mapping[str, SetUp] | None = None) -> dict[str, SetUp]:
    """Return set-ups fitted to observations of (m, k) mm, each with its model unchanged, starting from `setups` where
    given.

    The method is Gauss-Newton in short steps, since readings are nearly linear over a millimetre. Placements of poses
    are fitted together, with one tool.
    """
    named: dict[str, list[tuple[Model, Observation]]] = {}
    for model, one in parts:
        named.setdefault(one.setup, []).append((model, one))
    starting = {name: setups[name] for name in named if setups and name in setups}
    places = {
        kind: [name for name, own in named.items() if isinstance(own[0][1].table, kind)]
        for kind in (PoseTable, TouchTable)
    }
    for own_names in places.values():
        starting |= _starting_pose_setups({name: named[name] for name in own_names}, starting)
    poses = [name for own_names in places.values() for name in own_names]
    found: dict[str, SetUp] = {}
    for name, own in named.items():
        if name not in poses:
            starts = [starting[name]] if name in starting else _starting_setups(own)
            fits = [_placed(own, {name: start})[name] for start in starts]
            found[name] = min(fits, key=partial(_energy, own)) if len(fits) > 1 else fits[0]
    if poses:
        together = [part for name in poses for part in named[name]]
        found |= _placed(together, {name: starting[name] for name in poses})
    return {name: found[name] for name in named}


def _energy(parts: Parts, setup: SetUp) -> float:
    """Return the sum of squares in mm² of what a set-up leaves of its observations."""
    return sum(float(np.sum((one.values - predicted(model, one, setup)) ** 2)) for model, one in parts)


def _starting_pose_setups(named: Mapping[str, Parts], starting: Mapping[str, SetUp]) -> dict[str, SetUp]:
    """Return starting set-ups for placements of poses without one: with the tool of a placement that has one, or else
    of that with most poses, and instruments where their readings place them."""
    new = [name for name in named if name not in starting]
    if not new:
        return {}
    found: dict[str, SetUp] = {}
    known = next((starting[name] for name in named if name in starting), None)
    if known is None:
        most = max(new, key=lambda name: sum(one.values.size for _, one in named[name]))
        model, one = named[most][0]
        start = at_instrument(nominal_setup(model.rig, one.table), named[most])
        known = _placed(named[most], {most: start})[most] if len(new) > 1 else start
        found[most] = known
    return found | {name: at_instrument(known, named[name]) for name in new if name not in found}


def at_instrument(setup: SetUp, parts: Parts) -> SetUp:
    """Return a set-up with its instrument at the place from which the poses, of (m, 3) mm, were measured: the best
    rigid motion, with the tool as it is."""
    bare = replace(setup, T_instrument_world=np.eye(4))
    places = np.concatenate([predicted(model, one, bare) for model, one in parts])
    seen_there = np.concatenate([one.values for _, one in parts])
    if isinstance(parts[0][1].table, TouchTable):  # a socket has a place and no turn
        socket = np.eye(4)
        socket[:3, 3] = (seen_there - places).mean(axis=0)
        return replace(bare, T_instrument_world=socket)
    return replace(bare, T_instrument_world=best_rigid(places, seen_there))


def _placed(parts: Parts, starts: Mapping[str, SetUp]) -> dict[str, SetUp]:
    """Return set-ups that share terms, fitted together from their starting values."""
    tables = {one.setup: one.table for _, one in parts}
    columns = columns_of(tables)
    poses, count = isinstance(parts[0][1].table, PlaceTable), 1 + max(map(max, columns.values()))
    scenes = [moved(model, one.path) for model, one in parts]

    def at(change: Array) -> dict[str, SetUp]:
        return {name: moved_setup(starts[name], table, change[columns[name]]) for name, table in tables.items()}

    def left(change: Array) -> Array:
        placed = at(change)
        return np.concatenate([
            (one.values - predicted_in_scene(model, one, scene, placed[one.setup])).ravel()
            for (model, one), scene in zip(parts, scenes, strict=True)
        ])  # fmt: skip

    ball = np.arange(count) < (0 if poses else 3)
    so_far, change, J = np.zeros(count), np.zeros(count), np.empty(0)
    for turn in range(_ROUNDS):
        r = left(so_far)
        if turn == 0 or np.abs(change).max() > _STRAIGHT_MM:
            J = np.stack([(r - left(step)) / _STEP_MM for step in so_far + _STEP_MM * np.eye(count)], axis=1)
        # A ball at the limit of its prior costs as much as what set-ups cannot fit. With all of the residual in place
        # of that, a ball that is a centimetre off would stay there.
        kept = r - J @ np.linalg.lstsq(J, r)[0]
        held = np.where(ball, (kept @ kept) / BALL_PRIOR_MM**2, 1e-12)
        change = np.linalg.solve(J.T @ J + np.diag(held), J.T @ r - held * so_far)
        if not poses:
            change *= min(1.0, _FURTHEST_MM / max(float(np.abs(change).max()), 1e-12))
        so_far = so_far + change
        if np.abs(change).max() < _ENOUGH_MM:
            break
    return at(so_far)


# ----------------------------------------------------------------------------------------------------------------------
# Placements: runs of one test and placement share a set-up unless their readings show that something was moved.
#
# A placement has a name if the user gave one when the run was recorded or imported; otherwise the readings decide.
# Circles of one direction repeat each other, so model errors displace their balls equally, and two balls further
# apart than the scatter of a real cell were mounted separately. A play moves the ball of one direction relative to
# that of the other, so frames of both directions are only matched. Runs at targets, and poses, that cannot share one
# rigid frame have far larger residuals together than each alone. Poses of all placements share the tool, so that a
# placement of few poses needs only its frame from them.

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
    tool_known = {type(one.table) for one in observations if _spare(observations, one.setup) > 0}
    reasons: dict[str, str] = {}
    for one in observations:
        shares = isinstance(one.table, PlaceTable) and type(one.table) in tool_known
        terms = terms_of(one.table) - 3 * shares
        readings = _readings(observations, one.setup)
        if readings <= terms:
            reasons[one.setup] = f"its {readings} readings are too few for the {terms} terms of the set-up alone"
    kept = [k for k, one in enumerate(observations) if one.setup not in reasons]
    if not kept:
        setup, why = next(iter(reasons.items()))
        raise FileError(f"set-up {setup}", why, "give more runs of it, or more readings in each")
    return kept, [f"{setup} is left out: {why}" for setup, why in reasons.items()]


def same_arm(one: Arm, other: Arm) -> bool:
    """Whether two arms have the same link constants and couplings, and rails."""
    rail, other_rail = (np.zeros(3) if arm.rail is None else arm.rail for arm in (one, other))
    return np.allclose(rail, other_rail, atol=1e-9) and all(
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


# ----------------------------------------------------------------------------------------------------------------------
# Set-ups of observed runs, fitted with the model frozen, both before a diagnosis and wherever a model is judged.


def with_effects(runs: Sequence[ObservedRun], effects: Sequence[Effect]) -> list[ObservedRun]:
    """Return the runs with effects added to their models."""
    return [replace(run, model=replace(run.model, effects=(*run.model.effects, *effects))) for run in runs]


def fit_run_setups(
    runs: Sequence[ObservedRun], setups: Mapping[str, SetUp] | None = None
) -> tuple[dict[str, SetUp], list[Array]]:
    """Return the fitted set-ups of runs, starting from `setups` where given, and the residuals (m, k) mm of
    each run."""
    placed = fit_setups([(run.model, run.one) for run in runs], setups)
    return placed, [residuals_of(run.model, [run.one], placed)[0] for run in runs]


# ----------------------------------------------------------------------------------------------------------------------
# Poses held out to judge a fit: whole neighbourhoods of joint space (k-means of the joint angles).
#
# Neighbours share what a model cannot express, so that held-out single poses would overestimate its quality. A
# neighbourhood is a place that the model has not seen.

GROUPS = 20
"""Number of neighbourhoods of joint space. Chosen: few enough for several poses in each, and enough for five folds."""
_FEWEST_OF_A_GROUP = 5
"""Smallest average number of places in a neighbourhood. Chosen: k-means needs a few for a centre."""
FEWEST_PLACES = 3 * GROUPS
"""Number of poses below which they are few, and no neighbourhood is held out. Chosen: k-means needs a few poses for a
centre."""


def constants_apart(observations: Sequence[Observation]) -> bool:
    """Return whether an arm's constants have widths of their own beside readings of (m, k) mm: where touches alone show
    them, and where places are too few to name those that are larger than usual. Of 30 poses of a UR10 constants of
    usual size leave a tenth more."""
    of_touches = all(isinstance(one.table, TouchTable) for one in observations)
    of_poses = all(isinstance(one.table, PlaceTable) for one in observations)
    return of_touches or (of_poses and sum(len(one.rows) for one in observations) < FEWEST_PLACES)


def part(one: Observation, keep: NDArray[np.bool_]) -> Observation:
    """Return an observation with the readings (m, k) of the mask `keep` (m,); the path, and with it the approach to
    each pose, stays complete."""
    return replace(one, rows=one.rows[keep], values=one.values[keep])


def neighbourhoods(q: Array, rng: np.random.Generator) -> Integers:
    """Return the neighbourhood of each reading (n,) by k-means of its joint angles q (n, 6) rad; visits of one place
    stay together."""
    from scipy.cluster.vq import kmeans2  # noqa: PLC0415 - slow to import, needed here only

    places, place = _places(q)
    _, group = kmeans2(places, min(GROUPS, max(1, len(places) // _FEWEST_OF_A_GROUP)), minit="++", rng=rng)
    return np.asarray(group[place], dtype=np.int64)


def _places(q: Array) -> tuple[Array, Integers]:
    """Return the different places (p, 6) rad of joint angles q (n, 6) rad, and which (n,) of them each row is."""
    places, place = np.unique(np.round(q, 3), axis=0, return_inverse=True)
    return places, np.asarray(place.ravel(), dtype=np.int64)


def folds_of(q: Array, folds: int) -> Integers:
    """Return the fold of each pose (n,) with joint angles q (n, 6) rad. Whole neighbourhoods are assigned, the largest
    first, each to the smallest fold."""
    group = neighbourhoods(q, np.random.default_rng(0))
    fold, filled = np.zeros(len(q), dtype=np.int64), np.zeros(folds)
    for number in np.argsort(-np.bincount(group, minlength=GROUPS)):
        k = int(np.argmin(filled))
        fold[group == number] = k
        filled[k] += np.count_nonzero(group == number)
    return fold


def without_a_fold(
    runs: Sequence[ObservedRun], folds: int = 5, fold: int = 0
) -> tuple[list[ObservedRun], list[ObservedRun]]:
    """Return runs of poses without one fold of their neighbourhoods, and the runs of that fold. Other runs, and runs of
    few poses, or of few that are visited often as a cube's, stay whole."""
    used, left_out = [], []
    for run in runs:
        q = run.one.table.q[run.one.rows]
        few = len(q) < FEWEST_PLACES or len(_places(q)[0]) < folds * _FEWEST_OF_A_GROUP
        if not isinstance(run.one.table, PlaceTable) or few:
            used.append(run)
            continue
        out = folds_of(q, folds) == fold
        used.append(replace(run, one=part(run.one, ~out)))
        left_out.append(replace(run, one=part(run.one, out)))
    return used, left_out

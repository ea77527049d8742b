"""Set-ups: their terms, their fit to a frozen model, which runs share one, and parts of runs to judge by.

Runs of one placement share a set-up unless their readings show that something was moved. What judges a fit is left out
before: readings at random, or whole neighbourhoods of joint space.

"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, part, predicted, predicted_in_scene, residual_of, rms
from analysis.procedures.facts import facts_of
from analysis.procedures.prediction import nominal_setup
from analysis.robot.geometry.pose_setup import best_rigid, moved_by
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.model.predict import SetUp, moved
from analysis.robot.model.scene import Scene
from analysis.runs.parts_of_tests import TESTS
from analysis.runs.tables import Table
from rigs.effects import Effect

# ----------------------------------------------------------------------------------------------------------------------
# Set-ups: their terms, how they are changed, and how they are fitted while a model is frozen.
#
# The terms of a set-up are numbers in mm: the ball's position and the zeros of the gauges; for poses the position of
# the instrument, its rotation (in mm at a distance of 100 mm) and the position of its target; for touches the position
# of the socket, as an instrument that is not turned, and that of the ball on the tool.
#
# All placements of poses share the tool's target, unless the data prove that it sat elsewhere: a reflector in another
# nest. Such runs name their target behind the placement, and share its place alone.

_REACH_MM = 100.0
"""Distance at which the rotation of an instrument is expressed in mm. It scales the unknowns and has no effect on the
result."""
_STEP_MM = 0.01
"""Step of the derivatives by a set-up term, within the linear range."""
_MOST_STEPS = 30
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


_TARGET = "; target "
"""Between the name of a placement and the number of its target on the tool, from 2 on."""


FRAME = ", frame "
"""Between the name of a placement and the number of a frame that its runs showed, from 2 on."""


def placement_of(setup: str) -> str:
    """Return the name of the placement of a set-up, without that of its target."""
    return setup.partition(_TARGET)[0]


def target_of(setup: str) -> str:
    """Return the target of a set-up, empty for the first or only one."""
    return setup.partition(_TARGET)[2]


def targeted(setup: str, target: str) -> str:
    """Return the name of a set-up with a target, empty for the first or only one."""
    return f"{setup}{_TARGET}{target}" if target else setup


def moved_setup(setup: SetUp, table: Table, change: Array) -> SetUp:
    """Return a set-up with its terms changed by (terms,) mm."""
    if facts_of(table.test).of_places:
        target = setup.T_tool_target.copy()
        frame = facts_of(table.test).frame_terms
        target[:3, 3] += change[frame:]
        turn = change[3:6] / _REACH_MM if frame > 3 else np.zeros(3)
        instrument = moved_by(setup.T_instrument_world, change[:3], turn)
        return replace(setup, T_instrument_world=instrument, T_tool_target=target)
    return replace(setup, ball=setup.ball + change[:3], zeros_mm=setup.zeros_mm + change[3:])


def columns_of(tables: Mapping[str, Table]) -> dict[str, list[int]]:
    """Return the indices of the unknowns that are the terms of each set-up; all placements of poses with one target,
    and all sockets of touches, share those of the tool, and all targets of one placement those of the instrument."""
    shared: dict[tuple[str, str], list[int]] = {}
    columns: dict[str, list[int]] = {}
    for name, table in tables.items():
        if facts_of(table.test).of_places:
            parts = [("", placement_of(name), facts_of(table.test).frame_terms), (table.test, target_of(name), 3)]
        else:
            parts = [("", name, facts_of(table.test).setup_terms)]
        columns[name] = []
        for kind, part_name, terms in parts:
            first = sum(map(len, shared.values()))
            columns[name] += shared.setdefault((kind, part_name), list(range(first, first + terms)))
    return columns


def tool_shift(run: ObservedRun, before: Scene, after: Scene) -> Array:
    """Return how far (3,) mm the tool moves at the readings of a run, on the mean, from one scene to another.

    The ball of a circle or hemisphere moves with it, because people set a ball up where the tool really goes round it.
    """
    rows = run.rows if run.path.alone else run.samples
    return np.asarray((after.T[rows, :3, 3] - before.T[rows, :3, 3]).mean(axis=0), dtype=float)


def _starting_setups(run: ObservedRun) -> list[SetUp]:
    """Return where the ball of a circle or hemisphere may have been set up: moved as far as the model's effects move
    the tool, or at its nominal place, where it still is after a collision and in simulated runs.

    A fit could not find this by itself: a ball along the normal of its circle hardly shows, but where it stands decides
    how steep the link is. A zero that is wrong by 1.6° moved the circle by 18 mm.
    """
    model, nominal = run.model, nominal_setup(run.model.rig, run.table)
    if not model.effects:
        return [nominal]
    shift = tool_shift(run, moved(replace(model, effects=()), run.path), moved(model, run.path))
    with_tool = replace(nominal, ball=nominal.ball + shift)
    return [with_tool, nominal] if np.abs(shift).max() > _FURTHEST_MM else [with_tool]


def fit_setups(runs: Sequence[ObservedRun], setups: Mapping[str, SetUp] | None = None) -> dict[str, SetUp]:
    """Return set-ups fitted to runs of (m, k) mm, each with its model unchanged, starting from `setups` where
    given.

    The method is Gauss-Newton in short steps, since readings are nearly linear over a millimetre. Placements of poses
    are fitted together, with one tool.
    """
    named: dict[str, list[ObservedRun]] = {}
    for run in runs:
        named.setdefault(run.setup, []).append(run)
    starting = {name: setups[name] for name in named if setups and name in setups}
    places = {
        test: [name for name, members in named.items() if members[0].table.test == test]
        for test in TESTS
        if facts_of(test).of_places
    }
    for own_names in places.values():
        starting |= _starting_pose_setups({name: named[name] for name in own_names}, starting)
    poses = [name for own_names in places.values() for name in own_names]
    fitted: dict[str, SetUp] = {}
    for name, members in named.items():
        if name not in poses:
            starts = [starting[name]] if name in starting else _starting_setups(members[0])
            fits = [_placed(members, {name: start})[name] for start in starts]
            energies = [
                sum(float(np.sum(residual_of(run, {name: setup}) ** 2)) for run in members)
                for setup in (fits if len(fits) > 1 else ())
            ]
            fitted[name] = fits[int(np.argmin(energies))] if energies else fits[0]
    if poses:
        together = [run for name in poses for run in named[name]]
        fitted |= _placed(together, {name: starting[name] for name in poses})
    return {name: fitted[name] for name in named}


def _starting_pose_setups(
    named: Mapping[str, Sequence[ObservedRun]], starting: Mapping[str, SetUp]
) -> dict[str, SetUp]:
    """Return starting set-ups for placements of poses without one: with the target of a placement that has one, or else
    of that with most poses, and instruments where their readings place them."""
    by_size = sorted(named, key=lambda name: -sum(run.values.size for run in named[name]))
    placed = {name: starting[name] for name in named if name in starting}
    for name in by_size:
        if name in placed:
            continue
        same_tool = next(
            (setup for other_name, setup in placed.items() if target_of(other_name) == target_of(name)), None
        )
        same_place = next(
            (setup for other_name, setup in placed.items() if placement_of(other_name) == placement_of(name)), None
        )
        run = named[name][0]
        if same_tool and same_place:
            placed[name] = replace(same_tool, T_instrument_world=same_place.T_instrument_world)
        elif same_tool:
            placed[name] = at_instrument(same_tool, named[name])
        elif same_place:
            placed[name] = _at_target(same_place, named[name])
        else:
            start = at_instrument(nominal_setup(run.model.rig, run.table), named[name])
            placed[name] = _placed(named[name], {name: start})[name] if len(named) > 1 else start
    return {name: setup for name, setup in placed.items() if name not in starting}


def _at_target(setup: SetUp, runs: Sequence[ObservedRun]) -> SetUp:
    """Return a set-up with its target where the poses, of (m, 3) mm, show it on the tool, with the instrument as it
    is; a place depends on it linearly."""
    bare = replace(setup, T_tool_target=np.eye(4))
    steps = [replace(bare, T_tool_target=_at(step)) for step in np.eye(3)]
    zero, *moved_by_step = (np.concatenate([predicted(run, place).ravel() for run in runs]) for place in (bare, *steps))
    seen_there = np.concatenate([run.values.ravel() for run in runs])
    slopes = np.stack([column - zero for column in moved_by_step], axis=1)
    return replace(setup, T_tool_target=_at(np.linalg.lstsq(slopes, seen_there - zero, rcond=None)[0]))


def _at(place: Array) -> Array:
    """Return the frame (4, 4) at a place (3,) mm, not turned."""
    frame = np.eye(4)
    frame[:3, 3] = place
    return frame


def at_instrument(setup: SetUp, runs: Sequence[ObservedRun]) -> SetUp:
    """Return a set-up with its instrument at the place from which the poses, of (m, 3) mm, were measured: the best
    rigid motion, with the tool as it is."""
    bare = replace(setup, T_instrument_world=np.eye(4))
    places = np.concatenate([predicted(run, bare) for run in runs])
    seen_there = np.concatenate([run.values for run in runs])
    if facts_of(runs[0].table.test).frame_terms == 3:  # a socket has a place and no turn
        return replace(bare, T_instrument_world=_at((seen_there - places).mean(axis=0)))
    return replace(bare, T_instrument_world=best_rigid(places, seen_there))


def _placed(runs: Sequence[ObservedRun], starts: Mapping[str, SetUp]) -> dict[str, SetUp]:
    """Return set-ups that share terms, fitted together from their starting values."""
    tables = {run.setup: run.table for run in runs}
    columns = columns_of(tables)
    poses, count = facts_of(runs[0].table.test).of_places, 1 + max(map(max, columns.values()))
    scenes = [moved(run.model, run.path) for run in runs]

    def at(change: Array) -> dict[str, SetUp]:
        return {name: moved_setup(starts[name], table, change[columns[name]]) for name, table in tables.items()}

    def residual(change: Array) -> Array:
        placed = at(change)
        return np.concatenate([
            (run.values - predicted_in_scene(run.model, run, scene, placed[run.setup])).ravel()
            for run, scene in zip(runs, scenes, strict=True)
        ])  # fmt: skip

    ball = np.arange(count) < (0 if poses else 3)
    so_far, change, J = np.zeros(count), np.zeros(count), np.empty(0)
    for turn in range(_MOST_STEPS):
        r = residual(so_far)
        if turn == 0 or np.abs(change).max() > _STRAIGHT_MM:
            J = np.stack([(r - residual(step)) / _STEP_MM for step in so_far + _STEP_MM * np.eye(count)], axis=1)
        # A ball at the limit of its prior costs as much as what set-ups cannot fit. With all of the residual in place
        # of that, a ball that is a centimetre off would stay there.
        kept = r - J @ np.linalg.lstsq(J, r)[0]
        prior = np.where(ball, (kept @ kept) / BALL_PRIOR_MM**2, 1e-12)
        change = np.linalg.solve(J.T @ J + np.diag(prior), J.T @ r - prior * so_far)
        if not poses:
            change *= min(1.0, _FURTHEST_MM / max(float(np.abs(change).max()), 1e-12))
        so_far = so_far + change
        if np.abs(change).max() < _ENOUGH_MM:
            break
    return at(so_far)


# ----------------------------------------------------------------------------------------------------------------------
# Set-ups of observed runs, fitted with the model frozen, both before a diagnosis and wherever a model is judged.


def with_effects(runs: Sequence[ObservedRun], effects: Sequence[Effect]) -> list[ObservedRun]:
    """Return the runs with effects added to their models."""
    return [replace(run, model=replace(run.model, effects=(*run.model.effects, *effects))) for run in runs]


def fit_run_setups(
    runs: Sequence[ObservedRun], setups: Mapping[str, SetUp] | None = None
) -> tuple[dict[str, SetUp], list[Array]]:
    """Return the fitted set-ups of runs, starting from `setups` where given, and the residuals (m, k) mm of
    each run, of a circle on its lap."""
    on_laps = [run.on_lap for run in runs]
    placed = fit_setups(on_laps, setups)
    return placed, [residual_of(run, placed) for run in on_laps]


@dataclass(frozen=True, eq=False)
class FittedRuns:
    """Runs, of (m, k) mm, whose set-ups are fitted beside effects of the arm; what was fitted once is kept."""

    runs: Sequence[ObservedRun]
    _fits: dict[tuple[Effect, ...], tuple[dict[str, SetUp], list[Array]]] = field(
        default_factory=dict, init=False, repr=False
    )

    def beside(self, effects: Sequence[Effect]) -> tuple[dict[str, SetUp], list[Array]]:
        """Return the set-ups and the residuals (m, k) mm of each run, with effects added to its model."""
        key = tuple(map(without_origin, effects))
        if key not in self._fits:
            self._fits[key] = fit_run_setups(with_effects(self.runs, effects))
        return self._fits[key]

    def residual_um(self, effects: Sequence[Effect]) -> float:
        """Return the rms residual in µm with effects added to the model."""
        return 1e3 * rms(self.beside(effects)[1])


def without_origin(effect: Effect) -> Effect:
    """Return the effect without its origin, which changes no reading and has no hash."""
    return effect if effect.found is None else effect.model_copy(update={"found": None})


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


def constants_apart(runs: Sequence[ObservedRun]) -> bool:
    """Return whether an arm's constants have widths of their own beside readings of (m, k) mm: where touches alone show
    them, and where places are too few to name those that are larger than usual. Of 30 poses of a UR10 constants of
    usual size leave a tenth more."""
    of_touches = all(facts_of(run.table.test).constants_apart for run in runs)
    of_poses = all(facts_of(run.table.test).of_places for run in runs)
    return of_touches or (of_poses and sum(len(run.rows) for run in runs) < FEWEST_PLACES)


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
        q = run.table.q[run.rows]
        # Poses that were left out as wild make no run of sixty one of few.
        few = len(run.table.q) < FEWEST_PLACES or len(_places(q)[0]) < folds * _FEWEST_OF_A_GROUP
        if not facts_of(run.table.test).of_places or few:
            used.append(run)
            continue
        out = folds_of(q, folds) == fold
        used.append(part(run, ~out))
        left_out.append(part(run, out))
    return used, left_out

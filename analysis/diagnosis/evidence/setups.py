"""Set-ups: their terms, their fit to a fixed model, sharing between runs, and parts of runs for validation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, part, predicted, predicted_in_scene, residual_of, rms
from analysis.procedures.shared.test_kind import facts_of, nominal_setup
from analysis.robot.geometry.pose_setup import best_rigid, frame, moved_by
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.predict import ModelScene, SetUp, SetUps, moved
from analysis.runs.tables import Table
from rigs.effects import Effect

# ----------------------------------------------------------------------------------------------------------------------
# Set-ups: their terms, changes, and fit to a fixed model.
#
# The terms of a set-up are numbers in mm. For gauges they are the ball's position and the zeros of the gauges. For
# poses they are the position of the instrument, its rotation (in mm at a distance of 100 mm) and the position of its
# target. For touches they are the position of the socket, treated as an instrument with no rotation, and that of the
# ball on the tool.
#
# All placements of poses share the tool's target, unless the data prove a different position: a reflector in a
# different nest. The set-up names of such runs include the target after the placement, and share only the place of the
# instrument.

_REACH_MM = 100.0
"""Distance at which the rotation of an instrument is expressed in mm, without influence on the result."""
STEP_MM = 0.01
"""Step of the derivatives by a set-up term, within the linear range."""
_MOST_STEPS = 30
"""Largest number of Gauss-Newton steps. Chosen: a set-up 20 mm off needs twenty steps of 1 mm."""
_ENOUGH_MM = 1e-4
"""Change below which a set-up has converged, below the resolution of any gauge."""
_FURTHEST_MM = 1.0
"""Largest displacement of a ball in a step: the derivatives do not limit its height at the centre of a circle."""
BALL_PRIOR_MM = 5.0
"""Prior standard deviation of a ball's position. It decides only undetermined terms, such as the height above the plane
of a circle, which a wrong model would otherwise shift far.
"""
_STRAIGHT_MM = 0.2
"""Step above which the derivatives are recomputed. Chosen: it turns the link by 0.2° at most."""


_TARGET = "; target "
"""Separator between the name of a placement and the number of its target on the tool, from 2 on."""


FRAME = ", frame "
"""Separator between the name of a placement and the number of a frame shown by its runs, from 2 on."""


def placement_of(setup: str) -> str:
    return setup.partition(_TARGET)[0]


def target_of(setup: str) -> str:
    return setup.partition(_TARGET)[2]


def targeted(setup: str, target: str) -> str:
    return f"{setup}{_TARGET}{target}" if target else setup


def moved_setup(setup: SetUp, table: Table, change: Array) -> SetUp:
    """The set-up with its terms changed by (terms,) mm."""
    facts = facts_of(table.test)
    if not facts.of_places:
        return replace(setup, ball=setup.ball + change[:3], zeros_mm=setup.zeros_mm + change[3:])
    target = setup.T_tool_target.copy()
    target[:3, 3] += change[facts.frame_terms :]
    turn = change[3:6] / _REACH_MM if facts.frame_terms > 3 else np.zeros(3)
    instrument = moved_by(setup.T_instrument_world, change[:3], turn)
    return replace(setup, T_instrument_world=instrument, T_tool_target=target)


def columns_of(tables: Mapping[str, Table]) -> dict[str, list[int]]:
    """Indices of the unknowns for the terms of each set-up.

    All placements of poses with the same target, and all sockets of touches, share the terms of the tool. All targets
    of the same placement share the terms of the instrument.
    """
    shared: dict[tuple[str, str], list[int]] = {}
    columns: dict[str, list[int]] = {}
    for name, table in tables.items():
        facts, parts = facts_of(table.test), [("", name, facts_of(table.test).setup_terms)]
        if facts.of_places:
            parts = [("", placement_of(name), facts.frame_terms), (table.test, target_of(name), 3)]
        columns[name] = []
        for kind, part_name, terms in parts:
            first = sum(map(len, shared.values()))
            columns[name] += shared.setdefault((kind, part_name), list(range(first, first + terms)))
    return columns


def tool_shift(run: ObservedRun, before: ModelScene, after: ModelScene) -> Array:
    """Mean displacement (3,) mm of the tool at the readings of a run between two scenes. Operators set up a ball at the
    actual centre of the tool motion.
    """
    rows = run.rows if run.path.alone else run.samples
    return np.asarray((after.T[rows, :3, 3] - before.T[rows, :3, 3]).mean(axis=0), dtype=float)


def _starting_setups(run: ObservedRun) -> list[SetUp]:
    """Possible positions of the ball of a circle or hemisphere: displaced like the tool by the model's effects, or, as
    after a collision, nominal. A fit does not find the position along the normal of the circle, which is hardly
    visible.
    """
    model, nominal = run.model, nominal_setup(run.model.rig, run.table)
    if not model.effects:
        return [nominal]
    shift = tool_shift(run, moved(replace(model, effects=()), run.path), moved(model, run.path))
    with_tool = replace(nominal, ball=nominal.ball + shift)
    return [with_tool, nominal] if np.abs(shift).max() > _FURTHEST_MM else [with_tool]


def fit_setups(runs: Sequence[ObservedRun], setups: SetUps | None = None) -> dict[str, SetUp]:
    """Fit set-ups to runs with fixed models, starting from `setups` if given.

    The method is Gauss-Newton in short steps. Placements of poses are fitted together, with a common tool.
    """
    named: dict[str, list[ObservedRun]] = {}
    by_test: dict[str, dict[str, list[ObservedRun]]] = {}
    for run in runs:
        named.setdefault(run.setup, []).append(run)
        if run.facts.of_places:
            by_test.setdefault(run.table.test, {})[run.setup] = named[run.setup]
    known = {name: setups[name] for name in named if setups and name in setups}
    starting = dict(known)
    for of_test in by_test.values():
        starting |= _starting_pose_setups(of_test, known)
    poses = [run for of_test in by_test.values() for members in of_test.values() for run in members]
    fitted = _placed(poses, starting) if poses else {}
    for name in [name for name in named if name not in fitted]:
        members = named[name]
        starts = [known[name]] if name in known else _starting_setups(members[0])
        fits = [_placed(members, {name: start}) for start in starts]
        best: dict[str, SetUp] = min(fits, key=lambda fit: rms([residual_of(run, fit) for run in members]))
        fitted |= best
    return {name: fitted[name] for name in named}


def _starting_pose_setups(named: Mapping[str, Sequence[ObservedRun]], starting: SetUps) -> dict[str, SetUp]:
    """Initial set-ups for placements of poses, those in `starting` unchanged.

    The target is taken from a placement with the same target, or else from the rig file; the placement with most poses
    corrects it first. Instruments are located by their readings.
    """
    by_size = sorted(named, key=lambda name: -sum(run.values.size for run in named[name]))
    placed = {name: starting[name] for name in named if name in starting}
    for name in by_size:
        if name not in placed:
            runs, target = named[name], target_of(name)
            alike = next((setup for other, setup in placed.items() if target_of(other) == target), None)
            bare = replace(alike or nominal_setup(runs[0].model.rig, runs[0].table), T_instrument_world=np.eye(4))
            places = np.concatenate([predicted(run, bare) for run in runs])
            seen_there = np.concatenate([run.values for run in runs])
            T = frame(np.eye(3), (seen_there - places).mean(axis=0))
            if runs[0].facts.frame_terms > 3:  # a socket has no rotation
                T = best_rigid(places, seen_there)
            start = replace(bare, T_instrument_world=T)
            is_first = not placed and len(named) > 1
            placed[name] = _placed(runs, {name: start})[name] if is_first else start
    return placed


def _placed(runs: Sequence[ObservedRun], starts: SetUps) -> dict[str, SetUp]:
    """Fit set-ups that share terms together."""
    tables = {run.setup: run.table for run in runs}
    columns = columns_of(tables)
    poses, count = runs[0].facts.of_places, 1 + max(map(max, columns.values()))
    observed = [(run, moved(run.model, run.path)) for run in runs]

    def residual_at(run: ObservedRun, scene: ModelScene, terms: Array) -> Array:
        setup = moved_setup(starts[run.setup], run.table, terms)
        return (run.values - predicted_in_scene(run.model, run, scene, setup)).ravel()

    def slopes(run: ObservedRun, scene: ModelScene, terms: Array) -> Array:
        steps = [terms, *(terms + STEP_MM * np.eye(len(terms)))]
        unmoved, *moved_by_step = (residual_at(run, scene, step) for step in steps)
        J = np.zeros((len(unmoved), count))  # zero for the terms of other set-ups
        J[:, columns[run.setup]] = (unmoved[:, None] - np.stack(moved_by_step, axis=1)) / STEP_MM
        return J

    ball = np.arange(count) < (0 if poses else 3)
    so_far, change, J = np.zeros(count), np.zeros(count), np.empty(0)
    for turn in range(_MOST_STEPS):
        r = np.concatenate([residual_at(run, scene, so_far[columns[run.setup]]) for run, scene in observed])
        if turn == 0 or np.abs(change).max() > _STRAIGHT_MM:
            J = np.concatenate([slopes(run, scene, so_far[columns[run.setup]]) for run, scene in observed])
        # The prior variance is scaled by the part of the residual that set-ups cannot fit. If scaled by the full
        # residual, a ball that is a centimetre off would stay there.
        kept = r - J @ np.linalg.lstsq(J, r)[0]
        prior = np.where(ball, (kept @ kept) / BALL_PRIOR_MM**2, 1e-12)
        change = np.linalg.solve(J.T @ J + np.diag(prior), J.T @ r - prior * so_far)
        if not poses:
            change *= min(1.0, _FURTHEST_MM / max(float(np.abs(change).max()), 1e-12))
        so_far = so_far + change
        if np.abs(change).max() < _ENOUGH_MM:
            break
    return {name: moved_setup(starts[name], table, so_far[columns[name]]) for name, table in tables.items()}


# ----------------------------------------------------------------------------------------------------------------------
# Set-ups of observed runs, fitted to a fixed model, both before a diagnosis and in the validation of models.


def with_effects(runs: Sequence[ObservedRun], effects: Sequence[Effect]) -> list[ObservedRun]:
    return [replace(run, model=replace(run.model, effects=(*run.model.effects, *effects))) for run in runs]


def fit_run_setups(runs: Sequence[ObservedRun], setups: SetUps | None = None) -> tuple[dict[str, SetUp], list[Array]]:
    """Fit the set-ups of runs, starting from `setups` where given; also return the residuals (m, k) mm of each run, of
    a circle on its lap.
    """
    on_laps = [run.on_lap for run in runs]
    placed = fit_setups(on_laps, setups)
    return placed, [residual_of(run, placed) for run in on_laps]


@dataclass(frozen=True, eq=False)
class FittedRuns:
    """Runs with set-ups fitted for given effects of the arm. Fits are cached."""

    runs: Sequence[ObservedRun]
    _fits: dict[tuple[Effect, ...], tuple[dict[str, SetUp], list[Array]]] = field(
        default_factory=dict, init=False, repr=False
    )

    def fit_with_effects(self, effects: Sequence[Effect]) -> tuple[dict[str, SetUp], list[Array]]:
        """Set-ups, and residuals (m, k) mm of each run, with effects added to the model."""
        key = tuple(map(without_origin, effects))
        if key not in self._fits:
            self._fits[key] = fit_run_setups(with_effects(self.runs, effects))
        return self._fits[key]

    def setups_for(self, runs: Sequence[ObservedRun], effects: Sequence[Effect]) -> dict[str, SetUp]:
        """The set-ups for given effects, and fitted ones of other runs whose set-up is not among them."""
        known = self.fit_with_effects(effects)[0]
        new = with_effects([run for run in runs if run.setup not in known], effects)
        return known | (fit_run_setups(new)[0] if new else {})

    def residuals_of(self, runs: Sequence[ObservedRun], effects: Sequence[Effect]) -> list[Array]:
        """Residuals (m, k) mm of other runs, which keep a known set-up."""
        setups = self.setups_for(runs, effects)
        return [residual_of(run.on_lap, setups) for run in with_effects(runs, effects)]

    def residual_um(self, effects: Sequence[Effect], others: Sequence[ObservedRun] | None = None) -> float:
        """RMS residual in µm with effects added to the model, of these or of other runs."""
        residuals = self.fit_with_effects(effects)[1] if others is None else self.residuals_of(others, effects)
        return 1e3 * rms(residuals)


def without_origin(effect: Effect) -> Effect:
    """Drop the provenance, which is unhashable and irrelevant for readings."""
    return effect if effect.found is None else effect.model_copy(update={"found": None})


# ----------------------------------------------------------------------------------------------------------------------
# Poses held out for validation: complete neighbourhoods of joint space (k-means of the joint angles).
#
# Neighbours share errors that a model cannot express, so held-out single poses would overestimate the quality of a
# model. A neighbourhood is a place that the model has not seen.

GROUPS = 20
"""Number of neighbourhoods of joint space. Chosen: several poses in each, and enough for five folds."""
_FEWEST_OF_A_GROUP, _FEWEST_OF_A_FOLD = 3, 5
"""Smallest average number of places in a neighbourhood and in a fold. Chosen by 12 to 40 poses of measured arms
(docs/evidence/decide.md): at worst 88 % of the errors were within 2 u with three, 79 % with two and 76 % with one. With
five, twelve poses form two halves, which do not predict each other.
"""
FEWEST_PLACES = 3 * GROUPS
"""Number of poses below which no neighbourhood is held out."""


def constants_apart(runs: Sequence[ObservedRun]) -> bool:
    """Whether the constants of an arm have separate prior widths: for touches, and for positions too few to identify
    constants that are larger than usual.
    """
    of_touches = all(run.facts.constants_apart for run in runs)
    of_poses = all(run.facts.of_places for run in runs)
    return of_touches or (of_poses and sum(len(run.rows) for run in runs) < FEWEST_PLACES)


def neighbourhoods(q: Array, rng: np.random.Generator) -> Integers:
    """Index of the neighbourhood of each reading (n,), by k-means of the joint angles q (n, 6) rad; visits of a place
    stay together.
    """
    from scipy.cluster.vq import kmeans2  # noqa: PLC0415 - slow to import, needed here only

    places, place = _places(q)
    _, group = kmeans2(places, min(GROUPS, max(1, len(places) // _FEWEST_OF_A_GROUP)), minit="++", rng=rng)
    return np.asarray(group[place], dtype=np.int64)


def _places(q: Array) -> tuple[Array, Integers]:
    """Distinct places (p, 6) rad of joint angles q (n, 6) rad, and the index (n,) of each row's place."""
    places, place = np.unique(np.round(q, 3), axis=0, return_inverse=True)
    return places, np.asarray(place.ravel(), dtype=np.int64)


def folds_of(q: Array, folds: int) -> Integers:
    """Fold of each pose (n,): complete neighbourhoods in descending size, each to the smallest fold."""
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
    """Split runs of poses into a part for the fit and a held-out part: one of `folds` groups of similar postures.

    Other runs are not split, nor are runs of few poses, or of few poses visited often, like those of a cube.
    """
    used, left_out = [], []
    for run in runs:
        q = run.table.q[run.rows]
        # Removed outliers do not turn a run of sixty poses into a run of few.
        few = len(run.table.q) < FEWEST_PLACES or len(_places(q)[0]) < folds * _FEWEST_OF_A_FOLD
        if not run.facts.of_places or few:
            used.append(run)
            continue
        out = folds_of(q, folds) == fold
        used.append(part(run, ~out))
        left_out.append(part(run, out))
    return used, left_out

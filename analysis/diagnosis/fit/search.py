"""Search: set-ups, noise and names in turn until convergence, and detection of readings taken before joints were at
rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from analysis.diagnosis.evidence.blocks import Block, blocks_of
from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.background import CoefficientPosterior, Work
from analysis.diagnosis.fit.candidates import Columns, candidates_for, columns_for
from analysis.diagnosis.fit.refine import Refined
from analysis.diagnosis.fit.responses import (
    LEAST_MATERIAL_UM,
    Linearisation,
    basis_of,
    linearise,
    plain_rms_by_block,
)
from analysis.diagnosis.fit.rivals import RivalOdds, compare_with_rivals, without_needless_names
from analysis.diagnosis.fit.selection import Effort, Selection
from analysis.diagnosis.fit.selection_state import SelectionState, beginnings, large_effects
from analysis.robot.kinematics.arm import Array, Mask, drive_angles
from analysis.robot.predict import SetUp
from rigs.effects import Effect
from rigs.schema.reference import Reference
from rigs.text import counted

# ----------------------------------------------------------------------------------------------------------------------
# Search: set-ups fitted, noise estimated and names selected, repeated until the names no longer move the set-ups, and
# the columns were computed with the faults.
#
# A large effect displaces the ball found by a fit with no such effect, and makes the linearisation invalid. It also
# changes the response to the errors of a healthy arm: a length error of 0.4 mm makes the readings of a large gear error
# 0.5 % smaller, ten times the uncertainty of the size. A selection therefore stops at a fault that invalidates the
# columns, and the next starts with columns computed with the fault.

_PLACINGS = 8
"""Largest number of fits of instrument and target to poses before a search, each about the previous placement. Chosen:
two or three mostly suffice.
"""
_GIVEN_TURNS = 4
"""Largest number of fits of given effects, each about the previous set-ups. Chosen: they move less each time."""
_LEAST_ODDS = 0.01
"""Probability below which another width of a joint curve does not count."""
_STOPS, _ITERATIONS = 5, 8
"""Largest number of selections that stop at a fault, and of all selections. Chosen: few faults of an arm are large
enough to change the columns of earlier faults, and the second of three complete selections mostly ended like the first.
"""


@dataclass(frozen=True)
class SearchResult:
    """Selection among runs about set-ups and reference effects, its final state, and each effect's rivals. N counts the
    whitened entries of all blocks.
    """

    selection: Selection
    state: SelectionState
    rival_odds: tuple[RivalOdds, ...]

    @property
    def linear(self) -> Linearisation:
        return self.selection.linear

    @property
    def columns(self) -> Columns:
        return self.selection.columns

    @property
    def work(self) -> Work:
        """Computations of the search so far, and of the comparisons that follow it."""
        return self.selection.work

    @property
    def fit(self) -> Refined:
        return self.state.refined

    @property
    def effects(self) -> tuple[Effect, ...]:
        return self.state.effects

    @cached_property
    def posterior(self) -> CoefficientPosterior:
        return self.selection.posterior(self.state)

    @property
    def strength(self) -> Array:
        """Ratio (N,) of the variance of the residual of each entry to that of the noise."""
        return self.state.strength[self.columns.band]

    @cached_property
    def blocks_as_shown(self) -> list[Block]:
        """The blocks, with assumed noise reduced to that shown by the readings."""
        root = np.sqrt(np.minimum(self.strength, 1.0))
        blocks = zip(self.linear.blocks, self.linear.rows, strict=True)
        return [block if block.measured else replace(block, sd_mm=root[rows] * block.sd_mm) for block, rows in blocks]

    @property
    def noise_share(self) -> float:
        """Share of the assumed noise of circles, as a standard deviation, shown by the readings; 1 if measured."""
        pairs = zip(self.blocks_as_shown, self.linear.blocks, strict=True)
        shown = [(after.sd_mm, before.sd_mm) for after, before in pairs if before.sampling and not before.measured]
        if not shown:
            return 1.0
        return float(np.sqrt(sum(np.sum(after**2) for after, _ in shown) / sum(np.sum(sd**2) for _, sd in shown)))

    @property
    def noise_shown(self) -> Array:
        """Share of the noise variance shown by the readings of each block (b,), at most 1."""
        blocks, strength = zip(self.linear.blocks, self.linear.rows, strict=True), self.strength
        shown = [min(float(strength[rows].mean()), 1.0) if block.shows_noise else 1.0 for block, rows in blocks]
        return np.array(shown)

    @property
    def beyond_noise(self) -> Array:
        """Share (N,) of the residual of each entry that is beyond the noise, root mean square."""
        return np.sqrt(np.clip(1 - 1 / np.maximum(self.strength, 1.0), 0.0, 1.0))

    @property
    def reference(self) -> Reference:
        return self.linear.blocks[0].model.rig.reference

    @cached_property
    def contributions(self) -> list[Array]:
        """Additional contribution of each effect to the whitened readings, (N,) each."""
        return self.linear.contributions(self.effects, self.fit.residual)

    @cached_property
    def initial_residual(self) -> Array:
        """Whitened residual (N,) without named effects."""
        return self.linear.without_set_up(self.linear.residual(()))

    @property
    def scatter_limits_um(self) -> Array:
        """Changes (b,) µm from which a named effect is material."""
        return self.selection.limits_um

    @cached_property
    def moves(self) -> Array:
        """Terms of the set-ups (s,) mm that fit the readings best with the named effects."""
        return self.linear.moves_with(self.effects)

    @property
    def free_share(self) -> Array:
        """Contribution (N,) of unknown causes to the whitened readings."""
        free = self.fit.free.columns
        return np.asarray(free @ self.posterior.term_means[len(self.posterior.term_means) - free.shape[1] :], float)

    @cached_property
    def departures(self) -> list[Array]:
        """Contribution of each effect's departures from its ideal form, (N,) each."""
        widths = [response.columns.shape[1] for response in self.fit.departures]
        ends = len(self.fit.unknowns) + np.cumsum([0, *widths])
        means = [self.posterior.term_means[begin:end] for begin, end in pairwise(ends)]
        return [response.columns @ mean for response, mean in zip(self.fit.departures, means, strict=True)]

    @cached_property
    def calibrated_posterior(self) -> CoefficientPosterior:
        """The posterior without unknown causes, which a calibrated model does not contain: errors shared between them
        and the background would be missing in the model.
        """
        if not self.state.unknown:
            return self.posterior
        return self.selection.posterior(self.selection.with_names_only(self.state))

    @cached_property
    def covariance(self) -> Array:
        """Covariance (f + c, f + c) of the fitted parameters, then of the forms and set-ups, in healthy sizes.

        Averaged over the widths of the joint curves, which few poses hardly determine: at the likeliest width,
        uncertainties at other poses were too small.
        """
        columns, fitted = self.columns.set_ups.stop, len(self.fit.unknowns)
        mean, covariance = self.calibrated_posterior.joint(columns, fitted)
        change = np.zeros_like(covariance)
        for share, posterior in self._at_other_widths():
            other_mean, other = posterior.joint(columns, fitted)
            change += share * (other + np.outer(other_mean - mean, other_mean - mean) - covariance)
        return covariance + change

    def _at_other_widths(self) -> Iterator[tuple[float, CoefficientPosterior]]:
        """Posteriors with another width of one joint curve, with its probability among all widths of that curve."""
        if self.state.curves is None:
            return
        evidence = self.selection.evidence(self.state)
        for widths in self.state.curves.others():
            states = [replace(self.state, curves=curves) for _, curves in widths]
            log_odds = [log_prior + self.selection.evidence(state) - evidence
                        for (log_prior, _), state in zip(widths, states, strict=True)]  # fmt: skip
            odds = np.exp(np.minimum(log_odds, 0.0))  # none is likelier than the fitted width
            for share, state in zip((odds / (1 + odds.sum())).tolist(), states, strict=True):
                if share > _LEAST_ODDS:
                    yield share, self.selection.posterior(state)

    @property
    def residual(self) -> Array:
        """Whitened residual (N,) of the model with the named effects."""
        return self.linear.without_set_up(self.fit.residual)


def search(runs: Sequence[ObservedRun], progress: Callable[[str], None]) -> SearchResult:
    """Search for named effects in runs, about set-ups fitted together with them. Effects that change readings by no
    more than the scatter of a run have no rivals.
    """
    refitted: tuple[Effect, ...] = ()
    so_far: tuple[Effect, ...] = ()
    effort, work = Effort(), Work()
    setups, begun = _starting_setups(runs, progress, work)
    turn = 0
    while True:
        progress("computing the response to each effect" + " again" * (turn > 0))
        turn += 1
        selection = replace(_selection(runs, setups, so_far), effort=effort, work=work)
        progress("selecting effects")
        begun = selection.fitted_again(selection.initial_state(so_far, begun), refitted)
        refitted = large_effects(begun.effects)
        state = selection.select(begun, stops=turn <= _STOPS)
        is_last = turn == _ITERATIONS or effort.is_spent
        if is_last or selection.is_valid_for(state):
            progress("comparing names with their rivals")
            state, odds = compare_with_rivals(selection, without_needless_names(selection, state))
            if is_last or selection.is_valid_for(state):
                progress("comparing names with unknown causes")
                compared = selection.against_unknown(state)
                if compared is not state:
                    state, odds = compare_with_rivals(selection, compared)
                return SearchResult(selection, state, odds)
        so_far = state.effects
        setups = selection.linear.setups_moved_by(selection.moves(state))
        del selection, state  # most of the memory, before the columns of the next turn are computed


def fit_given(
    runs: Sequence[ObservedRun],
    effects: Sequence[Effect],
    progress: Callable[[str], None],
    unlimited: frozenset[str] = frozenset(),
) -> SearchResult:
    """Fit given effects to runs, together with a healthy arm's share of all other effects, without a search or rivals.
    `unlimited`: names of effects with no size limit.
    """
    so_far: tuple[Effect, ...] = ()
    setups, previous = _starting_setups(runs, progress)
    for turn in range(_GIVEN_TURNS):
        progress(f"fitting {counted(len(effects), 'effect')}" + " again" * (turn > 0))
        selection = _selection(runs, setups, so_far, unlimited)
        begun = (selection.initial_state if turn else selection.state_with)(effects, previous)
        # A fit with only the noise strengths leaves much of a large effect to the background.
        state = previous = selection.settled(*beginnings(begun))
        effects = state.effects
        if selection.is_valid_for(state):
            break
        so_far = state.effects
        setups = selection.linear.setups_moved_by(selection.moves(state))
    return SearchResult(selection, state, tuple(RivalOdds(1.0) for _ in effects))


def _selection(
    runs: Sequence[ObservedRun],
    setups: Mapping[str, SetUp],
    effects: tuple[Effect, ...] = (),
    unlimited: frozenset[str] = frozenset(),
) -> Selection:
    linear = linearise(blocks_of(runs, setups, effects), setups, effects, unlimited)
    return Selection(linear, columns_for(linear, candidates_for(linear)))


def _starting_setups(
    runs: Sequence[ObservedRun], progress: Callable[[str], None], work: Work | None = None
) -> tuple[dict[str, SetUp], SelectionState | None]:
    """Fit initial set-ups; for poses, also return the state in which they were fitted, with the curves of the joints.

    Set-ups of poses are fitted together with a healthy arm's share of every effect. With the nominal arm, the target of
    a UR10 was 73 mm off, too distant for columns that are computed only once.
    """
    # The first run of each kind is sufficient as a starting point.
    setups = fit_run_setups(list({run.name: run for run in reversed(runs)}.values()))[0]
    poses, begun = [run for run in runs if run.facts.of_places], None
    for _ in range(_PLACINGS if poses else 0):
        progress("placing instrument and target")
        of_poses = {run.setup: setups[run.setup] for run in poses}
        selection = replace(_selection(poses, of_poses), work=work or Work())
        begun = selection.initial_state(previous=begun)
        moves = selection.moves(begun)
        setups |= selection.linear.setups_moved_by(moves)
        if selection.linear.is_straight(moves):
            break
    return setups, begun


# ----------------------------------------------------------------------------------------------------------------------
# Detection of poses whose joints were read before they had come to rest.
#
# A link that moves on after the joint was read is ahead of the reported angle, and a backlash delays it: the sign
# distinguishes the two. The reversal errors of a healthy arm have the same shape and could absorb this error with a
# wrong sign; their share is therefore added back. The direction of travel correlates with the joint angle; any
# dependence on each joint's angle is therefore removed first. Only poses that state the origin of their joints can show
# it: the order of rows in a table is not the order of measurement.

_SURE_SIGMA = 5.0
"""Smallest size of a joint's error, in standard deviations, that is reported. Among six joints, chance exceeds 5
sigma once in a million diagnoses.
"""
_LEAST_SHARE = 0.2
"""Smallest share of the residual energy that must follow the direction of travel. Because poses are visited in some
order, a small share always does: 8 % for a UR10 measured at rest (Landgraf et al. 2021).
"""
_ALIKE, _UNABSORBED = 0.5, 0.2
"""Limits of an arrival error. Chosen: at least 0.5 of the energy follows the direction of travel, and at least 0.2 of
it remains after the dependence on the joint angle is removed.
"""
_STEPS = 19
"""Number of angles of a joint at which a step of the link is tried. Chosen: parts of 5 % of the poses."""
_ORDERS = np.array([1, 2, 3])
"""Cycles per turn of the functions of a joint's angle: those of gravity and eccentric gear wheels. Chosen."""


def early_readings(result: SearchResult) -> tuple[str, ...]:
    """A message with the remedy if the joints of poses were read too early, else an empty tuple."""
    linear = result.linear
    rows = linear.at_entries([np.full(len(block.y_mm), _moves(block) is not None) for block in linear.blocks])
    if not rows.any():
        return ()
    taken = basis_of(np.concatenate([linear.U, *_by_angle(linear, _smooth)], axis=1))
    joints = range(1, linear.axes + 1)
    freedom = int(rows.sum()) - taken.shape[1] - len(joints)
    if freedom < taken.shape[1]:  # as many terms as readings fit anything, including the direction of travel
        return ()

    def free(values: Array) -> Array:
        return values - taken @ (taken.T @ values)

    # A degree in the direction of the last move of a joint, or the move itself, in rad.
    kinds = [
        (lambda came: np.radians(np.sign(came)), "by {:.4f} ± {:.4f}°", 1.0),
        (lambda came: came, "by {:.3f} ± {:.3f} % of each move", 100.0),
    ]
    fits = []
    for off, words, unit in kinds:
        whole = np.concatenate([linear.by_joint(axis, partial(_arrival, off, axis - 1)) for axis in joints], axis=1)
        A = free(whole)
        y = free(_with_alike(result, A, free))
        shown = (A**2).sum(axis=0) > _UNABSORBED * (whole**2).sum(axis=0)
        ahead, sd = np.zeros(len(joints)), np.full(len(joints), np.inf)
        inverse = np.linalg.pinv(A[np.ix_(rows, shown)])
        ahead[shown] = inverse @ y[rows]
        energy = float(np.sum((y - A @ ahead)[rows] ** 2))
        sd[shown] = np.sqrt(energy / freedom * (inverse**2).sum(axis=1))
        share = 1 - energy / max(float(np.sum(y[rows] ** 2)), 1e-300)
        fits.append((share, ahead, sd, A, y, words, unit))
    share, ahead, sd, A, y, words, unit = max(fits, key=lambda fit: fit[0])
    poses = [block.facts.of_tracker for block in linear.blocks]
    um = np.array([plain_rms_by_block(linear, A[:, [k]] @ ahead[[k]]).um[poses].max() for k in range(len(joints))])
    early = (ahead > _SURE_SIGMA * sd) & (um > LEAST_MATERIAL_UM)
    if share < _LEAST_SHARE or not early.any() or share < _step_share(linear, rows, free, y):
        return ()
    axes = ", ".join(f"axis {k + 1} {words.format(unit * ahead[k], unit * sd[k])}" for k in np.flatnonzero(early))
    message = f"poses were read before the joints came to rest: the links lead in the direction of travel ({axes})"
    return (
        f"{message}, whereas play makes them lag; wait longer before reading a pose, or import with --joints commanded",
    )


def _moves(block: Block) -> Array | None:
    """Last moves of the drives (n, axes) rad of the poses of a block; None if unknown."""
    moves = block.table.last_moves if block.facts.of_tracker else None
    return None if moves is None else drive_angles(block.model.arm, moves)


def _by_angle(linear: Linearisation, shape: Callable[[Array], Array]) -> list[Array]:
    """Changes (N, c) of pose readings by errors of a shape (n, c) of the angle (n, 1), for each joint."""

    def errors(joint: int, block: Block) -> Array:
        return np.radians(shape(block.drives.q[:, [joint]])) * block.facts.of_tracker

    return [linear.by_joint(axis, partial(errors, axis - 1)) for axis in range(1, linear.axes + 1)]


def _smooth(q: Array) -> Array:
    return np.concatenate([np.ones_like(q), np.sin(q * _ORDERS), np.cos(q * _ORDERS)], axis=1)


def _step_share(linear: Linearisation, rows: Mask, free: Callable[[Array], Array], y: Array) -> float:
    """Largest share of the energy of readings y (N,) explained by a step of the link at an angle of the joint.

    A slipped tooth causes such a step. A joint reaches large angles from below, so the error also follows the
    direction.
    """
    steps = _by_angle(linear, lambda q: np.heaviside(q - np.quantile(q, np.linspace(0, 1, _STEPS + 2)[1:-1]), 0.0))
    columns = free(np.concatenate(steps, axis=1))[rows]
    gains = (columns.T @ y[rows]) ** 2 / np.maximum((columns**2).sum(axis=0), 1e-30)
    return float(gains.max() / max(float(np.sum(y[rows] ** 2)), 1e-300))


def _with_alike(result: SearchResult, A: Array, free: Callable[[Array], Array]) -> Array:
    """The residual (N,) plus all known contributions that resemble the arrival errors A (N, axes): of named effects, of
    the background, and of the curves of joints.
    """
    posterior = result.posterior
    columns = posterior.background.columns
    others = np.concatenate([columns.X[:, : columns.set_ups.start], columns.X[:, columns.set_ups.stop :]], axis=1)
    mean = np.concatenate([posterior.mean[: columns.set_ups.start], posterior.mean[columns.set_ups.stop :]])
    taken = np.concatenate([others * mean, np.reshape(result.contributions, (-1, len(posterior.residual))).T], axis=1)
    freed, basis = free(taken), basis_of(A)
    energy = (freed**2).sum(axis=0)
    alike = ((basis.T @ freed) ** 2).sum(axis=0) > _ALIKE * np.maximum(energy, 1e-12)
    alike &= energy > _UNABSORBED * (taken**2).sum(axis=0)
    # The sum of many waves absorbs the dependence on the direction of travel, although no single wave resembles it.
    alike[columns.curves.columns] = True
    return np.asarray(posterior.residual + taken[:, alike].sum(axis=1), dtype=float)


def _arrival(off: Callable[[Array], Array], joint: int, block: Block) -> Array:
    """Error of a joint of poses, (n, 1) rad at the samples of the block's path; zero for other tests."""
    moves, columns = _moves(block), np.zeros((len(block.path.q), 1))
    if moves is not None:
        columns[block.path.rows, 0] = off(moves[:, joint])
    return columns

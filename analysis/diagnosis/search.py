"""The search: set-ups fitted, noise estimated and names selected, repeated until the names leave the set-ups where they
are, and the columns were computed beside the faults.

A large effect displaces the ball that a fit without it found, and makes the linearisation invalid. It also changes what
a healthy arm adds: a length that is 0.4 mm wrong makes the readings of a large gear error 0.5 % smaller, ten times the
uncertainty of its size. So a selection stops at a fault beside which the columns do not hold, and the next one begins
with columns that were computed beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

from analysis.diagnosis.background import Posterior
from analysis.diagnosis.blocks import blocks_of
from analysis.diagnosis.candidates import candidates_for
from analysis.diagnosis.columns import columns_for
from analysis.diagnosis.joint_curves import JointCurves
from analysis.diagnosis.linearisation import Linearisation, linearise
from analysis.diagnosis.observed_run import ObservedRun
from analysis.diagnosis.rivals import RivalOdds, compare_with_rivals
from analysis.diagnosis.run_setups import fit_run_setups
from analysis.diagnosis.selection import Selection
from analysis.diagnosis.selection_state import SelectionState
from analysis.diagnosis.settling import beginnings
from analysis.diagnosis.worth import limits_um
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from analysis.traces.tables import PoseTable
from rigs.effects import Effect

_PLACINGS = 8
"""Largest number of fits of instrument and target to poses before a search, each about the place of the one before.
Chosen: two or three mostly suffice."""
_GIVEN_TURNS = 4
"""Largest number of fits of given effects, each about the set-ups of the one before. Chosen: they move less each time.
"""
_STOPS, _ITERATIONS = 5, 8
"""Largest number of selections that stop at a fault, and of all. Chosen: few faults of an arm are so large that they
change the columns of those found before, and of three complete selections the second mostly ends where the first did.
"""


@dataclass(frozen=True)
class SearchResult:
    """The result of a search: runs about set-ups and known effects, the selection and its state, the posterior, and
    each name with its rivals. N counts the whitened entries of all blocks."""

    linear: Linearisation
    selection: Selection
    state: SelectionState
    posterior: Posterior
    rival_odds: tuple[RivalOdds, ...]

    @cached_property
    def contributions(self) -> list[Array]:
        """What each name adds to the whitened readings beside the others, (N,) each."""
        effects, left = self.state.refined.effects, self.state.refined.residual
        return [self.linear.residual([*effects[:k], *effects[k + 1 :]]) - left for k in range(len(effects))]

    @cached_property
    def initial_residual(self) -> Array:
        """The whitened residual (N,) of the model without the names, with set-ups fitted."""
        return self.linear.without_set_up(self.linear.residual(()))

    @cached_property
    def scatter_limits_um(self) -> Array:
        """The changes (b,) µm from which a name is material beside the scatter of one run."""
        return limits_um(self.linear, None)

    @cached_property
    def moves(self) -> Array:
        """The terms of the set-ups (s,) mm that fit the readings best with the names."""
        return self.linear.moves_with(self.state.refined.effects)

    @property
    def free_share(self) -> Array:
        """What free forms add to the whitened readings (N,)."""
        free = self.state.refined.free.columns
        share: Array = free @ self.posterior.known[len(self.posterior.known) - free.shape[1] :]
        return share

    @cached_property
    def calibrated_posterior(self) -> Posterior:
        """The posterior without free forms. No model holds them, and what they take and the background gives back would
        be left in it: 92 µm where the names alone left 19."""
        if not self.state.free_forms:
            return self.posterior
        return self.selection.posterior(self.selection.without_free_forms(self.state))

    @property
    def residual(self) -> Array:
        """The whitened residual (N,) of the model with the names, with set-ups fitted."""
        return self.linear.without_set_up(self.state.refined.residual)


def search(
    runs: Sequence[ObservedRun], progress: Callable[[str], None], tolerance_um: float | None = None
) -> SearchResult:
    """Return the names found in runs, about set-ups fitted with them; the readings of a run are (m, k) mm. Names that
    change readings by no more than the tolerance in µm, or else the scatter of one run, have no rivals."""
    before: tuple[Effect, ...] = ()
    known: tuple[Effect, ...] = ()
    setups, curves = _starting_setups(runs, progress)
    for turn in range(_ITERATIONS):
        linear = linearise(blocks_of(runs, setups, known), setups, known)
        progress("computing the response to each effect" + " again" * (turn > 0))
        selection = Selection(linear, columns_for(linear, candidates_for(linear)))
        progress("selecting effects")
        begun = selection.fitted_again(selection.initial_state(known, curves), before)
        curves = begun.curves
        before = begun.faults_among(begun.refined.effects)
        state = selection.select(begun, stops=turn < _STOPS)
        is_last = turn + 1 == _ITERATIONS
        if is_last or selection.holds_for(state):
            progress("comparing names with their rivals")
            state, odds = compare_with_rivals(selection, state, limits_um(linear, tolerance_um))
            if is_last or selection.holds_for(state):
                break
        known = state.refined.effects
        setups = linear.setups_moved_by(selection.moves(state))
    return SearchResult(linear, selection, state, selection.posterior(state), odds)


def fit_given(runs: Sequence[ObservedRun], effects: Sequence[Effect], progress: Callable[[str], None]) -> SearchResult:
    """Return the fit of given effects to runs of (m, k) mm, beside a healthy arm's share of everything else; nothing
    else is named, and nothing is a rival."""
    known: tuple[Effect, ...] = ()
    setups, curves = _starting_setups(runs, progress)
    for turn in range(_GIVEN_TURNS):
        progress(f"fitting {len(effects)} effects" + " again" * (turn > 0))
        linear = linearise(blocks_of(runs, setups, known), setups, known)
        selection = Selection(linear, columns_for(linear, candidates_for(linear)))
        # A fit with the strengths of the noise alone leaves much of a large effect to the background.
        state = selection.settled(*beginnings(selection.initial_state(effects, curves)))
        effects, curves = state.refined.effects, state.curves
        if selection.holds_for(state):
            break
        known = state.refined.effects
        setups = linear.setups_moved_by(selection.moves(state))
    odds = tuple(RivalOdds(1.0) for _ in effects)
    return SearchResult(linear, selection, state, selection.posterior(state), odds)


def _starting_setups(
    runs: Sequence[ObservedRun], progress: Callable[[str], None]
) -> tuple[dict[str, SetUp], JointCurves | None]:
    """Return fitted set-ups to begin with; those of poses are fitted beside what a healthy arm shows of every effect,
    with the curves of its joints.

    A target moves along with what the arm's constants do to the last link. Beside the nominal arm that of a UR10 was
    fitted 73 mm from where it is beside the calibrated one, too far for columns that are computed once.
    """
    setups = fit_run_setups(_first_of_each(runs))[0]
    poses, curves = [run for run in runs if isinstance(run.one.table, PoseTable)], None
    for _ in range(_PLACINGS if poses else 0):
        progress("placing instrument and target")
        own = {run.one.setup: setups[run.one.setup] for run in poses}
        linear = linearise(blocks_of(poses, own), own)
        selection = Selection(linear, columns_for(linear, candidates_for(linear)))
        begun = selection.initial_state(curves=curves)
        curves, moves = begun.curves, selection.moves(begun)
        setups |= linear.setups_moved_by(moves)
        if linear.is_straight(moves):
            break
    return setups, curves


def _first_of_each(runs: Sequence[ObservedRun]) -> list[ObservedRun]:
    """Return the first run of each kind, which is sufficient as a starting point."""
    return list({run.name: run for run in reversed(runs)}.values())

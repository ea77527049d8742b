"""Expectations for runs not yet measured: planned runs, information about forms, and posterior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.evidence.blocks import Block, blocks_of
from analysis.diagnosis.evidence.noise import DRIFTING_SHARE
from analysis.diagnosis.evidence.observation import by_socket, observe_run
from analysis.diagnosis.evidence.setups import fit_setups
from analysis.diagnosis.evidence.significance import CERTAIN_SIGMA, ODDS
from analysis.diagnosis.fit.background import Background, background_of
from analysis.diagnosis.fit.candidates import (
    HEALTHY,
    LARGEST_FAULT,
    Candidate,
    Columns,
    Form,
    Level,
    candidates_for,
    columns_for,
    fault_sizes,
    forms_of,
    healthy_shares,
    in_each_shape,
    remaining_column_shares,
    remaining_variance_shares,
)
from analysis.diagnosis.fit.refine import refine
from analysis.diagnosis.fit.responses import Linearisation, linearise
from analysis.procedures.shared.test_kind import nominal_setup
from analysis.procedures.simulate import simulate
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.predict import SetUp, SetUps, model_of
from analysis.runs.noise.cell_noise import TARGET_MM
from analysis.runs.tables import CircleTable
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.effect import healthy, healthy_size, is_play, is_wave, one_sided, scaled, size_field, size_of
from rigs.schema.vocabulary import CIRCLES, TestName

# ----------------------------------------------------------------------------------------------------------------------
# Knowledge of each form of each name before measurements: posterior covariance of the forms' sizes in a healthy arm,
# which gives the uncertainty of a name and the separation of two names.

SEPARABLE = float(np.sqrt(2 * np.log(ODDS)))
"""Separation in sigmas from which a diagnosis dismisses a rival: odds of o need a log evidence of ln o = sigma² / 2."""


def is_separable(sigma: float) -> bool:
    return sigma >= SEPARABLE


def is_detectable(sd: float) -> bool:
    """Whether the largest fault of an effect is detected if its size is known to `sd` healthy sizes."""
    return CERTAIN_SIGMA * sd <= LARGEST_FAULT


@dataclass(frozen=True)
class FormPosterior:
    """Posterior covariance A (p, p) of the coefficients of `forms`, fitted together with all other terms, and prior
    variances (p,), in healthy sizes.
    """

    forms: tuple[Form, ...]
    A: Array
    variance: Array

    @cached_property
    def _number(self) -> dict[tuple[Effect, ...], int]:
        return {form.effects: k for k, form in enumerate(self.forms)}

    def sd(self, candidate: Candidate) -> float:
        """Standard uncertainty of a candidate's size for a known shape, averaged over free phases."""
        k = self._number.get(candidate.effects)
        if k is None:
            return float("inf")
        shares = remaining_variance_shares(self.forms, candidate.effect)
        taken = [column for j in np.flatnonzero(shares < 1).tolist() for column in self.forms[j].columns]
        columns = list(self.forms[k].columns)
        # information of the readings together with all parts except the removed part
        cavity = np.linalg.inv(self.A[np.ix_(taken, taken)]) - np.diag(1 / self.variance[taken])
        places = [taken.index(column) for column in columns]
        precision = np.linalg.eigvalsh(cavity[np.ix_(places, places)])
        return float(np.sqrt(np.mean(1 / np.maximum(precision, 1e-12) + shares[k] * self.variance[columns])))

    def sigmas_apart(self, chosen: Sequence[Candidate], sizes: Array, pairs: Integers) -> Array:
        """Separations (m,) in sigmas of candidate pairs (m, 2), at sizes (n,) in healthy sizes, with all other forms of
        either effect present.
        """
        p = len(self.A)
        # A dummy column with no information completes forms with a single column.
        A, variance = np.eye(p + 2), np.append(self.variance, [1.0, 1.0])
        A[:p, :p] = self.A
        own_columns = [self.forms[self._number[candidate.effects]].columns for candidate in chosen]
        first, second = pairs.T
        columns = np.concatenate(
            [[(*indices, dummy)[:2] for indices in own_columns] for dummy in (p, p + 1)], axis=1
        ).reshape(len(chosen), 2, 2)
        pair = np.concatenate([columns[first, 0], columns[second, 1]], axis=1)
        precisions = np.linalg.inv(A[pair[:, :, None], pair[:, None, :]])
        precisions[:, np.arange(4), np.arange(4)] -= 1 / variance[pair]
        width = np.array([len(indices) for indices in own_columns])
        this, that, across = precisions[:, :2, :2], precisions[:, 2:, 2:], precisions[:, :2, 2:]
        values: Array = np.minimum(
            sizes[first] * _sigmas_with_second(this, across, that, width[first]),
            sizes[second] * _sigmas_with_second(that, across.transpose(0, 2, 1), this, width[second]),
        )
        return values


def _sigmas_with_second(precision: Array, across: Array, other_precision: Array, width: Array) -> Array:
    """RMS significance (n,) in sigmas of a coefficient, over its width (n,), in the presence of a second, free
    coefficient. Precisions (n, 2, 2).
    """
    free = other_precision + np.eye(2) / LARGEST_FAULT**2
    remaining = precision - across @ np.linalg.solve(free, across.transpose(0, 2, 1))
    return np.asarray(np.sqrt(np.maximum(np.trace(remaining, axis1=1, axis2=2) / width, 0.0)), dtype=float)


# ----------------------------------------------------------------------------------------------------------------------
# Information of runs about the forms of all names: an additive matrix per set of runs.


def without_bands(blocks: Sequence[Block]) -> list[Block]:
    """Put all entries in the same band: without readings, bands have no separate strength."""
    return [replace(block, band=np.zeros_like(block.band)) for block in blocks]


@dataclass(frozen=True)
class FormInformation:
    """Forms of `candidates`, p columns in total, and the information of runs about them."""

    candidates: tuple[Candidate, ...]

    @cached_property
    def forms(self) -> tuple[Form, ...]:
        return forms_of(in_each_shape(self.candidates))

    @cached_property
    def _variance(self) -> Array:
        return healthy_shares(self.forms)

    def of(self, blocks: Sequence[Block], setups: SetUps) -> Array:
        """Information (p, p) of runs about the coefficients in healthy sizes, with set-ups and scatter eliminated; zero
        for invisible forms.
        """
        columns = columns_for(linearise(without_bands(blocks), setups), self.candidates)
        is_nuisance = columns.fixed > 0
        of_forms, nuisance = np.flatnonzero(~is_nuisance), np.flatnonzero(is_nuisance)
        across = columns.gram[np.ix_(of_forms, nuisance)]
        nuisance_precision = columns.gram[np.ix_(nuisance, nuisance)] + np.diag(1 / columns.fixed[nuisance])
        of_form = {form.effects: form.columns for form in self.forms}
        place = [k for form in columns.forms for k in of_form[form.effects]]
        whole = np.zeros((len(self._variance), len(self._variance)))
        whole[np.ix_(place, place)] = columns.gram[np.ix_(of_forms, of_forms)] - across @ np.linalg.solve(
            nuisance_precision, across.T
        )
        return whole

    def posterior(self, information: Array) -> FormPosterior:
        A = np.asarray(np.linalg.inv(information + np.diag(1 / self._variance)), dtype=float)
        return FormPosterior(self.forms, A, self._variance)


# ----------------------------------------------------------------------------------------------------------------------
# Planned runs as used by a diagnosis: simulated, with the noise of real cells.

_SET_BY_HAND_MM = (0.6, -0.4, 0.1)
"""Displacement of the ball from the circle's centre, unless given in the rig file. Chosen: a ball placed by hand is off
by about 0.7 mm, and effects that scale the readings are visible only if these vary.
"""


def planned_blocks(
    rig: Rig, tests: Sequence[TestName], runs: int, place: str = ""
) -> tuple[list[Block], dict[str, SetUp]]:
    """Blocks of tests driven `runs` times in each direction, and their set-ups. `place` separates these from those of
    other runs. Raises FileError if the arm cannot drive a test.
    """
    model = model_of(rig)
    # Only the path of a simulated table is used. Yaw and roll share a motion, and a cw program reverses the joint
    # angles of the acw program.
    tables = [simulate(rig, test, None, None) for test in tests if test not in CIRCLES]
    if circles := [test for test in CIRCLES if test in tests]:
        acw = simulate(rig, circles[0], "acw", None)
        assert isinstance(acw, CircleTable)  # noqa: S101 - what simulate makes of a circle
        cw = replace(acw, direction="cw", t_s=acw.t_s[-1] - acw.t_s[::-1], q=acw.q[::-1])
        tables += [replace(lap, test=test) for test in circles for lap in (acw, cw)]
    driven = [observe_run(model, table, rig.name) for table in tables]
    seen = [part for run in driven for part in by_socket(replace(run, setup=run.setup + place))]
    setups = {run.setup: nominal_setup(rig, run.table) for run in seen}
    off_mm = np.array(_SET_BY_HAND_MM)
    if rig.tests.circle and any(rig.tests.circle.eccentricity_mm):
        off_mm = np.array(rig.tests.circle.eccentricity_mm)
    for run in seen:
        if run.sampling and rig.tests.circle:
            setups[run.setup] = replace(nominal := nominal_setup(rig, run.table), ball=nominal.ball + off_mm)
    setups |= fit_setups([run for run in seen if run.facts.of_places])
    blocks, few = [], 1 / np.sqrt(runs)
    for block in blocks_of(seen, setups):
        # The noise is assumed, because noise-free simulated visits do not determine it.
        drifting = np.sqrt(DRIFTING_SHARE) * np.linalg.norm(block.scatter_mm, axis=1)
        sd = block.sd_mm if block.sampling else np.hypot(TARGET_MM.rms, drifting)
        scatter, stamps = few * block.scatter_mm, few * block.stamps_mm
        blocks.append(replace(block, sd_mm=few * sd, scatter_mm=scatter, stamps_mm=stamps, count=runs, measured=False))
    return blocks, setups


# ----------------------------------------------------------------------------------------------------------------------
# Expected posterior: knowledge of a diagnosis about each name from runs not yet measured.
#
# It uses the columns and the healthy background of a diagnosis. The uncertainty of a size is independent of the
# readings and therefore predictable.


@dataclass(frozen=True)
class ExpectedPosterior:
    """Expected posterior of the effects for planned runs, before any reading is known: the uncertainty of a size does
    not depend on the readings.
    """

    linear: Linearisation
    level: Level = HEALTHY

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        return tuple(candidates_for(self.linear))

    def least(self, effect: Effect) -> float:
        """Smallest size of an effect that is a fault, in healthy sizes."""
        return float(fault_sizes(self.level.of(effect))[0])

    @cached_property
    def _columns(self) -> Columns:
        return columns_for(self.linear, self.candidates)

    @cached_property
    def _variance(self) -> Array:
        return self._columns.variance(self.level)

    @cached_property
    def _form_posterior(self) -> FormPosterior:
        A = background_of(self._columns, np.ones(len(self.linear.y)), self._variance).covariance
        return FormPosterior(self._columns.forms, A, self._variance)

    def release_columns(self) -> None:
        """Drop the columns, some 100 MB for circles; what was computed from them is kept."""
        vars(self).pop("_columns", None)  # location of a computed cached property

    def sd(self, candidate: Candidate, size: float | None = None) -> float:
        """Standard uncertainty of a candidate's size, in healthy sizes, averaged over free phases. `size`: of the
        fault, relevant for backlash, for example; None for the smallest detected fault.
        """
        sd, effect = self._form_posterior.sd(candidate), candidate.effect
        # A shape fitted with the size makes it less certain; the order of a wave does not.
        shaped = bool(effect.FREE or effect.STRETCHED) and not is_wave(effect)
        if not shaped or not is_detectable(sd):
            return sd
        size = size or float(np.clip(CERTAIN_SIGMA * sd, self.least(effect), LARGEST_FAULT))
        shapes = {free.field: free.expected for free in effect.free(self.linear.payload)}
        fault = scaled(healthy(effect), size, **shapes)
        refined = refine(self.linear.simulated_with((fault,)), self._background_with_effects((fault,)), [fault])
        return refined.fitted_sd(0)[size_field(effect)] / healthy_size(effect)  # of detection, not of the form

    def sd_of_name(self, name: str) -> float:
        """Standard uncertainty of an effect's size, in healthy sizes, in the best detected form."""
        forms = [candidate for candidate in self.candidates if candidate.name == name]
        return self.sd(min(forms, key=self._form_posterior.sd)) if forms else float("inf")

    def separation_sigma(self, ones: Sequence[Effect], others: Sequence[Effect]) -> float:
        """Separation in sigmas of an effect at a given size from another effect of any size. Each is given as a single
        effect, or as two effects for a free phase.
        """
        # Extrapolated from a small size; backlash is not proportional to its width and not scaled.
        effects = [*ones, *others]
        small = [
            effect if is_play(effect) else scaled(healthy(effect), min(1.0, effect.STRAIGHT)) for effect in effects
        ]
        pairs = zip(effects, small, strict=True)
        times = [1.0 if one is effect else size_of(effect) / size_of(one) for effect, one in pairs]
        T = self.linear.columns(small) * np.array(times)
        marginal = self._background_with_effects((ones[0], others[0])).marginal(T)
        H = marginal.products(marginal)
        q = len(ones)
        free = H[q:, q:] + np.diag([(size_of(effect) / LARGEST_FAULT) ** 2 for effect in others])
        stands_in = H[:q, q:] @ np.linalg.pinv(free, hermitian=True) @ H[q:, :q]  # a play of zero width adds nothing
        if len(H) == 2 and one_sided(ones[0]) and one_sided(others[0]) and H[0, 1] < 0:
            stands_in = np.zeros((1, 1))
        return float(np.sqrt(max(np.trace(H[:q, :q] - stands_in) / q, 0.0)))

    def close_pairs(self, chosen: Sequence[Candidate], sizes: Array) -> list[tuple[int, int]]:
        """Close pairs (i, j) of candidates with sizes (n,) in healthy sizes, with all other forms of either effect
        present. They include all pairs with `separation_sigma` below SEPARABLE.
        """
        pairs = np.stack(np.triu_indices(len(chosen), 1), axis=1).astype(np.int64)
        sigma = self._form_posterior.sigmas_apart(chosen, sizes, pairs)
        close = np.flatnonzero(sigma < SEPARABLE)
        nearest_first = pairs[close[np.argsort(sigma[close])]].tolist()
        return [(i, j) for i, j in nearest_first if chosen[i].name != chosen[j].name]

    def _background_with_effects(self, effects: Sequence[Effect]) -> Background:
        variance = self._variance
        for effect in effects:
            variance = variance * remaining_column_shares(self._columns.forms, effect, len(variance))
        return background_of(self._columns, np.ones(len(self.linear.y)), variance)


def expected_posterior(blocks: Sequence[Block], setups: SetUps, level: Level = HEALTHY) -> ExpectedPosterior:
    return ExpectedPosterior(linearise(without_bands(blocks), setups), level)

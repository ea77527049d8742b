"""Validation: residuals of a frozen model on used, held-out and unseen runs, and the gain of each effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.evidence.blocks import Block, blocks_of
from analysis.diagnosis.evidence.observation import ObservedRun, residual_of, rms
from analysis.diagnosis.evidence.setups import FittedRuns, fit_run_setups, with_effects
from analysis.diagnosis.fit.responses import basis_of, limits_um, linearise, noise_um, rms_um
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.fit.selection_state import background_effects
from analysis.diagnosis.judge.result import Gap, TestGap
from analysis.procedures.shared.test_kind import facts_of
from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import SetUp
from rigs.effects import Effect


@dataclass(frozen=True)
class FrozenModel:
    """A frozen model for comparison with runs: the effects added to the rig file, and the set-ups fitted with them
    to the runs used."""

    effects: tuple[Effect, ...]
    setups: Mapping[str, SetUp]

    def residuals(self, runs: Sequence[ObservedRun]) -> list[Array]:
        """Return the residuals (m, k) mm of each run. Runs in a known set-up keep it; a set-up is fitted to each
        other run.
        """
        modelled = with_effects(runs, self.effects)
        setups = self.setups_with(modelled)
        return [residual_of(run.on_lap, setups) for run in modelled]

    def setups_with(self, runs: Sequence[ObservedRun]) -> dict[str, SetUp]:
        """Return the set-ups of the model, and set-ups fitted to the runs whose set-up is not among them."""
        new = [run for run in runs if run.setup not in self.setups]
        return {**self.setups, **(fit_run_setups(new)[0] if new else {})}


@dataclass(frozen=True)
class Stages:
    """Models compared with runs, in this order: initial, with the named effects, and calibrated."""

    bare: FrozenModel
    named: FrozenModel
    calibrated: FrozenModel

    @property
    def has_background(self) -> bool:
        """Whether the calibrated model contains more than the named effects."""
        return self.calibrated.effects != self.named.effects

    def without_calibration(self) -> Stages:
        """Return the models with the named effects alone in place of the calibrated model."""
        return replace(self, calibrated=self.named)


def stages_of(fitted: FittedRuns, result: SearchResult) -> Stages:
    """Return the models of a search, with set-ups fitted to the runs used, (m, k) mm.

    If the complete model explains these runs worse than the named effects, the calibrated model contains only the named
    effects.
    """
    names = result.effects
    whole = (*names, *background_effects(result.calibrated_posterior))
    bare, named, calibrated = (
        FrozenModel(effects, fitted.fit_with_effects(effects)[0]) for effects in ((), names, whole)
    )
    is_worse = rms(fitted.fit_with_effects(whole)[1]) > rms(fitted.fit_with_effects(names)[1])
    return Stages(bare, named, named if is_worse else calibrated)


def gap(runs: Sequence[ObservedRun], stages: Stages, result: SearchResult, run_names: Sequence[str]) -> Gap:
    """Return the gap of runs with the initial model, with the named effects, and calibrated; residuals are (m, k) mm.

    The noise and scatter of a run are estimated from repeats, or else assumed. For touches and many poses, the estimate
    is limited by the residuals. Runs of a different place use the noise of their test.
    """
    bare, named, calibrated = (model.residuals(runs) for model in (stages.bare, stages.named, stages.calibrated))
    before_um, after_um, calibrated_um = (1e3 * rms(residuals) for residuals in (bare, named, calibrated))
    tests = []
    for test in dict.fromkeys(run.table.test for run in runs):
        um = []
        for residuals in (bare, calibrated):
            of_test = [mm for run, mm in zip(runs, residuals, strict=True) if run.table.test == test]
            sizes = [np.linalg.norm(mm, axis=1) if mm.shape[1] == 3 else np.abs(mm) for mm in of_test]
            um += [1e3 * rms(of_test), 1e3 * max(float(size.max()) for size in sizes)]
        tests.append(TestGap(test, *um))
    keeps = all(run.setup in stages.calibrated.setups for run in runs)
    blocks, same_names = result.linear.blocks, {run.name for run in runs}
    alike = [block.name in same_names for block in blocks]
    if not any(alike):
        same_tests = {run.table.test for run in runs}
        alike = [block.table.test in same_tests for block in blocks]
    size = np.array([len(block.rows) * block.count for block in blocks]) * (alike if any(alike) else 1)
    floor_um = float(np.sqrt(size @ (noise_shown(result) * noise_um(result.linear) ** 2) / size.sum()))
    return Gap(tuple(run_names), before_um, after_um, floor_um, calibrated_um, tuple(tests), keeps)


_SHOW_NOISE = 20
"""Number of poses from which the residuals show the noise, partly absorbed by a set-up and an arm. Source: 24 poses
of an independent generator with noise of 21.5 µm show 17.5, 50 with 51 show 44, 47 with 39 show 36; the assumed
noise was 71.
"""


def shows_noise(block: Block) -> bool:
    """Return whether readings (m, k) show their noise even if not repeated: touches, or enough poses."""
    return facts_of(block.table.test).of_places and (
        facts_of(block.table.test).constants_apart or len(block.rows) >= _SHOW_NOISE
    )


def noise_shown(result: SearchResult) -> Array:
    """Return the share of the noise variance shown by the readings of each block (b,), at most 1."""
    linear, strength = result.linear, result.strength
    blocks = zip(linear.blocks, linear.rows, strict=True)
    return np.array([min(float(strength[rows].mean()), 1.0) if shows_noise(block) else 1.0 for block, rows in blocks])


def held_out_gains(result: SearchResult, runs: Sequence[ObservedRun]) -> list[float | None]:
    """Return the share of the gap's energy on held-out runs that each effect removes in addition to all other effects.
    None if no held-out run shows the named effect beyond the scatter of a run.

    The set-up is refitted to each run. A healthy arm's share of every effect is estimated from the runs used. Residuals
    are (m, k) mm.
    """
    whole, gained, shown = 0.0, np.zeros(len(result.contributions)), np.zeros(len(result.contributions), dtype=bool)
    setups = result.linear.setups_moved_by(result.moves)
    for run in runs:
        judged = _at_places_used(result, run) or _at_other_places(result, run, setups)
        residual = judged.residual - judged.free_share
        after = judged.energy(residual)
        whole += judged.energy(judged.before)
        gained += [judged.energy(residual + change) - after for change in judged.contributions]
        shown |= np.array([judged.shows(change) for change in judged.contributions], dtype=bool)
    return [float(gain / whole) if is_shown else None for gain, is_shown in zip(gained, shown, strict=True)]


@dataclass(frozen=True)
class _JudgedRun:
    """A validation run with the named effects and the background determined by other runs, in standard deviations of a
    block (N,).

    `before` is the residual of the initial model and `residual` that of the complete model. `free_share` is the
    additional contribution of unknown causes. `contributions` are the changes when each effect is removed.
    `basis` (N, s) is orthonormal and spans the changes that the set-up could absorb. `limit_um` is the rms change from
    which an effect is material compared with the scatter of a run.
    """

    block: Block
    before: Array
    residual: Array
    free_share: Array
    contributions: Sequence[Array]
    basis: Array
    limit_um: float

    def without_set_up(self, values: Array) -> Array:
        """Return whitened values (N,) with the part removed that the set-up could absorb."""
        return values - self.basis @ (self.basis.T @ values)

    def energy(self, values: Array) -> float:
        """Return the energy in mm² of values (N,), with the set-up fitted."""
        return float(((self.without_set_up(values) * self.block.sd_mm) ** 2).sum())

    def shows(self, change: Array) -> bool:
        """Return whether a change of the readings (N,) is material compared with the scatter of a run, with the
        set-up fitted."""
        return rms_um(self.block, self.without_set_up(change) * self.block.sd_mm) > self.limit_um


def _at_places_used(result: SearchResult, run: ObservedRun) -> _JudgedRun | None:
    """Return a run at places used by runs of the same kind; None if there are none or the standstills differ."""
    linear = result.linear
    kinds = [(block.name, block.targets_key) for block in linear.blocks]
    kind = (run.name, run.targets_key)
    if kind not in kinds or run.model.rig != linear.blocks[kinds.index(kind)].model.rig:
        return None
    k = kinds.index(kind)
    block, rows = linear.blocks[k], linear.rows[k]
    sampling = run.sampling
    if sampling and block.sampling:
        sampling = replace(
            sampling if block.sampling.stands else sampling.without_stands(), bridged=block.sampling.bridged
        )
        sampling = sampling if len(block.sampling.trend) else sampling.without_trend()
    (with_names,) = with_effects([run], result.effects)
    # Linearized at the set-ups fitted with the names, as in the fit of the names.
    residual = residual_of(with_names, linear.setups_moved_by(result.moves))
    run_entries = replace(run, sampling=sampling).entries(residual)
    if len(run_entries) != len(block.y_mm):
        return None
    whitened = block.white(run_entries) + linear.U[rows] @ result.moves
    before = whitened + (linear.residual(()) - result.fit.residual)[rows]
    changes = [change[rows] for change in result.contributions]
    residual_with_share = whitened - result.posterior.healthy_share[rows]
    free, limit = result.free_share[rows], float(result.scatter_limits_um[k])
    return _JudgedRun(block, before, residual_with_share, free, changes, basis_of(linear.U[rows]), limit)


def _at_other_places(result: SearchResult, run: ObservedRun, setups: Mapping[str, SetUp]) -> _JudgedRun:
    """Return a run at places or conditions absent from the runs used: other poses, a different radius or speed."""
    effects = result.effects
    placed = setups if run.setup in setups else fit_run_setups(with_effects([run], effects))[0]
    of_run = linearise(blocks_of([run], placed, effects), placed, effects)
    share, residual = result.columns.forms_in(of_run), of_run.residual(effects)
    changes = of_run.contributions(effects, residual)
    with_share = residual - share @ result.posterior.mean[: share.shape[1]]
    (block,), none, limit = of_run.blocks, np.zeros_like(with_share), float(limits_um(of_run)[0])
    return _JudgedRun(block, of_run.residual(()), with_share, none, changes, basis_of(of_run.U), limit)


def residual_um(runs: Sequence[ObservedRun], used: FittedRuns, effects: Sequence[Effect]) -> float:
    """Return the rms residual (m, k) of runs with given effects only, in µm: the error that their remedy would leave.

    As in the gap, runs in a set-up of the runs used keep it, and a set-up is fitted to each other run.
    """
    return 1e3 * rms(FrozenModel(tuple(effects), used.fit_with_effects(effects)[0]).residuals(runs))

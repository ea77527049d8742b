"""Validation: what a frozen model leaves of runs used, held out and of another place, and what each name gains."""

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
from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import SetUp
from rigs.effects import Effect


@dataclass(frozen=True)
class FrozenModel:
    """A model that is held against runs: the effects that it adds to the rig file, and the set-ups that fit the runs
    used with them."""

    effects: tuple[Effect, ...]
    setups: Mapping[str, SetUp]

    def residuals(self, runs: Sequence[ObservedRun]) -> list[Array]:
        """Return the residuals (m, k) mm of each run. Runs in a set-up that was used keep it; the others have their own
        fitted."""
        modelled = with_effects(runs, self.effects)
        setups = self.setups_with(modelled)
        return [residual_of(run.on_lap, setups) for run in modelled]

    def setups_with(self, runs: Sequence[ObservedRun]) -> dict[str, SetUp]:
        """Return its set-ups, and those of runs with its effects, of (m, k) mm, that are in none of them."""
        new = [run for run in runs if run.setup not in self.setups]
        return {**self.setups, **(fit_run_setups(new)[0] if new else {})}


@dataclass(frozen=True)
class Stages:
    """The models that are held against runs, one after the other: without what was found, with the names, and
    calibrated."""

    bare: FrozenModel
    named: FrozenModel
    calibrated: FrozenModel

    @property
    def has_background(self) -> bool:
        """Whether the calibrated model has more than the names."""
        return self.calibrated.effects != self.named.effects

    def names_alone(self) -> Stages:
        """Return these models with the names in place of the whole one."""
        return replace(self, calibrated=self.named)


def stages_of(fitted: FittedRuns, result: SearchResult) -> Stages:
    """Return the models of a search, with set-ups fitted to the runs used, of (m, k) mm. Where what was found beside
    the names explains these runs worse than the names alone, the calibrated model has the names alone."""
    names = result.effects
    whole = (*names, *background_effects(result.calibrated_posterior))
    bare, named, calibrated = (FrozenModel(effects, fitted.beside(effects)[0]) for effects in ((), names, whole))
    is_worse = rms(fitted.beside(whole)[1]) > rms(fitted.beside(names)[1])
    return Stages(bare, named, named if is_worse else calibrated)


def gap(runs: Sequence[ObservedRun], stages: Stages, result: SearchResult, run_names: Sequence[str]) -> Gap:
    """Return the gap of runs without what was found, with the names, and calibrated; residuals are (m, k) mm.

    The noise and scatter of one of the runs come from repeats, or else from the assumed noise; that of touches, and of
    many poses, as far as the readings show it. Runs of another place have that of their test.
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
"""Poses that show their own noise, of which a set-up and an arm take some. Source: 24 poses of an independent generator
with noise of 21.5 µm show 17.5, 50 with 51 show 44, 47 with 39 show 36; assumed were 71."""


def shows_noise(block: Block) -> bool:
    """Return whether readings (m, k) show their own noise without repeats: touches, or enough poses."""
    return block.table.kind.of_places and (block.table.kind.constants_apart or len(block.rows) >= _SHOW_NOISE)


def noise_shown(result: SearchResult) -> Array:
    """Return which share of the variance of its noise the readings of each block (b,) show, at the most all."""
    linear, strength = result.linear, result.strength
    blocks = zip(linear.blocks, linear.rows, strict=True)
    return np.array([min(float(strength[rows].mean()), 1.0) if shows_noise(block) else 1.0 for block, rows in blocks])


def held_out_gains(result: SearchResult, runs: Sequence[ObservedRun]) -> list[float | None]:
    """Return, for each name, the share of the gap's energy on held-out runs that it removes beside everything else that
    was found, or None where no held-out run shows it beyond the scatter of one run.

    The set-up is fitted again to each run; a healthy arm's share of every effect is taken from the runs used. Residuals
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
    """One run judged by the names and the healthy share that other runs determined, in standard deviations of a block
    (N,).

    `before` is the residual without them and `residual` that with all of them. `free_share` is what free forms add
    beside them, zero where that is not known. `contributions` are the changes when each name is removed.
    `basis` (N, s) is orthonormal and spans what the set-up could absorb. `limit_um` is the rms change from which a name
    is material beside the scatter of one run.
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
        """Return whether a change of the readings (N,) is material beside the scatter of one run, with the set-up
        fitted."""
        return rms_um(self.block, self.without_set_up(change) * self.block.sd_mm) > self.limit_um


def _at_places_used(result: SearchResult, run: ObservedRun) -> _JudgedRun | None:
    """Return a run at places where runs of its kind were used, or None where there are none or where its periods of
    standing differ from theirs."""
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
    # Where the set-ups fit the names, and back along their slopes, as the names were fitted.
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
    """Return a run at places, or in a way, that no run used has: other poses, another radius, another speed."""
    effects = result.effects
    placed = setups if run.setup in setups else fit_run_setups(with_effects([run], effects))[0]
    of_run = linearise(blocks_of([run], placed, effects), placed, effects)
    share, residual = result.columns.forms_in(of_run), of_run.residual(effects)
    changes = of_run.contributions(effects, residual)
    with_share = residual - share @ result.posterior.mean[: share.shape[1]]
    (block,), none, limit = of_run.blocks, np.zeros_like(with_share), float(limits_um(of_run)[0])
    return _JudgedRun(block, of_run.residual(()), with_share, none, changes, basis_of(of_run.U), limit)


def residual_um(runs: Sequence[ObservedRun], used: FittedRuns, effects: Sequence[Effect]) -> float:
    """Return the rms residual (m, k) of runs with some effects alone, in µm: what their remedy alone leaves. As in the
    gap, runs in a set-up of the runs used keep it, and others have their own."""
    return 1e3 * rms(FrozenModel(tuple(effects), used.beside(effects)[0]).residuals(runs))

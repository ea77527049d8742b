"""The proof: what a frozen model leaves of the runs used, of runs left out, and of runs at another place."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.blocks import Block, blocks_of, entries, places_of
from analysis.diagnosis.diagnosis import Gap
from analysis.diagnosis.linear import Linear, basis_of
from analysis.diagnosis.look import Look
from analysis.diagnosis.observed import Seen
from analysis.diagnosis.settle import grown, settled
from analysis.diagnosis.worth import rms_um, scatter_um
from analysis.fitting.observation import residuals_of, rms
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.effects import Effect


def gap(runs: Sequence[Seen], look: Look, names: Sequence[str]) -> Gap:
    """Runs, with their names, before and after effects are in their model, set-ups fitted both times."""
    effects = look.state.refined.effects
    setups, before = settled(runs)
    setups, after = settled(grown(runs, effects), setups) if effects else (setups, before)
    floor = _floor(look.linear, {run.name for run in runs})
    return Gap(tuple(names), 1e3 * rms(before), 1e3 * rms(after), floor, _calibrated_um(look, runs, setups))


def _calibrated_um(look: Look, runs: Sequence[Seen], setups: Mapping[str, SetUp]) -> float:
    """What is left of runs, rms in µm, with a healthy arm's share of everything taken out beside the names."""
    energy, count = 0.0, 0
    for run in runs:
        judged = _there(look, run) or _elsewhere(look, run, setups)
        um = rms_um(judged.block, judged.set_up(judged.left) * judged.block.sd_mm)
        energy, count = energy + len(run.one.rows) * um**2, count + len(run.one.rows)
    return float(np.sqrt(energy / count))


def gain_of_each(look: Look, runs: Sequence[Seen]) -> list[float | None]:
    """By name: the share of the gap's energy on runs left out that it removes beside everything else that was found;
    None where no run was left out.

    The set-up is fitted to each run anew; a healthy arm's share of everything is taken as the runs used have it.
    """
    whole, gained = 0.0, np.zeros(len(look.changes))
    for run in runs:
        judged = _there(look, run) or _elsewhere(look, run, look.linear.setups)
        after = judged.energy(judged.left)
        whole += judged.energy(judged.before)
        gained += [judged.energy(judged.left + change) - after for change in judged.changes]
    return [float(one / whole) for one in gained] if whole else [None] * len(gained)


@dataclass(frozen=True)
class _Judged:
    """One run by the names and the healthy share that other runs showed, in standard deviations of a block (N,).

    before: what it leaves without them; left: with all of them; changes: what taking each name out again adds; basis
    (N, s): orthonormal, of what its set-up could take up."""

    block: Block
    before: Array
    left: Array
    changes: Sequence[Array]
    basis: Array

    def set_up(self, values: Array) -> Array:
        """Values (N,) less what the set-up could take up."""
        fitted: Array = values - self.basis @ (self.basis.T @ values)
        return fitted

    def energy(self, values: Array) -> float:
        """Of values (N,) in mm², the set-up fitted."""
        return float(((self.set_up(values) * self.block.sd_mm) ** 2).sum())


def _there(look: Look, run: Seen) -> _Judged | None:
    """A run where others of its kind were looked at; None where there was none, or where it did not stand before and
    after as those did."""
    linear = look.linear
    kinds = [(block.name, block.places) for block in linear.blocks]
    kind = (run.name, places_of(run))
    if kind not in kinds or run.model.rig != linear.blocks[kinds.index(kind)].model.rig:
        return None
    k = kinds.index(kind)
    block, rows = linear.blocks[k], linear.rows[k]
    sampling = run.sampling
    if sampling and block.sampling and not block.sampling.stands:
        sampling = sampling.without_stands()
    (with_names,) = grown([run], look.state.refined.effects)
    (residual,) = residuals_of(with_names.model, [with_names.one], linear.setups)
    found = entries(residual, sampling)
    if len(found) != len(block.y_mm):
        return None
    left = block.white(found)
    before = left + (linear.left(()) - look.state.refined.left)[rows]
    changes = [change[rows] for change in look.changes]
    return _Judged(block, before, left - look.posterior.healthy_share[rows], changes, basis_of(linear.U[rows]))


def _elsewhere(look: Look, run: Seen, setups: Mapping[str, SetUp]) -> _Judged:
    """A run at places, or in a way, that no other was looked at: other poses, another radius, another speed."""
    effects, forms = look.state.refined.effects, look.posterior.background.columns.forms
    placed = setups if run.one.setup in setups else settled(grown([run], effects))[0]
    alone = Linear(blocks_of([run], placed, effects), placed, effects)
    sizes = np.repeat([form.size for form in forms], [len(form.columns) for form in forms])
    share = alone.columns([effect for form in forms for effect in form.effects]) / sizes
    left = alone.left(effects)
    changes = [alone.left([*effects[:k], *effects[k + 1 :]]) - left for k in range(len(effects))]
    with_share = alone.y - share @ look.posterior.mean[: share.shape[1]]
    (block,) = alone.blocks
    return _Judged(block, alone.left(()), with_share, changes, basis_of(alone.U))


def without(runs: Sequence[Seen], effects: Sequence[Effect], k: int, setups: Mapping[str, SetUp]) -> float:
    """What all effects but one leave of runs, rms in µm, set-ups fitted; `setups`: to begin at."""
    return 1e3 * rms(settled(grown(runs, [*effects[:k], *effects[k + 1 :]]), setups)[1])


def _floor(linear: Linear, names: Collection[str]) -> float:
    """Root mean square in µm that noise and scatter of a run give: from repeats, else from the noise assumed."""
    alike = [block.name in names for block in linear.blocks]
    size = np.array([len(block.one.rows) * block.count for block in linear.blocks]) * (alike if any(alike) else 1)
    return float(np.sqrt(size @ scatter_um(linear) ** 2 / size.sum()))

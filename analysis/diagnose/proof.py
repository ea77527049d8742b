"""The proof: what a frozen model leaves of the runs used, of runs left out, and of runs at another place."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from analysis.diagnose.blocks import Block, blocks_of, entries, places_of
from analysis.diagnose.diagnosis import Gap
from analysis.diagnose.linear import Linear, basis_of
from analysis.diagnose.look import Look
from analysis.diagnose.observed import Seen
from analysis.diagnose.settle import grown, settled
from analysis.diagnose.worth import plain_worth, rms_um, scatter_um
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
    known = {(block.name, block.places): k for k, block in enumerate(look.linear.blocks)}
    energy, count = 0.0, 0
    for run in runs:
        k = known.get((run.name, places_of(run)))
        left = _left_of(run, look.linear.blocks[k], look) if k is not None else None
        um = _elsewhere_um(look, run, setups) if left is None or k is None else _there_um(look, k, left)
        energy, count = energy + len(run.one.rows) * um**2, count + len(run.one.rows)
    return float(np.sqrt(energy / count))


def _there_um(look: Look, k: int, left: Array) -> float:
    """Of a run of a block that was looked at, left (N,) in standard deviations."""
    rows, linear = look.linear.rows[k], look.linear
    values = left - look.posterior.healthy_share[rows]
    basis = basis_of(linear.U[rows])
    return rms_um(linear.blocks[k], (values - basis @ (basis.T @ values)) * linear.blocks[k].sd_mm)


def _elsewhere_um(look: Look, run: Seen, setups: Mapping[str, SetUp]) -> float:
    """Of a run at another place, radius or speed."""
    effects, forms = look.state.refined.effects, look.posterior.background.columns.forms
    alone = Linear(blocks_of([run], setups, effects), setups, effects)
    sizes = np.repeat([form.size for form in forms], [len(form.columns) for form in forms])
    share = alone.columns([effect for form in forms for effect in form.effects]) / sizes
    return plain_worth(alone, alone.set_up(alone.y - share @ look.posterior.mean[: share.shape[1]])).whole_um


def gain_of_each(look: Look, runs: Sequence[Seen]) -> list[float | None]:
    """By name: the share of the gap's energy on runs left out that it removes beside everything else that was found;
    None where no run of a test and direction that was looked at was left out.

    The set-up is fitted to each run anew; a healthy arm's share of everything is taken as the runs used have it.
    """
    linear, changes = look.linear, look.changes
    healthy, before = look.posterior.healthy_share, linear.left(()) - look.state.refined.left
    whole, gained, judged_by = 0.0, np.zeros(len(changes)), 0
    for block, rows in zip(linear.blocks, linear.rows, strict=True):
        for run in runs:
            left = _left_of(run, block, look)
            if left is None:
                continue
            judged_by += 1
            basis = basis_of(linear.U[rows])

            def energy(change: Array, left: Array = left, basis: Array = basis, block: Block = block) -> float:
                values = left + change
                return float((((values - basis @ (basis.T @ values)) * block.sd_mm) ** 2).sum())

            after = energy(-healthy[rows])
            whole += energy(before[rows])
            gained += [energy(change[rows] - healthy[rows]) - after for change in changes]
    return [float(one / whole) for one in gained] if judged_by else [None] * len(changes)


def _left_of(run: Seen, block: Block, look: Look) -> Array | None:
    """What the names leave of one run, (N,) in standard deviations of a block of its kind; None where the run is of
    another kind or place, or did not stand before and after as those did."""
    if (run.name, places_of(run)) != (block.name, block.places) or run.model.rig != block.model.rig:
        return None
    sampling = run.sampling
    if sampling and block.sampling and not block.sampling.stands:
        sampling = sampling.without_stands()
    (with_names,) = grown([run], look.state.refined.effects)
    (left,) = residuals_of(with_names.model, [with_names.one], look.linear.setups)
    found = entries(left, sampling)
    return block.white(found) if len(found) == len(block.y_mm) else None


def without(runs: Sequence[Seen], effects: Sequence[Effect], k: int, setups: Mapping[str, SetUp]) -> float:
    """What all effects but one leave of runs, rms in µm, set-ups fitted; `setups`: to begin at."""
    return 1e3 * rms(settled(grown(runs, [*effects[:k], *effects[k + 1 :]]), setups)[1])


def _floor(linear: Linear, names: Collection[str]) -> float:
    """Root mean square in µm that noise and scatter of a run give: from repeats, else from the noise assumed."""
    alike = [block.name in names for block in linear.blocks]
    size = np.array([len(block.one.rows) * block.count for block in linear.blocks]) * (alike if any(alike) else 1)
    return float(np.sqrt(size @ scatter_um(linear) ** 2 / size.sum()))

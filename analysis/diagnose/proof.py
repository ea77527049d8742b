"""The proof: what a frozen model leaves of the runs used, of runs left out, and of runs at another place."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from analysis.diagnose.blocks import Block
from analysis.diagnose.diagnosis import Gap
from analysis.diagnose.observed import Seen
from analysis.diagnose.runs import about
from analysis.diagnose.settle import grown, settled
from analysis.fitting.observation import rms
from analysis.model.predict import SetUp
from analysis.reading.loading import Measured
from rigs.effects import Effect
from rigs.rig import Rig


def gap(runs: Sequence[Seen], effects: Sequence[Effect], blocks: Sequence[Block], names: Sequence[str]) -> Gap:
    """Runs, with their names, before and after effects are in their model, set-ups fitted both times."""
    setups, before = settled(runs)
    after = settled(grown(runs, effects), setups)[1] if effects else before
    floor = _floor(blocks, {run.name for run in runs})
    return Gap(tuple(names), 1e3 * rms(before), 1e3 * rms(after), floor)


def judged(rig: Rig, runs: Sequence[Measured], effects: Sequence[Effect], blocks: Sequence[Block]) -> Gap | None:
    """The frozen model on runs that had no part in it."""
    return gap(about(rig, runs), effects, blocks, [run.run.manifest.name for run in runs]) if runs else None


def without(runs: Sequence[Seen], effects: Sequence[Effect], k: int, setups: Mapping[str, SetUp]) -> float:
    """What all effects but one leave of runs, rms in µm, set-ups fitted; `setups`: to begin at."""
    return 1e3 * rms(settled(grown(runs, [*effects[:k], *effects[k + 1 :]]), setups)[1])


def _floor(blocks: Sequence[Block], names: Collection[str]) -> float:
    """Root mean square in µm that noise and scatter of a run give: from repeats, else from the noise assumed."""
    total = count = 0.0
    for block in blocks:
        if block.name in names or not any(one.name in names for one in blocks):
            sd = (
                block.apart_mm if np.isfinite(block.apart_mm) else float(np.sqrt(np.mean(block.sd_mm**2 * block.count)))
            )
            size = len(block.one.rows) * block.count
            total, count = total + size * sd**2, count + size
    return 1e3 * float(np.sqrt(total / count))

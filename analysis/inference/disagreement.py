"""Where a model and readings disagree, and what is left as the effects of the model are added one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.inference.blocks import blocks_of
from analysis.inference.budget import Measure
from analysis.inference.compare import Compared
from analysis.inference.prepared_runs import prepare_runs
from analysis.inference.residuals import Curve, Map, Place, curves_of, maps_of, places
from analysis.inference.responses import linearise, noise_um
from analysis.inference.setups import fit_run_setups
from analysis.inference.staircase import Left, Staircase, Step
from analysis.inference.stepwise import drawn, residuals_um_of
from analysis.traces.loading import Measured
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig


@dataclass(frozen=True)
class Disagreement:
    """The places where the model of a rig and readings disagree, the largest sigma first, and the residuals of circles
    and at targets without the effects of the model (before) and with them (after). `staircase` has a step for each
    effect of the rig file, and one for its calibration, whose place is after them; None for a model without effects.
    `floor_um` is the noise of a run."""

    rig: Rig
    where: tuple[Place, ...]
    curves: tuple[Curve, ...]
    maps: tuple[Map, ...]
    staircase: Staircase | None
    floor_um: float

    def to_dict(self) -> dict[str, Any]:
        """In plain types, with the keys of a diagnosis."""
        names = [*(f"effect {k}" for k in range(1, len(self.rig.effects) + 1)), "calibration"]
        steps = self.staircase.to_dict(names) if self.staircase else None
        return {"where": [place.to_dict() for place in self.where], "staircase": steps}


def located(compared: Compared, rig: Rig, used: Sequence[Measured], unseen: Sequence[Measured] = ()) -> Compared:
    """Return a comparison with where model and readings, of (m, k) mm, disagree, or with a message why that is not
    known."""
    try:
        return replace(compared, disagreement=disagreement(rig, used, unseen))
    except FileError as error:
        message = f"where model and readings disagree is not known: {error}"
        return replace(compared, doubts=(*compared.doubts, message))


def disagreement(rig: Rig, used: Sequence[Measured], unseen: Sequence[Measured] = ()) -> Disagreement:
    """Return where the model of a rig and runs, of (m, k) mm, disagree; those of an unseen place have set-ups of their
    own. Raises FileError for runs that cannot be looked at together."""
    parts, _ = prepare_runs(rig, used, unseen)
    runs, elsewhere = ([replace(run, model=replace(run.model, effects=())) for run in part] for part in parts)
    setups, _ = fit_run_setups(runs)
    linear = linearise(blocks_of(runs, setups), setups)
    # The effects of the rig file, those first that change the readings most, and then what its calibration holds beside
    # them, each with its place.
    measure = Measure(linear)
    um = [measure.um(linear.columns([effect])[:, 0]) for effect in rig.effects]
    groups: list[tuple[int, tuple[Effect, ...]]]
    groups = [(k, (rig.effects[k],)) for k in sorted(range(len(um)), key=lambda k: -um[k])]
    if rig.calibrated and rig.calibrated.effects:
        groups.append((len(um), tuple(rig.calibrated.effects)))
    models = [tuple(effect for _, group in groups[:k] for effect in group) for k in range(len(groups) + 1)]
    curves, maps = drawn(linear, models)
    ends = [linear.residual(effects) for effects in (models[0], models[-1])]
    before, after = (linear.in_mm(measure.without_set_up(end)) for end in ends)
    floor_um = float(np.sqrt(np.mean(noise_um(linear) ** 2)))
    u_um = [floor_um / np.sqrt(max(len(runs_there), 1)) for runs_there in (runs, elsewhere)]
    steps = []
    for k, residuals_um in enumerate(residuals_um_of(models, (runs, elsewhere)) if groups else ()):
        then, later = (Left(um, float(u)) if um is not None else None for um, u in zip(residuals_um, u_um, strict=True))
        assert then is not None  # noqa: S101 - runs were prepared
        steps.append(Step((groups[k - 1][0],) if k else (), then, unseen=later))
    staircase = Staircase(tuple(steps), curves, maps) if groups else None
    return Disagreement(
        rig,
        places(linear.blocks, after, measure.scatter_mm()),
        curves_of(linear.blocks, before, after),
        maps_of(linear.blocks, before, after),
        staircase,
        floor_um,
    )

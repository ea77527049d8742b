"""Comparison of two arms: residuals of the same readings, with the set-ups fitted to each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from analysis.apps.report.blocks import Block, Sentence, Table, paragraphs
from analysis.apps.report.diagnosis_words import micrometres
from analysis.diagnosis.evidence.observation import by_socket, rms
from analysis.diagnosis.evidence.placements import observe_runs, split_by_frame, split_by_target
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.runs.copies import USED, refuse_repeated
from analysis.runs.loading import Measured
from analysis.runs.tabular import for_json
from rigs.errors import FileError
from rigs.rig import Rig

_CLEARLY = 0.97
"""3 % of the rms is more than a fitted set-up gains by chance."""


@dataclass(frozen=True)
class ArmFit:
    file: str
    rms_um: float
    largest_um: float


@dataclass(frozen=True)
class FittingArm:
    fits: tuple[ArmFit, ArmFit]
    runs: tuple[str, ...]
    doubts: tuple[str, ...] = ()

    @property
    def better(self) -> ArmFit | None:
        """None if the runs do not distinguish the arms."""
        best, worse = sorted(self.fits, key=lambda fit: fit.rms_um)
        return best if best.rms_um < _CLEARLY * worse.rms_um else None

    @property
    def times(self) -> float:
        best, worse = sorted(fit.rms_um for fit in self.fits)
        return worse / best if best > 0 else np.inf

    def to_dict(self) -> dict[str, Any]:
        better = self.better.file if self.better else None
        plain: dict[str, Any] = for_json(asdict(self) | {"better": better, "times": self.times})
        return plain


def fitting_arm(runs: Sequence[Measured], arms: Sequence[tuple[str, Rig]]) -> FittingArm:
    refuse_repeated({USED: runs})
    first, second = (_fit(runs, file, rig) for file, rig in arms)
    return FittingArm((first[0], second[0]), tuple(run.run.manifest.name for run in runs), first[1])


def fitting_answer(fitting: FittingArm) -> list[Block]:
    better, head = fitting.better, "These runs do not distinguish the two arms."
    if better is not None:
        (worse,) = (fit for fit in fitting.fits if fit is not better)
        head = (
            f"{better.file} fits: it leaves {micrometres(better.rms_um)} rms of the readings, and {worse.file} "
            f"{micrometres(worse.rms_um)} rms, {fitting.times:.3g} times as much."
        )
    rows = tuple((fit.file, f"{fit.rms_um:.1f}", f"{fit.largest_um:.1f}") for fit in fitting.fits)
    table = Table(("arm", "µm rms left", "at most"), rows, frozenset({1, 2}))
    return [Sentence(head), table, *paragraphs(fitting.doubts, "doubt")]


def _fit(runs: Sequence[Measured], file: str, rig: Rig) -> tuple[ArmFit, tuple[str, ...]]:
    """Residual, and messages about the positions of base, ball and tool."""
    axes = len(rig.robot.axes)
    for run in runs:
        if (count := len(run.rig.robot.axes)) != axes:
            problem = f"has an arm of {axes} axes, but {run.path} was measured on an arm of {count}"
            raise FileError(file, problem, "give the arm that was measured", code="runs.not_comparable")
    of_arm = [replace(run, rig=run.rig.model_copy(update={"robot": rig.robot})) for run in runs]
    parts = [
        (run, part) for run, whole in zip(runs, observe_runs(rig, of_arm), strict=True) for part in by_socket(whole)
    ]
    names = [run.run.manifest.name for run, _ in parts]
    placed, messages = split_by_frame([part for _, part in parts], names)
    placed, of_targets = split_by_target(placed, names)
    residuals = fit_run_setups(placed)[1]
    largest_mm = max(float(np.linalg.norm(r, axis=1).max() if r.shape[1] == 3 else np.abs(r).max()) for r in residuals)
    return ArmFit(file, 1e3 * rms(residuals), 1e3 * largest_mm), (*messages, *of_targets)

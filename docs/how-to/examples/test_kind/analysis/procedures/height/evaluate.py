"""Figures of the height test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.procedures.shared.evaluate import Evaluation, Instruments, check_numbers
from analysis.procedures.shared.lap_curve import SEED
from analysis.procedures.shared.quantity import Quantity, figures_of
from analysis.procedures.shared.result_curves import PoseCurve
from analysis.robot.kinematics.arm import Array, arm_of, forward
from analysis.runs.noise.spectrum import DRAWS
from rigs.errors import FileError
from rigs.rig import Rig

from .format import HeightTable

_U_MM = 0.02
"""Standard uncertainty of a reading: maximum permissible error of 0.035 mm of a good height gauge, over √3."""
_FEWEST = 4


@dataclass(frozen=True)
class HeightResult:
    """off_mm (n,): measured less nominal, without the mean; figures by name; notes in words."""

    off_mm: Array
    figures: dict[str, Quantity]
    samples: int
    notes: tuple[str, ...] = ()

    @property
    def as_curve(self) -> PoseCurve:
        """The errors (n, 3) mm, along z alone, in the order of the table."""
        return PoseCurve(self.off_mm[:, None] * [0.0, 0.0, 1.0], None)


class HeightEvaluation(Evaluation[HeightTable]):
    """Figures of the height test."""

    def evaluate(self, table: HeightTable, rig: Rig, where: str, instruments: Instruments) -> HeightResult:
        """The figures by the nominal arm: height_rms_mm, and height_band_mm, the largest less the smallest."""
        check_numbers(where, q=table.q, height_mm=table.height_mm)
        count = len(table.q)
        if count < _FEWEST:
            raise FileError(where, f"has {count} heights, too few to judge an arm", f"give at least {_FEWEST}")
        off_mm = table.height_mm - forward(arm_of(rig.robot), table.q)[:, 2, 3]
        noise = np.random.default_rng(SEED).normal(0.0, _U_MM, (DRAWS, count))
        figures = figures_of(_plain(off_mm), _plain(off_mm + noise), count, noise="assumed")
        return HeightResult(off_mm - off_mm.mean(), figures, count)


def _plain(off_mm: Array) -> dict[str, Array]:
    """The figures (...,) of heights (..., n) mm, measured less nominal."""
    return {"height_rms_mm": off_mm.std(axis=-1), "height_band_mm": np.ptp(off_mm, axis=-1)}


PART = HeightEvaluation

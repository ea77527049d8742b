"""Height test: a height gauge on a table next to the arm touches the tool at each stop of the robot.

The measured height less the height by the nominal arm is the height of the arm's base above the table, equal in all
postures. The deviation from its mean is the vertical error of the arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from analysis.procedures.shared.lap_curve import SEED
from analysis.procedures.shared.quantity import Quantity, figures_of
from analysis.procedures.shared.result_curves import PoseCurve
from analysis.procedures.shared.test_kind import Instruments, Labels, TestKind, check_numbers
from analysis.robot.kinematics.arm import Array, arm_of, forward
from analysis.runs.noise.spectrum import DRAWS
from analysis.runs.tables import Table
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import TestName

_U_MM = 0.02
"""Standard uncertainty of a reading: maximum permissible error of 0.035 mm of a good height gauge, over √3."""
_FEWEST = 4


@dataclass(frozen=True)
class HeightTable(Table):
    """Heights of the tool: q (n, axes) rad; height_mm (n,) above the table."""

    test: ClassVar[TestName] = "height"
    q: Array
    height_mm: Array

    @property
    def readings(self) -> Array:
        """Heights (n, 1) mm."""
        return self.height_mm[:, None]


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


class Height(TestKind[HeightTable]):
    """Heights of the tool in postures of the robot."""

    test = "height"
    table = HeightTable
    fields = ("q", "height_mm")
    labels = Labels(unsupported_reason="is a table of heights, which a diagnosis does not use")

    def evaluate(self, table: HeightTable, rig: Rig, where: str, instruments: Instruments) -> HeightResult:
        """The figures by the nominal arm: height_rms_mm, and height_band_mm, the largest less the smallest."""
        check_numbers(where, q=table.q, height_mm=table.height_mm)
        count = len(table.q)
        if count < _FEWEST:
            problem = f"has {count} heights, too few to judge an arm"
            raise FileError(where, problem, f"give at least {_FEWEST}", code="height.few")
        off_mm = table.height_mm - forward(arm_of(rig.robot), table.q)[:, 2, 3]
        noise = np.random.default_rng(SEED).normal(0.0, _U_MM, (DRAWS, count))
        figures = figures_of(_plain(off_mm), _plain(off_mm + noise), count, noise="assumed")
        return HeightResult(off_mm - off_mm.mean(), figures, count)


def _plain(off_mm: Array) -> dict[str, Array]:
    """The figures (...,) of heights (..., n) mm, measured less nominal."""
    return {"height_rms_mm": off_mm.std(axis=-1), "height_band_mm": np.ptp(off_mm, axis=-1)}

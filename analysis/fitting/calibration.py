"""The result of a calibration: fitted effects, what identified them, and residuals before and after."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa

from analysis.fitting.estimate import Fit
from analysis.fitting.fitted_effects import Fitted, fitted_effects
from analysis.fitting.identifiability import WeakParameter, parameter_label
from analysis.fitting.joint_coverage import JointRange
from analysis.fitting.run_noise import Repeats
from analysis.fitting.uncertainty import RunScatter
from analysis.fitting.weighting import Weighting
from analysis.frames import Tabular, for_json, table_of_rows
from analysis.kinematics.arm import Array
from analysis.measures.parameters import quantity_of
from analysis.model.predict import Model
from rigs.rig import Rig


@dataclass(frozen=True)
class SetUpNoise:
    """The noise of a set-up: `sd_mm` is the standard deviation that weights a reading, `repeats` the scatter of visits
    of one place, None where there are none."""

    sd_mm: float
    repeats: Repeats | None


@dataclass(frozen=True)
class Calibration(Tabular):
    """The result of a calibration.

    `known` is the initial model. `covariance` (p, p) of the fitted parameters is in their own units and includes the
    scatter between runs. `weighting` has the noise and wild readings of each observation and the levels of all
    requested parameters; `noise` is listed by set-up. `gauges` states whether any run has gauges.
    `identified_combinations` counts the combinations of parameters that the readings determine, and `weak_parameters`
    lists parameters that they do not determine by themselves. `covered` has the range of each joint in the readings
    used. `before_mm` and `after_mm` are the rms on the sound readings used and on those held out (NaN where there are
    none).
    """

    known: Model
    before: Fit
    after: Fit
    covariance: Array
    scatter: RunScatter
    weighting: Weighting
    noise: dict[str, SetUpNoise]
    gauges: bool
    identified_combinations: int
    weak_parameters: list[WeakParameter]
    covered: tuple[JointRange, ...]
    doubts: tuple[str, ...]
    before_mm: tuple[float, float]
    after_mm: tuple[float, float]

    @cached_property
    def effects(self) -> tuple[Fitted, ...]:
        """The fitted effects with the standard uncertainties of their parameters."""
        return fitted_effects(self)

    @property
    def extended_rig(self) -> Rig:
        """The rig begun with, the fitted effects added."""
        effects = (*self.known.effects, *(one.effect for one in self.effects))
        return self.known.rig.model_copy(update={"effects": effects})

    def to_table(self) -> pa.Table:
        """The fitted parameters, a row each: effect, value, u (standard uncertainty), unit."""
        rows = [
            {"effect": parameter_label(one.effect, field), **asdict(quantity_of(one.effect, field, one.sd))}
            for one in self.effects
            for field in one.sd
        ]
        return table_of_rows(("effect", "value", "u", "unit"), rows)

    def to_dict(self) -> dict[str, Any]:
        """All of it in plain types, lengths in mm, angles in degrees: what `rig calibrate --json` prints."""
        rms_mm = [{"before": one, "after": other} for one, other in zip(self.before_mm, self.after_mm, strict=True)]
        plain: dict[str, Any] = for_json(
            {
                "effects": [
                    {**one.effect.model_dump(mode="json", exclude={"found"}), "sd": one.sd} for one in self.effects
                ],
                "covariance": self.covariance,
                "scatter": asdict(self.scatter),
                "noise": {setup: asdict(noise) for setup, noise in self.noise.items()},
                "told_apart": {"asked": len(self.weighting.spread), "told": self.identified_combinations},
                "mixed": [{"what": one.what, "like": one.like, "share": one.share} for one in self.weak_parameters],
                "joints_deg": self.covered,
                "doubts": self.doubts,
                "rms_mm": {"used": rms_mm[0], "left_out": None if np.isnan(self.before_mm[1]) else rms_mm[1]},
            }
        )
        return plain

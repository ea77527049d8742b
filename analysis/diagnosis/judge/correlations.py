"""Correlations of the fitted sizes, which show combinations that the runs do not separate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from rigs.calibration import TIMES, CalibratedModel
from rigs.effects import Effect
from rigs.schema.effect import name_of

_DIGITS = 3
"""Decimals of a correlation. Chosen: pairs below are separated by any use of the model."""


@dataclass(frozen=True)
class Correlation:
    """Correlation coefficient of the sizes of two fitted effects."""

    first: Effect
    second: Effect
    value: float

    def to_dict(self) -> dict[str, Any]:
        return {"first": name_of(self.first), "second": name_of(self.second), "value": self.value}


def correlations_of(calibrated: CalibratedModel, effects: Sequence[Effect]) -> tuple[Correlation, ...]:
    """Correlations of pairs of effects, the strongest first; of two parameters of an effect, the stronger one. Pairs
    without a correlation in three decimals are left out.
    """
    kept = [
        (row, calibrated.terms[parameter.term].effect)
        for row, parameter in enumerate(calibrated.parameters)
        if parameter.field != TIMES and calibrated.terms[parameter.term].effect in effects
    ]
    root = calibrated.root[[row for row, _ in kept]]
    unit = root / np.maximum(np.linalg.norm(root, axis=1, keepdims=True), np.finfo(float).tiny)
    values, strongest = unit @ unit.T, dict[tuple[int, int], float]()
    for (k, (_, first)), (n, (_, second)) in combinations(enumerate(kept), 2):
        pair = effects.index(first), effects.index(second)
        if first != second and abs(values[k, n]) > abs(strongest.get(pair, 0.0)):
            strongest[pair] = round(float(values[k, n]), _DIGITS)
    ordered = sorted(strongest.items(), key=lambda one: (-abs(one[1]), one[0]))
    return tuple(Correlation(effects[first], effects[second], value) for (first, second), value in ordered if value)

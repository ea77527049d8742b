"""Probability of a named effect from its log odds: one calibrated function.

The likelihood of a fit is too sure, because its model of noise and arms is never exact. How often names with given log
odds are right is therefore measured on trial cells (docs/evidence/reliability.md):

p = 1 / (1 + exp(-(intercept + slope · log odds)))
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from analysis.diagnosis.judge.alternatives import Alternative, Hypotheses

CALIBRATION = Path(__file__).with_name("calibration.json")
"""The two numbers of the function, with their origin. `scripts/dev stated_odds` fits them again."""
CONFIRMED = 0.95
"""Probability above which an effect is confirmed."""


@dataclass(frozen=True)
class Probabilities:
    """Probabilities of a named effect and of its alternatives, which sum to 1."""

    name: float
    alternatives: Mapping[Alternative, float]

    @property
    def strongest(self) -> Alternative:
        return max(self.alternatives, key=lambda alternative: self.alternatives[alternative])

    @property
    def with_rivals(self) -> float:
        return self.name + self.alternatives["rival"]


def probabilities_of(hypotheses: Hypotheses) -> Probabilities:
    name = probability_of(hypotheses.log_odds())
    rival = probability_of(hypotheses.log_odds(with_rivals=True)) - name
    others = {key: value for key, value in hypotheses.log_evidence.items() if key != "rival"}
    weight = np.exp(np.array([*others.values()]) - max(others.values()))
    shares = (1 - name - rival) * weight / weight.sum()
    return Probabilities(name, {"rival": rival, **dict(zip(others, shares.tolist(), strict=True))})


def probability_of(log_odds: float) -> float:
    intercept, slope = _calibration()
    return float(1 / (1 + np.exp(-np.clip(intercept + slope * log_odds, -700, 700))))


@cache
def _calibration() -> tuple[float, float]:
    calibration = json.loads(CALIBRATION.read_text(encoding="utf-8"))
    return calibration["intercept"], calibration["slope"]

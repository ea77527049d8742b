"""Cached responses of effects: reused for similar effects only."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.fit.responses import NearResponses
from rigs.effects import Backlash, Effect, TransmissionError
from tests.support.diagnosis_cells import Array

GEAR = TransmissionError(axis=4, order=20, amplitude_deg=0.02, phase_deg=179)
STEPS = {"amplitude_deg": 4e-4, "phase_deg": 1.0, "third": 0.002}


def _computed(first: Effect, then: Effect, steps: dict[str, float] = STEPS, kind: str = "slopes") -> int:
    """How often something is computed when two effects follow each other."""
    times: list[int] = []

    def compute() -> Array:
        times.append(1)
        return np.zeros((3, 2))

    near = NearResponses()
    near.of("slopes", first, steps, compute)
    near.of(kind, then, steps, compute)
    return len(times)


@pytest.mark.parametrize("change", [{}, {"amplitude_deg": 0.0203}, {"phase_deg": -180.5}, {"third": 0.001}])
def test_a_near_effect_has_the_same_response(change: dict[str, float]) -> None:
    assert _computed(GEAR, GEAR.model_copy(update=change)) == 1


@pytest.mark.parametrize(
    "change",
    [{"amplitude_deg": 0.021}, {"phase_deg": 177.0}, {"phase_deg": -178.0}, {"order": 20.001}, {"axis": 5}],
)
def test_another_effect_has_a_response_of_its_own(change: dict[str, float]) -> None:
    assert _computed(GEAR, GEAR.model_copy(update=change)) == 2


def test_each_kind_is_kept_for_itself() -> None:
    assert _computed(GEAR, GEAR, kind="departures") == 2


def test_a_name_keeps_the_latest_few() -> None:
    near, plays = NearResponses(), [Backlash(axis=1, width_deg=0.01 * k) for k in range(1, 8)]
    first = [near.of("slopes", play, {}, lambda: np.zeros((3, 1))) for play in plays]
    again = [near.of("slopes", play, {}, lambda: np.zeros((3, 1))) for play in reversed(plays)]
    kept = [one is other for one, other in zip(first, reversed(again), strict=True)]
    assert kept[-1] and not kept[0]

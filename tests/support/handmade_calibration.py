"""Handmade calibrated models, and rig files that refer to them."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis.correction.model_files import write_extended
from rigs.calibration import (
    TIMES,
    CalibratedModel,
    CalibratedRun,
    CovarianceParameter,
    PlacedSetUp,
    Term,
    packed_factor,
)
from rigs.effects import Backlash, Effect, JointOffset, LinkGeometry, TransmissionError
from rigs.load import load

NAMED = Backlash(axis=1, width_deg=0.02, transit=0.3)
SMALL: tuple[tuple[Effect, float], ...] = (
    (JointOffset(axis=3, offset_deg=0.02), -0.4),
    (LinkGeometry(axis=3, field="a", delta=0.2), 0.7),
    (TransmissionError(axis=2, order=2, amplitude_deg=0.005, phase_deg=90), 0.9),
    (Backlash(axis=4, width_deg=0.01, transit=1.0), -0.3),
)
"""Small terms: effects, each with its multiple for the arm."""


def calibrated_model(small: Sequence[tuple[Effect, float]] = SMALL, **changed: Any) -> CalibratedModel:
    """A calibrated model with a named backlash and small terms that are individually not certain."""
    terms = (Term(effect=NAMED, times=1.0, named=True), *(Term(effect=one, times=times) for one, times in small))
    parameters = [CovarianceParameter(term=0, field="width_deg")]
    parameters += [CovarianceParameter(term=k, field=TIMES) for k in range(1, len(terms))]
    root = np.tril(np.random.default_rng(5).normal(0.0, 0.5, (len(parameters), len(parameters))))
    made = CalibratedModel(
        rig="paper-fanuc",
        date=dt.date(2026, 11, 20),
        version="0.39.0",
        runs=(CalibratedRun(name="yaw-cw-1", sha256="0" * 64),),
        joints_deg=((-30.0, 30.0),) * 6,
        setups={"yaw": PlacedSetUp(ball_mm=(930.0, -88.0, 273.0), zeros_mm=(0.01, -0.02))},
        before_um=61.2,
        calibrated_um=1.9,
        held_out_um=2.1,
        terms=terms,
        parameters=tuple(parameters),
        factor=packed_factor(root),
    )
    return made.model_copy(update=changed)


def written(directory: Path, model: CalibratedModel | None = None, name: str = "cell") -> tuple[Path, Path]:
    """Write a rig file and its calibration, as a diagnosis does."""
    directory.mkdir(parents=True, exist_ok=True)
    beside, rig_file = write_extended(
        load("paper-fanuc")[1], (NAMED,), directory / f"{name}.yaml", model or calibrated_model()
    )
    return rig_file, beside

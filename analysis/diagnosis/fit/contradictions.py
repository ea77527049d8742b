"""Stated constants that the readings contradict: known distances of sockets.

A distance is compared with the readings before it takes part in the fit: first with the prediction of a healthy arm,
then, if the two differ, with that of the arm found without the distance. A single wrong length or zero changes the
shape of the touches and is found without it. A common scale of all lengths is not; the uncertainty of the prediction
contains that of a healthy arm.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.diagnosis.evidence.gather import Evidence
from analysis.diagnosis.evidence.known_distances import known_distances_of
from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.fit.search import SearchResult, fit_given, search
from analysis.procedures.shared.quantity import Quantity
from rigs.effects import Effect, changed, healthy_size
from rigs.schema.declared_tests import KnownSocketDistance

_SIGMA = 5.0
"""Difference of a stated distance from the prediction, in standard uncertainties, from which it is contradicted.
Chosen: chance exceeds it once in a million diagnoses.
"""


@dataclass(frozen=True)
class Contradiction:
    """A constant of the rig file, with the parts it belongs to, and its value according to the readings."""

    key: str
    names: tuple[str, ...]
    stated: Quantity
    by_readings: Quantity

    @property
    def difference(self) -> float:
        return self.by_readings.value - self.stated.value

    @property
    def sigma(self) -> float:
        return abs(self.difference) / float(np.hypot(self.by_readings.u, self.stated.u))

    def to_dict(self) -> dict[str, Any]:
        return {
            "key": self.key, "names": self.names, "unit": self.stated.unit, "sigma": self.sigma,
            "stated": {"value": self.stated.value, "u": self.stated.u},
            "by_readings": {"value": self.by_readings.value, "u": self.by_readings.u},
        }  # fmt: skip


def without_contradicted(
    evidence: Evidence, effects: Sequence[Effect] | None, progress: Callable[[str], None]
) -> tuple[Evidence, tuple[Contradiction, ...]]:
    """Remove the known distances that the readings contradict from the evidence, and return them. `effects`: those to
    be fitted; None if they are searched for.
    """
    if not any(run.model.rig.tests.distances for run in evidence.runs):
        return evidence, ()
    suspects = _contradictions(evidence.runs, fit_given(_without(evidence.runs), (), progress))
    if not suspects:
        return evidence, ()
    runs = _without(evidence.runs, suspects)
    result = search(runs, progress) if effects is None else fit_given(runs, effects, progress)
    certain = {key: made for key, made in _contradictions(evidence.runs, result).items() if key in suspects}
    if not certain:
        return evidence, ()
    runs, judges, elsewhere = (_without(use, certain) for use in (evidence.runs, evidence.judges, evidence.elsewhere))
    return replace(evidence, runs=runs, judges=judges, elsewhere=elsewhere), tuple(certain.values())


def _contradictions(runs: Sequence[ObservedRun], result: SearchResult) -> dict[KnownSocketDistance, Contradiction]:
    """Known distances that differ from those of a fit without them, with the most certain placement of each."""
    linear, posterior, place = result.linear, result.posterior, result.columns.set_ups
    columns, known = np.arange(place.start, place.stop), known_distances_of(runs)
    slopes = known.by_setup(linear.setups, linear.terms, len(columns))
    moves, covariance = posterior.mean[columns], posterior.covariance_among(columns)
    distances_mm, u_mm = known.fitted_mm(linear.setups, slopes, moves, covariance)
    # Touches do not determine a common scale of all lengths: its relative uncertainty is that of the longest link.
    rig, length = linear.blocks[0].model.rig, changed(1, "a_mm", 0.0)
    longest_mm = max(max(abs(axis.a_mm), abs(axis.d_mm)) for axis in rig.robot.axes)
    u_mm = np.hypot(u_mm, healthy_size(length) * length.usual_times(rig.reference) / longest_mm * distances_mm)
    contradictions: dict[KnownSocketDistance, Contradiction] = {}
    for distance, value, u in zip(known.distances, distances_mm.tolist(), u_mm.tolist(), strict=True):
        stated = Quantity(distance.distance_mm, distance.u_mm, "mm")
        made = Contradiction("tests.touch.distances", distance.between, stated, Quantity(value, u, "mm"))
        least_u = contradictions[distance].by_readings.u if distance in contradictions else np.inf
        if made.sigma > _SIGMA and u < least_u:
            contradictions[distance] = made
    return contradictions


def _without(runs: Sequence[ObservedRun], left_out: Container[KnownSocketDistance] | None = None) -> list[ObservedRun]:
    """Runs without the known distances `left_out`; without any if None."""
    kept = []
    for run in runs:
        every = () if left_out is None else run.model.rig.tests.distances
        rig = run.model.rig.with_distances(distance for distance in every if distance not in (left_out or ()))
        kept.append(replace(run, model=replace(run.model, rig=rig)))
    return kept

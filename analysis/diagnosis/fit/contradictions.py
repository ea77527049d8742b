"""Stated constants that the readings contradict: known distances of sockets.

A wrong distance leaves a residual that no error of the arm explains, or forces large errors into the model. A distance
is therefore compared with the readings before it takes part in the fit: first with the prediction of a healthy arm,
then, if the two differ, with the prediction of the arm found without that distance. A single wrong length or zero
changes the shape of the touches and is found without the distance. Only a common scale of all lengths is not, and the
uncertainty of the prediction contains the scale of a healthy arm.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.diagnosis.evidence.gather import Evidence
from analysis.diagnosis.evidence.known_distances import KnownDistances, known_distances_of
from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.fit.search import SearchResult, fit_given, search
from analysis.procedures.shared.quantity import Quantity
from rigs.effects import Effect, changed, healthy_size
from rigs.rig import Rig
from rigs.schema.declared_tests import KnownSocketDistance

_SIGMA = 5.0
"""Difference of a stated distance from the prediction, in standard uncertainties, from which it is contradicted.
Chosen: chance exceeds it once in a million diagnoses, and an error of the scale is then a fault of the longest link.
"""


@dataclass(frozen=True)
class Contradiction:
    """A constant of the rig file, named by its key and the parts it belongs to, and the same according to the readings.

    The fit does not use it.
    """

    key: str
    names: tuple[str, ...]
    stated: Quantity
    by_readings: Quantity

    @property
    def difference(self) -> float:
        """The value according to the readings minus the stated value."""
        return self.by_readings.value - self.stated.value

    @property
    def sigma(self) -> float:
        """The difference in standard uncertainties."""
        return abs(self.difference) / float(np.hypot(self.by_readings.u, self.stated.u))

    def to_dict(self) -> dict[str, Any]:
        """Return plain types for JSON."""
        return {
            "key": self.key, "names": self.names, "unit": self.stated.unit, "sigma": self.sigma,
            "stated": {"value": self.stated.value, "u": self.stated.u},
            "by_readings": {"value": self.by_readings.value, "u": self.by_readings.u},
        }  # fmt: skip


def without_contradicted(
    evidence: Evidence, effects: Sequence[Effect] | None, progress: Callable[[str], None]
) -> tuple[Evidence, tuple[Contradiction, ...]]:
    """Return the evidence without the known distances that the readings (m, k) mm contradict, and those distances.

    `effects`: those to be fitted; None if they are searched for.
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
    """Return the known distances of runs that differ from those of a fit without them, with the most certain
    placement of each.
    """
    distances = known_distances_of(runs)
    contradictions: dict[KnownSocketDistance, Contradiction] = {}
    for distance, measured in zip(distances.distances, _fitted_distances(distances, result), strict=True):
        stated = Quantity(distance.distance_mm, distance.u_mm, "mm")
        made = Contradiction("tests.touch.distances", distance.between, stated, measured)
        least_u = contradictions[distance].by_readings.u if distance in contradictions else np.inf
        if made.sigma > _SIGMA and measured.u < least_u:
            contradictions[distance] = made
    return contradictions


def _fitted_distances(distances: KnownDistances, result: SearchResult) -> list[Quantity]:
    """Return the distances (t) of the sockets according to a fit, in mm, each with the uncertainty of the scale."""
    linear, posterior, place = result.linear, result.posterior, result.columns.set_ups
    columns = np.arange(place.start, place.stop)
    slopes = distances.by_setup(linear.setups, linear.terms, len(columns))
    moves, covariance = posterior.mean[columns], posterior.covariance_among(columns)
    distances_mm, u_mm = distances.fitted_mm(linear.setups, slopes, moves, covariance)
    # Touches do not determine a common scale of all lengths: its relative uncertainty is that of the longest link.
    rig, length = linear.blocks[0].model.rig, changed(1, "a_mm", 0.0)
    longest_mm = max(max(abs(axis.a_mm), abs(axis.d_mm)) for axis in rig.robot.axes)
    u_mm = np.hypot(u_mm, healthy_size(length) * length.usual_times(rig.reference) / longest_mm * distances_mm)
    return [Quantity(float(value), float(u), "mm") for value, u in zip(distances_mm, u_mm, strict=True)]


def _without(runs: Sequence[ObservedRun], left_out: Container[KnownSocketDistance] | None = None) -> list[ObservedRun]:
    """Return runs without the known distances `left_out`; without any if None."""

    def rig_without(rig: Rig) -> Rig:
        return rig.with_distances(
            distance for distance in rig.tests.distances if left_out is not None and distance not in left_out
        )

    return [replace(run, model=replace(run.model, rig=rig_without(run.model.rig))) for run in runs]

"""Stated constants that the readings contradict: known distances of sockets.

A wrong distance leaves a residual that no error of the arm explains, or forces large errors into the model. A distance
is therefore compared with the readings before it takes part in the fit: first with the prediction of a healthy arm,
then, if the two differ, with the prediction of the arm found without that distance. A single wrong length or zero
changes the shape of the touches and is found without the distance. Only a common scale of all lengths is not, and the
uncertainty of the prediction contains the scale of a healthy arm.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.contradiction import Contradiction
from analysis.diagnosis.evidence.gather import Evidence
from analysis.diagnosis.evidence.known_distances import KnownDistances, known_distances_of
from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.fit.search import SearchResult, fit_given, search
from analysis.procedures.shared.quantity import Quantity
from rigs.effects import Effect, changed, healthy_size
from rigs.rig import Rig
from rigs.schema.declared_tests import KnownSocketDistance
from rigs.schema.robot import Robot

_SIGMA = 5.0
"""Difference of a stated distance from the prediction, in standard uncertainties, from which it is contradicted.
Chosen: chance exceeds it once in a million diagnoses, and an error of the scale is then a fault of the longest link.
"""


def without_contradicted(
    evidence: Evidence, given: Sequence[Effect] | None, progress: Callable[[str], None]
) -> tuple[Evidence, tuple[Contradiction, ...]]:
    """Return the evidence without the known distances that the readings (m, k) mm contradict, and those distances.

    `given`: effects to be fitted; None if they are searched for.
    """
    if not any(run.model.rig.tests.touch and run.model.rig.tests.touch.distances for run in evidence.runs):
        return evidence, ()
    suspects = _contradictions(evidence.runs, fit_given(_without(evidence.runs), (), progress))
    if not suspects:
        return evidence, ()
    runs = _without(evidence.runs, suspects)
    result = search(runs, progress) if given is None else fit_given(runs, given, progress)
    found = {key: made for key, made in _contradictions(evidence.runs, result).items() if key in suspects}
    if not found:
        return evidence, ()
    runs, judges, elsewhere = (_without(use, found) for use in (evidence.runs, evidence.judges, evidence.elsewhere))
    return replace(evidence, runs=runs, judges=judges, elsewhere=elsewhere), tuple(found.values())


def _contradictions(runs: Sequence[ObservedRun], result: SearchResult) -> dict[KnownSocketDistance, Contradiction]:
    """Return the known distances of runs that differ from those of a fit without them, with the most certain
    placement of each.
    """
    known = known_distances_of(runs)
    found: dict[KnownSocketDistance, Contradiction] = {}
    for distance, measured in zip(known.distances, _fitted_distances(known, result), strict=True):
        stated = Quantity(distance.distance_mm, distance.u_mm, "mm")
        made = Contradiction("tests.touch.distances", distance.between, stated, measured)
        if made.sigma > _SIGMA and (distance not in found or measured.u < found[distance].by_readings.u):
            found[distance] = made
    return found


def _fitted_distances(known: KnownDistances, result: SearchResult) -> list[Quantity]:
    """Return the distances (t) of the sockets according to a fit, in mm, each with the uncertainty of the scale."""
    linear, posterior, place = result.linear, result.posterior, result.columns.set_ups
    columns = np.arange(place.start, place.stop)
    slopes = known.by_setup(linear.setups, linear.terms, len(columns))
    moves, covariance = posterior.mean[columns], posterior.covariance_among(columns)
    distances_mm, u_mm = known.fitted_mm(linear.setups, slopes, moves, covariance)
    u_mm = np.hypot(u_mm, _scale_u(linear.blocks[0].model.rig.robot) * distances_mm)
    return [Quantity(float(value), float(u), "mm") for value, u in zip(distances_mm, u_mm, strict=True)]


def _scale_u(robot: Robot) -> float:
    """Return the relative standard uncertainty of a common scale of all lengths, which touches do not determine: that
    of the longest link.
    """
    length = changed(1, "a_mm", 0.0)
    usual_mm = healthy_size(length) * length.usual_times(robot.design)
    return usual_mm / max(max(abs(axis.a_mm), abs(axis.d_mm)) for axis in robot.axes)


def _without(runs: Sequence[ObservedRun], left_out: Container[KnownSocketDistance] | None = None) -> list[ObservedRun]:
    """Return runs without the known distances `left_out`; without any if None."""
    return [replace(run, model=replace(run.model, rig=_rig_without(run.model.rig, left_out))) for run in runs]


def _rig_without(rig: Rig, left_out: Container[KnownSocketDistance] | None) -> Rig:
    touch = rig.tests.touch
    if touch is None:
        return rig
    kept = tuple(distance for distance in touch.distances if left_out is not None and distance not in left_out)
    tests = rig.tests.model_copy(update={"touch": touch.model_copy(update={"distances": kept})})
    return rig.model_copy(update={"tests": tests})

"""Known socket distances as additional readings, each connecting the set-ups of two sockets.

Touches of a single ball cannot show a common scale of all arm lengths, because the socket positions scale with them. A
known distance shows it, with the scatter of two seated balls and an error common to all placements.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.procedures.shared.test_kind import kind_of
from analysis.robot.kinematics.arm import Array
from analysis.robot.predict import SetUps
from analysis.runs.noise.cell_noise import SEAT_MM
from rigs.schema.declared_tests import KnownSocketDistance

_SD_MM = float(np.sqrt(2.0)) * SEAT_MM
"""Standard deviation of the distance between two seated balls."""


@dataclass(frozen=True)
class KnownDistances:
    """Known distances between the sockets of touches: `pairs` (t) of set-up names, and `distances` (t)."""

    pairs: tuple[tuple[str, str], ...]
    distances: tuple[KnownSocketDistance, ...]

    def residual(self, setups: SetUps) -> Array:
        """Known distances minus those of set-ups (t,), in standard deviations of their scatter."""
        apart = [float(np.linalg.norm(_socket_vector(setups, pair))) for pair in self.pairs]
        stated_mm = [distance.distance_mm for distance in self.distances]
        return np.asarray((np.array(stated_mm) - np.array(apart)) / _SD_MM, dtype=float)

    def by_setup(self, setups: SetUps, terms: Mapping[str, Sequence[int]], count: int) -> Array:
        """Change (t, count) of the distances per mm of each set-up term, in the same unit. `terms`: of each set-up,
        with those of the socket first.
        """
        slopes = np.zeros((len(self.pairs), count))
        for row, pair in zip(slopes, self.pairs, strict=True):
            away = _socket_vector(setups, pair)
            along = away / np.linalg.norm(away) / _SD_MM
            row[terms[pair[0]][:3]] -= along
            row[terms[pair[1]][:3]] += along
        return slopes

    def fitted_mm(self, setups: SetUps, slopes: Array, moves: Array, covariance: Array) -> tuple[Array, Array]:
        """Distances (t,) mm between the sockets of set-ups moved by terms (s,), and their standard uncertainties
        (t,).
        """
        apart = np.array([np.linalg.norm(_socket_vector(setups, pair)) for pair in self.pairs])
        variance = np.sum(slopes @ covariance * slopes, axis=1)
        return apart + _SD_MM * slopes @ moves, np.hypot(_SD_MM * np.sqrt(variance), _SD_MM)

    @property
    def scatter(self) -> Array:
        """Response (t, c) to a standard uncertainty of each distance of the rig file."""
        different = list(dict.fromkeys(self.distances))
        alike = np.array([[distance == other for other in different] for distance in self.distances], dtype=float)
        return alike.reshape(len(self.distances), len(different)) * [distance.u_mm / _SD_MM for distance in different]


def known_distances_of(runs: Sequence[ObservedRun]) -> KnownDistances:
    """Known distances between sockets touched in the same run, once for repeated runs of the same set-ups."""
    distances: dict[tuple[str, str], KnownSocketDistance] = {}
    touched = [run for run in runs if kind_of(run.table.test).parts(run.table) is not None]
    for first, second in combinations(touched, 2):
        touch = first.model.rig.tests.touch
        if touch is None or first.table is not second.table:
            continue
        between = {_socket(first), _socket(second)}
        for distance in touch.distances:
            if set(distance.between) == between:
                distances[first.setup, second.setup] = distance
    return KnownDistances(tuple(distances), tuple(distances.values()))


def _socket(run: ObservedRun) -> str:
    sockets = kind_of(run.table.test).parts(run.table)
    return "" if sockets is None else str(sockets[run.rows[0]])


def _socket_vector(setups: SetUps, pair: tuple[str, str]) -> Array:
    first, second = (setups[name].T_instrument_world[:3, 3] for name in pair)
    return second - first

"""Direct implementation of ISO 9283:1998 and ISO 230-4: loops over the formulas of the standard, and the cube for an
independently computed arm. Nothing here is imported from rig.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from tests.worlds.arms.independent_arm import Array


def barycentre(points: Array) -> Array:
    return np.array([sum(column) / len(points) for column in points.T])


def repeatability(points: Array) -> float:
    """Return RP (7.2.2) of attained points, or RT (8.3) at a station: mean + 3 S of the distances from the
    barycentre.
    """
    middle = barycentre(points)
    distances = [sqrt(sum((point - middle) ** 2)) for point in points]
    mean = sum(distances) / len(distances)
    s = sqrt(sum((one - mean) ** 2 for one in distances) / (len(distances) - 1))
    return mean + 3 * s


def accuracy(points: Array, command: Array) -> float:
    """Return AP (7.2.1): the distance from the command to the barycentre."""
    return sqrt(sum((barycentre(points) - command) ** 2))


def distance(ones: Array, others: Array, command_mm: float) -> tuple[float, float]:
    """Return AD and RD (7.3.2, 7.3.3) of two poses, cycle by cycle."""
    each = [sqrt(sum((one - other) ** 2)) for one, other in zip(ones, others, strict=True)]
    mean = sum(each) / len(each)
    return mean - command_mm, 3 * sqrt(sum((one - mean) ** 2 for one in each) / (len(each) - 1))


def cube_places(centre_mm: Array, side_mm: float) -> Array:
    """Return P1 … P5 on the plane that rises along x: 10 % of the diagonals inside the corners of the cube."""
    low, high = centre_mm - side_mm / 2, centre_mm + side_mm / 2
    corners = [(low[0], y, low[2]) for y in (low[1], high[1])] + [(high[0], y, high[2]) for y in (high[1], low[1])]
    ends = [np.array(corner) for corner in corners]
    opposite = [ends[2], ends[3], ends[0], ends[1]]
    return np.array([centre_mm, *(one + 0.1 * (other - one) for one, other in zip(ends, opposite, strict=True))])


class Recorder:
    """A tracker that samples time and position at a rate while the tool moves or rests."""

    def __init__(self, rate_hz: float, speed_mm_s: float) -> None:
        self.step_s, self.speed = 1 / rate_hz, speed_mm_s
        self.parts: list[Array] = []

    def stand(self, at: Array, seconds: float) -> None:
        self.parts.append(np.tile(at, (round(seconds / self.step_s), 1)))

    def drive(self, way: Array) -> None:
        """Move along positions (k, 3) mm at constant speed."""
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
        at = np.arange(self.step_s * self.speed / 3, length[-1], self.step_s * self.speed)
        self.parts.append(np.stack([np.interp(at, length, column) for column in way.T], axis=1))

    def written(self) -> tuple[Array, Array]:
        places = np.concatenate(self.parts)
        return self.step_s * np.arange(len(places)), places

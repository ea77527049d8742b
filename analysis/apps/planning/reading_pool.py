"""Choice of the readings that inform most about targets.

Everything unknown about an arm and its set-ups is a vector of independent standard normal variables; readings and
targets are rows, their changes by each unknown. Readings are chosen one at a time, each with the largest reduction of
the variance of the targets per minute (V-optimal design; Atkinson, Donev and Tobias, Optimum Experimental Designs,
2007, ch. 10). D-optimal readings would determine the constants best, but none of a thousand terms is of interest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers


@dataclass(frozen=True)
class ReadingPool:
    readings: Array
    """Entries (r, e, k) of each reading in standard deviations of their noise; a row of zeros is no entry."""
    targets: Array
    """Figures of interest (t, k) in mm."""
    minutes: Array

    def after(self, entries: Array) -> ReadingPool:
        """Pool after other readings with these entries (g, k) were taken."""
        root = np.linalg.cholesky(np.eye(entries.shape[1]) + entries.T @ entries)
        rows = np.concatenate([self.readings.reshape(-1, self.readings.shape[2]), self.targets])
        rows, cut = np.linalg.solve(root, rows.T).T, len(rows) - len(self.targets)
        return replace(self, readings=rows[:cut].reshape(self.readings.shape), targets=rows[cut:])

    def gains(self) -> Array:
        """Reduction (r,) mm² of the summed variance of the targets by each reading alone."""
        return _gains(self.readings @ self.readings.transpose(0, 2, 1), self.readings @ self.targets.T)

    def choose(self, count: int, first: Sequence[int] = ()) -> Integers:
        """Indices (count,) of the readings to take, in order.

        first: readings that are taken already; they are the first of the result.
        """
        r, e, k = self.readings.shape
        rows = np.concatenate([self.readings.reshape(-1, k), self.targets])
        covariance, chosen, each = rows @ rows.T, list[int](), np.arange(r)
        for number in range(min(count, r)):
            if number < len(first):
                chosen.append(int(first[number]))
            else:
                own = covariance[: r * e, : r * e].reshape(r, e, r, e)[each, :, each]
                worth = _gains(own, covariance[: r * e, r * e :].reshape(r, e, -1)) / self.minutes
                worth[chosen] = -np.inf
                chosen.append(int(np.argmax(worth)))
            entries = slice(e * chosen[-1], e * chosen[-1] + e)
            across = covariance[:, entries]
            covariance -= across @ np.linalg.solve(across[entries] + np.eye(e), across.T)
        return np.array(chosen, dtype=np.int64)

    def u_mm(self, chosen: Integers) -> float:
        """Rms uncertainty of a position after the chosen readings, for targets of three coordinates each."""
        targets = self.after(self.readings[chosen].reshape(-1, self.readings.shape[2])).targets
        return float(np.sqrt(3 * (targets**2).sum() / len(targets)))


def _gains(own: Array, across: Array) -> Array:
    """Reduction (r,) of the summed variance of targets. own (r, e, e), across (r, e, t): covariances of readings."""
    solved = np.linalg.solve(own + np.eye(own.shape[1]), across @ across.transpose(0, 2, 1))
    return np.asarray(np.trace(solved, axis1=1, axis2=2))


def as_readings(rows: Sequence[Array]) -> Array:
    """Stack readings with different numbers of entries (e, k) as (r, e, k), padded with zeros."""
    width = max(map(len, rows))
    return np.stack([np.pad(entries, ((0, width - len(entries)), (0, 0))) for entries in rows])

"""The model of the readings of a hemisphere: sphere + tilt + error of the target + error of the orientation.

A tilt of the tool shifts all targets equally, as a wrong TCP does. The errors of targets and of single orientations are
the robot's, and their widths are estimated with everything else. The value of a cell (target, orientation) is then
drawn from its readings and from its neighbours in the model, which keeps ranges over noisy cells from being too large.
It is a `Level` of `analysis.noise.target_scatter`.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array

_LEAST_MM2 = 1e-12
"""Smallest variance of errors, (1 nm)², which avoids a division by zero."""


class SphereLevel:
    """For each of m chains: the tilt (m, o), the target error (m, t) without the sphere and the tilt, and the variances
    (m,) of both kinds of error."""

    @classmethod
    def at(cls, direction: Array, orientations: int) -> SphereLevel:
        """direction (t, 3): unit vectors to the targets; orientations: the number of orientations of each."""
        design = np.column_stack([direction, np.ones(len(direction))])
        basis, s, _ = np.linalg.svd(design, full_matrices=False)
        return cls(basis[:, s > 1e-6 * s[0]] * np.sqrt(len(direction)), orientations == 1)

    def __init__(self, basis: Array, alone: bool) -> None:
        """basis (t, c): the shapes of a sphere at the targets; alone: there is one orientation of each."""
        self._basis, self._alone = basis, alone
        self._begun = False
        self._tilt: Array
        self._target: Array
        self._target_mm2: Array
        self._orientation_mm2: Array

    def __call__(self, rng: np.random.Generator, weight: Array, mean: Array) -> tuple[Array, Array]:
        """Return expected values and draws (m, t, o) of the cells, from their weights and weighted means (m, t, o)."""
        if not self._begun:
            # Initialise from plain means, with the noise known so far subtracted.
            seen_cells = weight > 0
            self._target = (weight * mean).sum(axis=2) / weight.sum(axis=2)
            self._tilt = np.zeros((len(weight), weight.shape[2]))
            away = mean - self._target[..., None]
            self._orientation_mm2 = np.full(len(weight), _LEAST_MM2)
            if not self._alone:
                excess = (weight * away**2).sum(axis=(1, 2)) - (seen_cells.sum(axis=2) - 1).clip(min=0).sum(axis=1)
                self._orientation_mm2 = np.maximum(excess / weight.sum(axis=(1, 2)), _LEAST_MM2)
            off_sphere = self._target - self._target @ self._basis @ self._basis.T / len(self._basis)
            self._target_mm2 = np.maximum((off_sphere**2).mean(axis=1), _LEAST_MM2)
            self._begun = True
        across, along = self._orientation_mm2[:, None, None], self._target_mm2[:, None]
        precision = weight / (1 + weight * across)
        self._tilt_from(rng, precision, mean)
        level = mean - self._tilt[:, None, :]
        of_target = precision.sum(axis=2)
        seen = (precision * level).sum(axis=2) / np.maximum(of_target, 1e-300)
        sphere, moved = self._sphere(rng, of_target / (1 + of_target * along), seen)
        prior = 1 / along
        total = of_target + prior
        target = (of_target * seen + prior * sphere) / total
        shifted = prior * moved / total + rng.standard_normal(target.shape) / np.sqrt(total)
        prior = 1 / across
        total = weight + prior
        best = (weight * mean + prior * (target[..., None] + self._tilt[:, None, :])) / total
        cell = best + prior * shifted[..., None] / total + rng.standard_normal(best.shape) / np.sqrt(total)
        self._target = target + shifted
        residual = cell - self._target[..., None] - self._tilt[:, None, :]
        self._widths(rng, self._target - sphere - moved, residual * (weight > 0), weight)
        return best, cell

    def _tilt_from(self, rng: np.random.Generator, precision: Array, mean: Array) -> None:
        """Draw the tilt, which has mean zero over the orientations because their common part belongs to the targets."""
        if self._alone:
            return
        total = precision.sum(axis=1)
        best = (precision * (mean - self._target[..., None])).sum(axis=1) / total
        tilt = best + rng.standard_normal(best.shape) / np.sqrt(total)
        self._tilt = tilt - tilt.mean(axis=1, keepdims=True)

    def _sphere(self, rng: np.random.Generator, precision: Array, seen: Array) -> tuple[Array, Array]:
        """Return the sphere's distance (m, t) at the targets, and the difference of a draw of it."""
        size = self._basis.shape[1]
        pairs = (self._basis[:, :, None] * self._basis[:, None, :]).reshape(-1, size * size)
        normal = (precision @ pairs).reshape(-1, size, size)
        best = np.linalg.solve(normal, ((precision * seen) @ self._basis)[..., None])
        kick = np.linalg.cholesky(np.linalg.inv(normal)) @ rng.standard_normal(best.shape)
        return best[..., 0] @ self._basis.T, kick[..., 0] @ self._basis.T

    def _widths(self, rng: np.random.Generator, target: Array, orientation: Array, weight: Array) -> None:
        """Draw the variances from errors (m, t) and (m, t, o), with a uniform prior of the standard deviations."""
        count = target.shape[1]
        chi2 = rng.chisquare(max(count - 1, 1), len(target))
        self._target_mm2 = np.maximum((target**2).sum(axis=1) / chi2, _LEAST_MM2)
        if not self._alone:
            chi2 = rng.chisquare(max(int((weight[0] > 0).sum()) - 1, 1), len(target))
            self._orientation_mm2 = np.maximum((orientation**2).sum(axis=(1, 2)) / chi2, _LEAST_MM2)

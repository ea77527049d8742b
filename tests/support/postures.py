"""Joint angles for testing an arm: random, at and near every singularity, and at the joint limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tests.support.five_arms import ARMS, OPW, Array

RANDOM = 10_000
SINGULARITY_DISTANCES_RAD = np.array([0.0, 1e-15, 1e-13, 1e-11, 1e-9, 1e-7, 1e-5, 1e-3])
"""Distances from a singularity in rad."""


def random_angles(seed: int, n: int = RANDOM) -> Array:
    """Return random angles (n, 6) rad over the full turn of every axis."""
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (n, 6))


def at_limits(name: str) -> Array:
    """Return angles (n, 6) rad with each axis at a limit, slightly inside, or anywhere in between."""
    rng = np.random.default_rng(7)
    low, high = ARMS[name].limits.T
    share = rng.choice([0.0, 1e-12, 1e-6, 0.5, 1 - 1e-6, 1.0], (500, 6))
    share = np.where(share == 0.5, rng.uniform(size=(500, 6)), share)
    return np.asarray(low + share * (high - low))


def singular(name: str, n: int = 500) -> dict[str, Array]:
    """Return random angles (n, 6) rad moved to a singularity of the arm, or to SINGULARITY_DISTANCES_RAD from it."""
    return _ur_singular(n) if name == "ur10e" else _opw_singular(name, n)


def _opw_singular(name: str, n: int) -> dict[str, Array]:
    opw = OPW[name]
    upright = {what: random_angles(seed, n) for seed, what in enumerate(("wrist", "stretched", "folded", "shoulder"))}
    beside = np.resize(SINGULARITY_DISTANCES_RAD, n)
    half_turns = np.resize([0.0, np.pi], n)
    upright["wrist"][:, 4] = beside + half_turns
    straight = -np.arctan2(opw.a2, opw.c3)
    upright["stretched"][:, 2] = straight + beside
    upright["folded"][:, 2] = straight + np.pi + beside
    # Wrist centre on axis 1: a1 + Re[(c2 + forearm e^(i t3)) e^(i (t2 - 90°))] = 0, with the elbow nearly straight.
    upright["shoulder"][:, 2] = straight + upright["shoulder"][:, 2] / 2
    arm = opw.c2 + np.hypot(opw.a2, opw.c3) * np.exp(1j * (upright["shoulder"][:, 2] - straight))
    upright["shoulder"][:, 1] = np.arcsin(-opw.a1 / np.abs(arm)) - np.angle(arm) + beside
    return {what: opw.upright(angles) for what, angles in upright.items()}


def _ur_singular(n: int) -> dict[str, Array]:
    q = {what: random_angles(seed, n) for seed, what in enumerate(("wrist", "stretched", "folded", "shoulder"))}
    beside = np.resize(SINGULARITY_DISTANCES_RAD, n)
    q["wrist"][:, 4] = beside + np.resize([0.0, np.pi], n)
    q["stretched"][:, 2] = beside
    q["folded"][:, 2] = np.pi + beside
    arm = ARMS["ur10e"]
    turned = np.exp(1j * q["shoulder"][:, 2])
    reach = arm.a[2] + arm.a[3] * turned - 1j * arm.d[4] * turned * np.exp(1j * q["shoulder"][:, 3])
    q["shoulder"][:, 1] = np.pi / 2 - np.angle(reach) + beside
    return q


def everywhere(name: str) -> Array:
    """Angles (n, 6) rad of all functions above: random, at the limits and near singularities."""
    return np.concatenate([random_angles(11), at_limits(name), *singular(name).values()])


def rows(found: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Row of each solution of a stack found (n, k)."""
    return np.nonzero(found)[0]

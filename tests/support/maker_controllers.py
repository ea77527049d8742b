"""Emulated controllers of five makers, with an arm whose errors they do not know. Nothing here is imported from rig.

A controller converts encoder counts into joint angles with its own parameters, and joint angles into a pose with its
own model of the arm. It moves to a pose according to this model. The true tool position follows from the true arm at
the true joint angles. The kinematics are those of `independent_arm` (Craig) and, for Universal Robots, the classic
Denavit-Hartenberg product published by the maker.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
Forward = Callable[[Array], tuple[Array, Array]]
"""Function from joint angles (6,) rad to rotation (3, 3) and position (3,) in mm of the flange."""


@dataclass(frozen=True)
class Mastered:
    """A controller with mastering counts: an axis reads (count - zero) / per_deg in degrees, plus the angle at its
    zero.

    zero, per_deg (6,): counts, and counts per degree with the sign of the motor. at_zero (6,): angle at the zero in
    degrees, $MAMES of KUKA at the notch. true_zero (6,): count at which the arm really has this angle. shown (6, 6):
    displayed angles by the motors. FANUC displays motor 3 less motor 2 as J3.
    """

    model: Forward
    true: Forward
    zero: Array
    per_deg: Array
    at_zero: Array
    true_zero: Array
    true_at_zero: Array
    shown: Array = field(default_factory=lambda: np.eye(6))

    def reading_deg(self, counts: Array) -> Array:
        return self.shown @ ((counts - self.zero) / self.per_deg + self.at_zero)

    def counts_at(self, reading_deg: Array) -> Array:
        return (np.linalg.solve(self.shown, reading_deg) - self.at_zero) * self.per_deg + self.zero

    def stands(self, reading_deg: Array) -> tuple[Array, Array]:
        """True pose of the flange for joint readings in degrees."""
        link_deg = (self.counts_at(reading_deg) - self.true_zero) / self.per_deg + self.true_at_zero
        return self.true(np.radians(link_deg))

    def sent_to(self, R: Array, p: Array, near_deg: Array) -> tuple[Array, Array]:
        """True pose of the flange when the controller believes to have reached a pose."""
        return self.stands(np.degrees(solved(self.model, R, p, np.radians(near_deg))))


@dataclass(frozen=True)
class UniversalRobots:
    """A controller with absolute encoders that adds the deltas of calibration.conf to its constants.

    a, d in metres, alpha in rad, each (6,), nominal. delta (6,): deltas of the controller and of the real arm, by their
    names in the file.
    """

    a: Array
    alpha: Array
    d: Array
    delta: Mapping[str, Array]
    real: Mapping[str, Array]

    def flange(self, q: Array, delta: Mapping[str, Array]) -> tuple[Array, Array]:
        """Return rotation and position in mm by the classic product: about z, along z, along x, about x."""
        R, p = np.eye(3), np.zeros(3)
        for k in range(6):
            theta, alpha = q[k] + delta["delta_theta"][k], self.alpha[k] + delta["delta_alpha"][k]
            p = p + R[:, 2] * (self.d[k] + delta["delta_d"][k])
            R = R @ Rotation.from_euler("z", theta).as_matrix()
            p = p + R[:, 0] * (self.a[k] + delta["delta_a"][k])
            R = R @ Rotation.from_euler("x", alpha).as_matrix()
        return R, 1e3 * p

    def stands(self, reading_deg: Array) -> tuple[Array, Array]:
        return self.flange(np.radians(reading_deg), self.real)

    def sent_to(self, R: Array, p: Array, near_deg: Array) -> tuple[Array, Array]:
        q = solved(lambda angles: self.flange(angles, self.delta), R, p, np.radians(near_deg))
        return self.stands(np.degrees(q))

    def with_added(self, name: str, index: int, value: float) -> UniversalRobots:
        """Controller with a value added to an entry of calibration.conf; index from 1."""
        changed = self.delta[name].copy()
        changed[index - 1] += value
        return replace(self, delta={**self.delta, name: changed})


NO_DELTA: dict[str, Array] = {f"delta_{name}": np.zeros(6) for name in ("theta", "a", "d", "alpha")}


def solved(model: Forward, R: Array, p: Array, near: Array) -> Array:
    """Solve the joint angles (6,) rad for a pose in a model of the arm, starting from nearby angles."""

    def away(q: Array) -> Array:
        at_R, at_p = model(q)
        turn = Rotation.from_matrix(at_R.T @ R).as_rotvec()
        return np.concatenate([at_p - p, 500 * turn])

    return np.asarray(least_squares(away, near, xtol=1e-14, ftol=1e-14, gtol=1e-14).x)

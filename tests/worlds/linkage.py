"""Elbow arms whose motors, joints and displayed angles differ, with errors of the motors computed by the mechanics.

Nothing here is imported from rig, and no coupling matrix is used. In a serial arm motor 3 sits in the elbow and turns
the forearm relative to the upper arm. In a palletiser motor 3 sits at the shoulder and turns a crank, and a rod
parallel to the upper arm turns the forearm (four-bar linkage, solved as the intersection of two circles). A controller
displays the elbow relative to the upper arm, or the elevation of the forearm above the horizontal (FANUC).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
_CRANK_MM = 200.0
_KG = {"upper": 12.0, "forearm": 8.0, "payload": 5.0}
"""Masses in the middle of upper arm and forearm, and at the flange."""
_G = 9.80665
_WAVES = 8
_DEG = np.pi / 180


@dataclass(frozen=True)
class Shape:
    """Lengths of an elbow arm in mm by the data sheet, and the place of motor 3.

    shoulder: distance of axis 2 from axis 1. elbow: height of the forearm above axis 3. elevation: whether the
    controller displays J3 from the horizontal.
    """

    shoulder: float
    upper: float
    elbow: float
    forearm: float
    wrist: float
    drive: Literal["elbow", "crank"] = "elbow"
    elevation: bool = True


SHAPES = {
    "fanuc-lr-mate-200id": Shape(50, 330, 35, 335, 80),
    "fanuc-m-10ia": Shape(150, 600, 200, 640, 100),
    "fanuc-m-20ia": Shape(150, 790, 250, 835, 100),
    "yaskawa-gp7": Shape(40, 445, 40, 440, 80, elevation=False),
    "palletiser": Shape(150, 600, 200, 640, 100, drive="crank"),
}


@dataclass(frozen=True)
class MotorErrors:
    """Errors at the outputs of the gears of the six motors, in rad; soft in rad/Nm.

    zero: actual minus counted angle. play: width, the output lags behind the last move. wave: eight waves per turn of
    the output.
    """

    zero: Array
    play: Array
    wave: Array
    soft: Array

    def of(self, motors: Array, came_from: Array, torque: Callable[[Array], Array]) -> Array:
        """Errors (n, 6) of the outputs at counted angles (n, 6), after a move from other angles."""
        errors = self.zero - self.play / 2 * np.sign(motors - came_from)
        errors = errors + self.wave * np.sin(_WAVES * motors)
        return np.asarray(errors + self.soft * torque(motors) if self.soft.any() else errors)


@dataclass(frozen=True)
class LinkedArm:
    """An arm of exact shape with errors of its motors."""

    shape: Shape
    errors: MotorErrors
    tool_mm: Array

    def displayed(self, motors: Array) -> Array:
        """Displayed angles (n, 6) rad of a controller that takes its zeros for correct."""
        shown = motors.copy()
        if self.shape.elevation:
            shown[:, 2] = _elevation(self.shape, motors)
        return shown

    def tips(self, motors: Array, came_from: Array) -> Array:
        """Places (n, 3) mm of the ball for counted angles (n, 6) rad of the motors."""
        return self._points(motors + self.errors.of(motors, came_from, self._torque))[-1]

    def _torque(self, motors: Array) -> Array:
        """Torque (n, 6) Nm of gravity on each motor: the loss of potential energy per angle."""
        step = 1e-5 * np.eye(6)
        energy = [self._energy(motors + one) - self._energy(motors - one) for one in step]
        return -np.stack(energy, axis=1) / 2e-5

    def _energy(self, motors: Array) -> Array:
        upper, forearm, flange, _ = self._points(motors)
        heights = _KG["upper"] * upper + _KG["forearm"] * forearm + _KG["payload"] * flange
        return np.asarray(1e-3 * _G * heights[:, 2])

    def _points(self, motors: Array) -> tuple[Array, Array, Array, Array]:
        """Middle of upper arm and forearm, the flange and the ball (n, 3) mm at true motor angles."""
        s = self.shape
        # Angle of the elbow about y: the forearm is level if the upper arm leans by as much as the elbow opens.
        bend = -_elevation(s, motors) - motors[:, 1]
        turns = [("z", motors[:, 0]), ("y", motors[:, 1]), ("y", bend)]
        turns += [("x", -motors[:, 3]), ("y", -motors[:, 4]), ("x", -motors[:, 5])]
        ends = [[s.shoulder, 0, 0], [0, 0, s.upper], [s.forearm, 0, s.elbow], [0, 0, 0], [0, 0, 0], [s.wrist, 0, 0]]
        R, p, middles = Rotation.identity(), np.zeros((len(motors), 3)), []
        for k, ((axis, angle), end) in enumerate(zip(turns, ends, strict=True)):
            R = R * Rotation.from_rotvec(np.outer(angle, [axis == name for name in "xyz"]))
            half = [s.forearm / 2, 0, s.elbow] if k == 2 else np.array(end) / 2
            middles.append(p + R.apply(half))
            p = p + R.apply(end)
        along, left, up = self.tool_mm[2], -self.tool_mm[1], self.tool_mm[0]
        return middles[1], middles[2], p, p + R.apply([along, left, up])


def _elevation(shape: Shape, motors: Array) -> Array:
    """Elevation (n,) rad of the forearm above the horizontal, for angles (n, 6) of the motors."""
    if shape.drive == "elbow":
        return np.asarray(motors[:, 2] - motors[:, 1])
    lean, crank = motors[:, 1], motors[:, 2]
    joint = shape.upper * np.stack([np.sin(lean), np.cos(lean)], axis=1)
    pin = _CRANK_MM * np.stack([-np.cos(crank), -np.sin(crank)], axis=1)
    # The lever of the forearm ends where a circle about the elbow and one about the pin of the crank meet.
    way = joint - pin
    far = np.linalg.norm(way, axis=1)
    along = (far**2 + shape.upper**2 - _CRANK_MM**2) / (2 * far)
    aside = np.sqrt(np.maximum(shape.upper**2 - along**2, 0.0))
    unit = way / far[:, None]
    across = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    ends = [pin + along[:, None] * unit + side * aside[:, None] * across for side in (1, -1)]
    # Of the two, that of a linkage assembled as a parallelogram.
    sides = [np.linalg.norm(end - joint - pin, axis=1) for end in ends]
    lever = np.where((sides[0] < sides[1])[:, None], *ends) - joint
    turned = np.arctan2(-lever[:, 1], -lever[:, 0])
    return np.asarray(crank + (turned - crank + np.pi) % (2 * np.pi) - np.pi)


NO_ERRORS = MotorErrors(*(np.zeros(6) for _ in range(4)))


def with_fault(arm: LinkedArm, kind: str, axis: int, size: float) -> LinkedArm:
    """An arm with an additional error of a motor: zero, play, wave or soft, in deg, soft in deg/Nm."""
    field = getattr(arm.errors, kind).copy()
    field[axis - 1] += size * _DEG
    return replace(arm, errors=replace(arm.errors, **{kind: field}))


_LOW, _HIGH = np.array([-80, -40, -70, -120, -100, -160]) * _DEG, np.array([80, 70, 60, 120, 100, 160]) * _DEG
"""Range of the postures: of the motors, for motor 3 of the elevation of the forearm."""


def postures(shape: Shape, count: int, rng: np.random.Generator) -> Array:
    """Draw angles (count, 6) rad of the motors."""
    motors = rng.uniform(_LOW, _HIGH, size=(count, 6))
    if shape.drive == "elbow":
        motors[:, 2] += motors[:, 1]
    return motors

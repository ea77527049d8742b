"""Which arms have an inverse in closed form, and their frames with every sign taken out.

Two kinds: an arm with parallel axes 2 and 3 and a spherical wrist, and an arm with parallel axes 2, 3
and 4 (Universal Robots). Reversing the z axis of joint i (a half turn about its x) changes the sign of
theta_i and d_i and moves the alphas on both sides by 180°, so each arm of a kind is brought to the same
alphas, all 90° or 0°, and one derivation serves them all.

A calibrated arm is near a kind: small Hayati angles, alphas off by a little. It is snapped, and the
closed form of the snapped arm seeds Newton's method on the true one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from analysis.kinematics.arm import Arm, Array
from analysis.kinematics.newton import LENGTH_MM

Kind = Literal["spherical wrist", "parallel axes"]

_ALPHA: dict[Kind, Array] = {
    "spherical wrist": np.radians([90.0, 0.0, 90.0, 90.0, 90.0]),
    "parallel axes": np.radians([90.0, 0.0, 0.0, 90.0, 90.0]),
}
"""The alphas of links 1 … 5; what lies before axis 1 is free."""
_NEAR = 0.05
"""A calibrated arm is this near its kind: rad, and lengths over the arm's size."""
_EXACT = 1e-12
_DEGENERATE = 1e-6


@dataclass(frozen=True)
class Canonical:
    """An arm of a kind, signs taken out: theta of the arm = sign · theta here.

    a, d, sign: (6,). T_one_world: (4, 4) from the world into the frame of axis 1 at rest, raised by d1.
    T_tool_wrist: (4, 4) from the tool back along axis 6 by d6. snapped_mm: how far snapping can move the tool, a radian
    counted as 500 mm.
    """

    kind: Kind
    sign: Array
    a: Array
    d: Array
    T_one_world: Array
    T_tool_wrist: Array
    snapped_mm: float

    @property
    def exact(self) -> bool:
        """Whether nothing had to be snapped."""
        return self.snapped_mm == 0


def canonical(arm: Arm) -> Canonical | None:
    """The kind that the arm belongs to or is near, or None for an arm of no such kind."""
    for kind, alpha in _ALPHA.items():
        half_turns = np.rint((arm.alpha[1:] - alpha) / np.pi)
        turned = np.concatenate([arm.alpha[1:] - alpha - half_turns * np.pi, arm.beta[1:]])
        lengths = _must_vanish(arm, kind)
        deviation = max(np.abs(turned).max(), np.abs(lengths).max() / _size(arm))
        if deviation < _NEAR and not _degenerate(arm, kind):
            sign = np.cumprod(np.concatenate([[1.0], np.where(half_turns % 2 == 1, -1.0, 1.0)]))
            reach = _size(arm) + float(np.linalg.norm(arm.T_flange_tool[:3, 3])) + LENGTH_MM
            moved = float(np.abs(lengths).sum() + np.abs(turned).sum() * reach)
            return _snapped(arm, kind, sign, 0.0 if deviation < _EXACT else moved)
    return None


def _size(arm: Arm) -> float:
    return float(np.abs(arm.a[1:]).sum() + np.abs(arm.d[1:]).sum()) or 1.0


def _must_vanish(arm: Arm, kind: Kind) -> Array:
    """Lengths in mm that the kind has zero."""
    lengths = [arm.a[4], arm.a[5], arm.d[4]] if kind == "spherical wrist" else [arm.a[5]]
    return np.array(lengths)


def _degenerate(arm: Arm, kind: Kind) -> bool:
    """Whether a link of the plane arm is missing."""
    forearm = np.hypot(arm.a[3], arm.d[3]) if kind == "spherical wrist" else abs(arm.a[3])
    return bool(min(abs(arm.a[2]), forearm) < _DEGENERATE * _size(arm))


def _snapped(arm: Arm, kind: Kind, sign: Array, snapped_mm: float) -> Canonical:
    d = sign * arm.d
    raised, drawn_back = np.eye(4), np.eye(4)
    raised[2, 3], drawn_back[2, 3] = d[0], -d[5]
    half_turn = np.diag([1.0, sign[5], sign[5], 1.0])
    T_one_world = np.asarray(np.linalg.inv(arm.T_world_base @ _before_axis_1(arm) @ raised), dtype=np.float64)
    return Canonical(
        kind,
        sign,
        arm.a,
        d,
        T_one_world=T_one_world,
        T_tool_wrist=np.linalg.inv(arm.T_flange_tool) @ half_turn @ drawn_back,
        snapped_mm=snapped_mm,
    )


def _before_axis_1(arm: Arm) -> Array:
    """RotX(alpha0) TransX(a0) RotY(beta0), whatever they are."""
    ca, sa, cb, sb = np.cos(arm.alpha[0]), np.sin(arm.alpha[0]), np.cos(arm.beta[0]), np.sin(arm.beta[0])
    T = np.eye(4)
    T[:3, :3] = [[cb, 0.0, sb], [sa * sb, ca, -sa * cb], [-ca * sb, sa, ca * cb]]
    T[0, 3] = arm.a[0]
    return T

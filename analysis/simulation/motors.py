"""What the motors of an emulated robot draw, and how warm its joints become.

A motor carries what gravity asks, and the friction of its joint: Coulomb's part and one that grows with speed, both
less in a warm joint, whose grease is thin. A joint is warmed by what its motor's winding loses, and cools to the room.
The sizes are those of no make: of arms of some 20 kg, chosen so that joints warm by some degrees in half an hour.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from analysis.kinematics.arm import Array

ROOM_C = 22.0
_TORQUE_NM_A = np.array([12.0, 12.0, 10.0, 8.0, 8.0, 8.0])
"""Torque at the joint for a current: gear times motor."""
COULOMB_NM = np.array([9.0, 9.0, 6.0, 2.4, 2.4, 2.4])
"""At the room's temperature."""
_VISCOUS_NMS = np.array([12.0, 12.0, 8.0, 3.0, 3.0, 3.0])
_THINNER_PER_C = 0.008
"""Share of its friction that a joint loses with each degree."""
_WARMS_C_A2 = 1.5
"""How much warmer a joint becomes in the end for a current squared: resistance of winding times that of its cooling."""
_WARMING_S = 1500.0
_HOLDS_C = 4.0
"""How much warmer than the room the electronics of a joint keep it."""
_CREEP_RAD_S = 1e-4
"""Below this speed a joint begins to stick: friction goes through zero."""


@dataclass
class Motors:
    """The motors of six joints. warm_c (6,): temperatures of the joints, at last_ns on the host's clock."""

    warm_c: Array = field(default_factory=lambda: np.full(6, ROOM_C + _HOLDS_C))
    last_ns: int | None = None

    def shown(self, now_ns: int, torque_nm: Array, speed_rad_s: Array) -> tuple[Array, Array]:
        """Return the currents (6,) in A and the temperatures (6,) in °C, of joints that move at speed_rad_s (6,) and
        on which gravity acts with torque_nm (6,): their motors push the other way."""
        friction = COULOMB_NM * np.tanh(speed_rad_s / _CREEP_RAD_S) + _VISCOUS_NMS * speed_rad_s
        friction *= 1 - _THINNER_PER_C * (self.warm_c - ROOM_C)
        current_a = (friction - torque_nm) / _TORQUE_NM_A
        passed_s = 0.0 if self.last_ns is None else max(0.0, (now_ns - self.last_ns) / 1e9)
        self.last_ns = now_ns if self.last_ns is None else max(now_ns, self.last_ns)
        ends_c = ROOM_C + _HOLDS_C + _WARMS_C_A2 * current_a**2
        self.warm_c = ends_c + (self.warm_c - ends_c) * np.exp(-passed_s / _WARMING_S)
        return current_a, self.warm_c


def friction_current_a(axis: int, warm_c: float) -> float:
    """Return the current in A that Coulomb's friction takes of a joint's motor at a temperature."""
    share = 1 - _THINNER_PER_C * (warm_c - ROOM_C)
    return float(COULOMB_NM[axis - 1] * share / _TORQUE_NM_A[axis - 1])

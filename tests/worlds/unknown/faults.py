"""Cells of the independent world with one to three faults that rig knows, and no unknown cause."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.worlds.unknown.causes import log_uniform
from tests.worlds.unknown.cells import (
    LEAST_NOISES,
    MOST_TRIES,
    Cell,
    Known,
    Sight,
    draw_sound,
    noise_um,
    remainder,
    rms_um,
    seen_without_noise,
    sight_of,
)

PLACES = (("ur10e", "pose"), ("elbow", "pose"), ("ur10e", "touch"), ("seven", "pose"), ("ur10e", "circle"))
SIZES = {
    "joint_offset": (0.3, 1.0),
    "backlash": (0.08, 0.25),
    "transmission_error": (0.05, 0.15),
    "compliance": (3e3, 8e3),
}
"""Ranges in degrees, and Nm/rad of a stiffness. The smallest fault is 1.5 times the largest size of a healthy arm: 0.2,
0.05 and 0.025 degrees, and 0.003 degrees per Nm."""
LEFT_OUT = {("compliance", "seven"), ("transmission_error", "pose")}
"""The joints of the seven-axis arm are softer than a fault when healthy. From poses rig names no gear, because any
curve over the angle of a joint is a sum of its waves."""


@dataclass(frozen=True)
class Fault:
    """A fault. size: in rad, or rad/Nm of a compliance; order and phase (rad) of the wave of a gear."""

    kind: str
    axis: int
    size: float
    order: int = 0
    phase: float = 0.0

    @property
    def name(self) -> str:
        return f"{self.kind} {self.axis}"

    def added_to(self, known: Known) -> Known:
        """Return the errors of an arm with this fault in place of its healthy error."""
        if self.kind == "transmission_error":
            return replace(known, gear=(self.axis, self.order, self.size, self.phase))
        field = {"joint_offset": "zero", "backlash": "play"}.get(self.kind, self.kind)
        sizes = getattr(known, field).copy()
        sizes[self.axis - 1] = self.size
        return replace(known, **{field: sizes})


def _draw_fault(kind: str, rng: np.random.Generator) -> Fault:
    axis = int(rng.integers(2, 4 if kind == "compliance" else 6))
    size = log_uniform(rng, *SIZES[kind])
    if kind == "compliance":
        return Fault(kind, axis, 1 / size)
    sign = rng.choice([-1, 1]) if kind == "joint_offset" else 1
    return Fault(kind, axis, sign * np.radians(size), int(rng.integers(1, 9)), rng.uniform(0, 2 * np.pi))


def _is_visible(fault: Fault, sight: Sight) -> bool:
    """True if readings distinguish a fault from constants and set-up. A wrong zero is a constant far from healthy."""
    if fault.kind == "joint_offset":
        return True
    cell = replace(sight.cell, known=fault.added_to(sight.cell.known))
    change = seen_without_noise(cell, sight.planned) - sight.without
    return rms_um(remainder(sight.basis, change)) >= LEAST_NOISES * noise_um(cell)


def draw_faulty(seed: int) -> tuple[Cell, list[str]]:
    """Draw a cell and the names of its faults: one, two or three kinds, on the axes 2 to 5, each of them visible."""
    rng = np.random.default_rng([seed, 9])
    arm_name, test = PLACES[seed % len(PLACES)]
    cell = replace(draw_sound(seed, arm_name, test, rng), states_approach=True)
    sight = sight_of(cell)
    kinds = [kind for kind in SIZES if (kind, arm_name) not in LEFT_OUT and (kind, test) not in LEFT_OUT]
    known, names = cell.known, []
    for kind in rng.permutation(kinds)[: 1 + seed // len(PLACES) % 3]:
        tried = (_draw_fault(kind, rng) for _ in range(MOST_TRIES))
        fault = next((fault for fault in tried if _is_visible(fault, sight)), None)
        if fault is not None:
            known = fault.added_to(known)
            names.append(fault.name)
    return replace(cell, known=known), names

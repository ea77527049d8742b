"""Cells of a UR10e with a single hidden effect of rig's library, measured by yaw only, twice in each direction.

Half of them are low-order gear errors of axis 6, which makes a full turn on the circle. The others are similar in
appearance: gauge scale, gauge baseline, coupling of axes 4 and 6, form of the ball.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.worlds.unknown.arms import Arm, Deviation, no_deviation
from tests.worlds.unknown.ball import Link
from tests.worlds.unknown.causes import Cause, log_uniform
from tests.worlds.unknown.cells import Cell, Known, draw_known, draw_noise, size_beside_setup_um
from tests.worlds.unknown.motion import Motion

OTHERS = ("gauge_scale", "gauge_baseline", "wrist_coupling", "ball_form")


@dataclass(frozen=True, kw_only=True)
class WristCoupling(Cause):
    """A wrist joint that turns another by a share of its angle, such as a belt with a wrong ratio in the controller."""

    kind = "wrist coupling"
    tests = ("circle",)
    to_axis: int
    share: float

    def deviation(self, arm: Arm, motion: Motion) -> Deviation:
        found = no_deviation(len(motion.t), arm.axes)
        found.joint[:, self.to_axis - 1] = self.scale * self.share * motion.q[:, self.axis - 1]
        return found

    def describe(self) -> str:
        return f"{self.axis}>{self.to_axis}, {self.share:.5f}"


@dataclass(frozen=True)
class SingleCell:
    """A cell with its hidden effect by name in rig, the size (degrees, mm or a ratio), and the rms change of the
    readings in µm after fitting the set-up.
    """

    cell: Cell
    name: str
    size: float
    order: int
    worth_um: float


def draw_single(seed: int) -> SingleCell:
    """Cell for a seed: even seeds have a gear error, odd ones the other effects in turn."""
    rng = np.random.default_rng([seed, 10])
    sound = Cell(
        arm_name="ur10e",
        test="circle",
        known=draw_known(rng, 6, rich=False),
        cause=None,
        noise=draw_noise(rng, "circle"),
        seed=seed,
        link=Link(ball=rng.normal(0, 0.4, 3), zeros=rng.normal(0, 0.02, 2)),
        tests=("yaw",),
    )
    effect = OTHERS[seed // 2 % len(OTHERS)] if seed % 2 else "transmission_error"
    cell, name, size, order = _HIDE[effect](sound, rng)
    return SingleCell(cell, name, size, order, size_beside_setup_um(cell, sound))


Hidden = tuple[Cell, str, float, int]


def _gear(cell: Cell, rng: np.random.Generator) -> Hidden:
    """Draw a gear error of 0.005 to 0.03 degrees (0.3 to 1.8 arcmin; strain-wave gears, CSF: 1 to 1.5 arcmin)."""
    order, size = int(rng.integers(1, 5)), log_uniform(rng, 0.005, 0.03)
    known: Known = replace(cell.known, gear=(6, order, np.radians(size), rng.uniform(0, 2 * np.pi)))
    return replace(cell, known=known), "transmission_error 6", size, order


def _scale(cell: Cell, rng: np.random.Generator) -> Hidden:
    """Draw a gauge scale error of 0.3 to 3 % of the reading."""
    gauge, size = int(rng.integers(2)), log_uniform(rng, 0.003, 0.03) * rng.choice([-1.0, 1.0])
    scale = np.zeros(2)
    scale[gauge] = size
    return replace(cell, link=replace(cell.link, scale=scale)), f"gauge_scale g{gauge + 1}", size, 0


def _baseline(cell: Cell, rng: np.random.Generator) -> Hidden:
    """Draw a baseline error of 0.3 to 3 mm, nominally 50."""
    size = log_uniform(rng, 0.3, 3.0) * rng.choice([-1.0, 1.0])
    return replace(cell, link=replace(cell.link, baseline_mm=size)), "gauge_baseline", size, 0


def _coupling(cell: Cell, rng: np.random.Generator) -> Hidden:
    """Draw a coupling: 0.0005 to 0.01 from axis 4, which moves by some degrees, to axis 6; or a hundredth of that
    from the full turn of axis 6 to axis 4.
    """
    axes = (4, 6) if rng.random() < 0.5 else (6, 4)
    size = log_uniform(rng, 0.0005, 0.01) * rng.choice([-1.0, 1.0]) / (100 if axes[0] == 6 else 1)
    cause = WristCoupling(axis=axes[0], to_axis=axes[1], share=size)
    return replace(cell, cause=cause), f"wrist_coupling {axes[0]}>{axes[1]}", size, 0


def _ball(cell: Cell, rng: np.random.Generator) -> Hidden:
    """Draw a ball form of 2 to 5 lobes and 2 to 20 µm (a grade 100 ball: 2.5 µm, ISO 3290; worn balls have several
    times more).
    """
    lobes, size = int(rng.integers(2, 6)), log_uniform(rng, 0.002, 0.020)
    link = replace(cell.link, lobes=lobes, form_mm=size, form_phase=rng.uniform(0, 2 * np.pi))
    return replace(cell, link=link), "ball_form", size, lobes


_HIDE = {
    "transmission_error": _gear,
    "gauge_scale": _scale,
    "gauge_baseline": _baseline,
    "wrist_coupling": _coupling,
    "ball_form": _ball,
}

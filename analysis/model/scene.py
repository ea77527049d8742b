"""What the effects act on: one time-ordered trace on its way from the reported angles to the readings.

Effects replace parts of it, stage by stage; nothing is changed in place. The stages, in order:

    time    when the readings were really taken: `q` is what was reported then
    arm     the arm's constants
    joint   link-side angles `link_q`, which begin as `q`; every effect sees the reported ones, deviations add
    tool    where the tool is, `T`, after the forward kinematics
    set-up  ball form and gauge places
    gauge   the readings `g_mm`
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from analysis.kinematics.arm import Arm, Array
from analysis.model.gravity import Load

Stage = Literal["time", "arm", "joint", "tool", "setup", "gauge"]
STAGES: tuple[Stage, ...] = ("time", "arm", "joint", "tool", "setup", "gauge")


@dataclass(frozen=True)
class Scene:
    """n samples in order of time.

    t_s (n,); q, link_q (n, 6) rad; T (n, 4, 4) of the tool in the world; contact (n,) rad: angle around the ball at
    which the link touches it; form_mm (n,): what the ball's form adds to the distance; offsets_mm (k,): places of the
    gauges on the baseline; g_mm (n, k): readings. What a stage has not reached yet is empty.
    """

    arm: Arm
    load: Load
    t_s: Array
    q: Array
    link_q: Array
    T: Array
    contact: Array
    form_mm: Array
    offsets_mm: Array
    g_mm: Array

    def taken_at(self, t_s: Array) -> Scene:
        """As reported at other instants t_s (n,)."""
        q = self.reported_at(t_s)
        return replace(self, q=q, link_q=q)

    def reported_at(self, t_s: Array) -> Array:
        """Reported angles (n, 6) rad at instants t_s (n,), the ends held.

        By cubics with the slopes of the samples: straight lines would be wrong by more than a millisecond's lag does.
        A joint that stands beside a sample has no slope there.
        """
        t, q = self.t_s, self.q
        slopes = np.gradient(q, t, axis=0)
        stands = np.diff(q, axis=0) == 0
        slopes[:-1][stands] = slopes[1:][stands] = 0.0
        k = np.clip(np.searchsorted(t, t_s) - 1, 0, len(t) - 2)
        width = (t[k + 1] - t[k])[:, None]
        x = np.clip((t_s - t[k])[:, None] / width, 0.0, 1.0)
        rise, begin = x * x * (3 - 2 * x), x * (1 - x) ** 2
        angles: Array = q[k] + rise * (q[k + 1] - q[k]) + width * (begin * slopes[k] - x * x * (1 - x) * slopes[k + 1])
        return angles

    def turned(self, axis: int, deviation: Array | float) -> Scene:
        """The link side of a joint (1 … 6) turned by a deviation (n,) rad."""
        link_q = self.link_q.copy()
        link_q[:, axis - 1] += deviation
        return replace(self, link_q=link_q)

    def shifted(self, offset_mm: Array) -> Scene:
        """The tool moved by (n, 3) mm in the world."""
        T = self.T.copy()
        T[:, :3, 3] += offset_mm
        return replace(self, T=T)

    def read(self, gauge: str, change: Callable[[Array], Array]) -> Scene:
        """One gauge's readings (n,) mm changed; the same scene in a test without that gauge."""
        column = {"g1": 0, "g2": 1}[gauge]
        if column >= self.g_mm.shape[1]:
            return self
        g_mm = self.g_mm.copy()
        g_mm[:, column] = change(g_mm[:, column])
        return replace(self, g_mm=g_mm)

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
        """As reported at other instants t_s (n,), the ends held; a trace without time has no other instants."""
        if len(self.t_s) < 2 or self.t_s[-1] <= self.t_s[0]:
            return self
        q = np.stack([np.interp(t_s, self.t_s, joint) for joint in self.q.T], axis=1)
        return replace(self, q=q, link_q=q)

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

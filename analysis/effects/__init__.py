"""Why the link side is not where the controller reports it: link = reported + effect.

One effect a file, named as in the rig file, each a pure function over the whole time-ordered trace,
since a play depends on the history of direction.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence

from analysis.kinematics.arm import Array
from rigs.effects import Effect


def link_side(effects: Sequence[Effect], q: Array) -> Array:
    """Link-side joint angles (n, 6) rad of the reported ones q (n, 6) rad, in order of time.

    Every effect sees the reported angles; their deviations add.
    """
    linked = q.copy()
    for effect in effects:
        module = importlib.import_module(f"analysis.effects.{effect.effect}")
        linked[:, effect.axis - 1] += module.deviation(effect, q[:, effect.axis - 1])
    return linked

"""How warm the joints of a recorded run were, as figures of the history: gears and links grow with it."""

from __future__ import annotations

from analysis.measures.quantity import Quantity
from analysis.traces.condition import Condition


def joint_warmth(condition: Condition) -> dict[str, Quantity]:
    """`temperature_j1_c` … the mean over the run, and `warming_j1_c` … the rise within it, of the joints that show it.

    u is how much the readings vary; makers do not state how true the sensors are.
    """
    shown = condition.warmth or {}
    means = {f"temperature_j{axis}_c": Quantity(joint.mean_c, joint.u_mean_c, "c") for axis, joint in shown.items()}
    rises = {f"warming_j{axis}_c": Quantity(joint.rise_c, joint.u_rise_c, "c") for axis, joint in shown.items()}
    return means | rises

"""Published numbers of Oh 2019, and the effects used in the simulations of the paper."""

from __future__ import annotations

from collections.abc import Sequence

from rigs.effects import Effect
from rigs.schema.effect import is_play

RULE_ECCENTRICITY_MM, RULE_RADIUS_MM, RULE_DEG, RULE_CONSTANT = 14.142, 70.0, 11.56, 206.0
"""§2.1: E_max = ±206 e[µm] / R[mm] arcsec. The constant is 206.265 = 648 / pi, rounded in the paper."""
REVERSALS_DEG = {
    "Theta": (105.0, 237.0),
    "W": (3.0, 182.0),
    "U": (351.0, 169.0),
    "gamma": (),
    "beta": (0.0, 190.0),
    "alpha": (82.0, 290.0),
}
"""Table 1: circle angles of the upper and lower backlash points."""
YAW_BAND_DEG = {"cw": 0.53, "acw": 0.85}
"""Fig. 6: measured error band in each direction."""
JUMP_AT_DEG = 237.0
"""Fig. 8: circle angle of the sudden change caused by the backlash of Theta."""
ROLL_MEASURED_DEG, ROLL_SIMULATED_DEG, ROLL_EXTREMES_DEG = 1.75, 1.76, (180.0, 45.0)
"""Fig. 10 (the same for cw and acw) and Fig. 11."""
RADIUS_MM, MEASURED_BAND_MM, SIMULATED_BAND_MM = 400.192, 1.0, 0.922
"""Fig. 13 ("just greater than 1 mm"), and Fig. 14 with gear transmission errors only."""
UNI_MM, BI_MM = 0.261, 1.567
"""Fig. 15: uni-directional and bi-directional repeatability."""


def gears(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Gear transmission errors, as in the paper's simulation of figure 14."""
    return tuple(effect for effect in effects if hasattr(effect, "order"))


def datum_and_play(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Datum errors and backlash, as in the paper's simulation of figure 8."""
    return tuple(effect for effect in effects if is_play(effect) or effect.turning(1, 0.0))

"""Colours of the screen, from the sixteen that every terminal has; in pairs that the colour-blind can distinguish."""

from __future__ import annotations

GAUGE_COLOURS = ("bright_cyan", "bright_yellow")
"""The colours of g1 and g2."""
ANGLE_COLOUR = "bright_white"
ACW_COLOUR, CW_COLOUR = "bright_green", "bright_magenta"


def direction_colour(sense: float) -> str:
    """Return the colour of a direction: sense 1 for acw, -1 for cw, 0 where it is unknown."""
    return {1: ACW_COLOUR, -1: CW_COLOUR}.get(int(sense), "")

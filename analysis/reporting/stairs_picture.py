"""The staircase of the gap as a picture: a bar for each step, and a mark for what it leaves elsewhere."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import SubFigure

from analysis.reporting.stairs import Stairs, left_words
from analysis.reporting.texts import texts_of

_INKS = {"used": "#1f5fa8", "held_out": "#1c1c1c", "unseen": "#d95f02"}
_SYMBOLS = {"held_out": "s", "unseen": "D"}
_GREY = "#777777"


def draw_stairs(sheet: SubFigure, stairs: Stairs, floor_um: float) -> None:
    """A bar for what each step leaves on the runs used, and a mark for each other place."""
    axes: Axes = sheet.subplots()
    place = np.arange(len(stairs.steps))[::-1]
    texts = texts_of("en")
    for k, key in enumerate(stairs.places):
        um, u_um = (np.array([getattr(step.left[k], of) for step in stairs.steps]) for of in ("um", "u_um"))
        if k == 0:
            axes.barh(place, um, color=_INKS[key], height=0.62, label=texts(f"runs_{key}"))
        else:
            axes.plot(
                um, place, ls="", marker=_SYMBOLS[key], ms=5, color=_INKS[key], mec="white", mew=0.6,
                label=texts(f"runs_{key}"),
            )  # fmt: skip
        axes.errorbar(um, place, xerr=u_um, fmt="none", ecolor="black", elinewidth=0.7)
    for y, step in zip(place, stairs.steps, strict=True):
        at = (max(residue.um + residue.u_um for residue in step.left), y)
        axes.annotate(left_words(step.left[0]), at, (5, 0), textcoords="offset points", va="center", fontsize=8)
    axes.set_yticks(place, [step.name for step in stairs.steps], fontsize=8)
    if np.isfinite(floor_um):
        axes.axvline(floor_um, color=_GREY, ls="--", lw=1, label=f"noise floor {floor_um:.1f}")
    axes.set_ylim(-0.6, len(stairs.steps) - 0.4)
    axes.set_xlim(0, 1.16 * max(stairs.largest_um, floor_um if np.isfinite(floor_um) else 0.0))
    axes.set_xlabel("left of the error, rms / µm", fontsize=8)
    axes.tick_params(axis="x", labelsize=7.5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=7.5, loc="lower right", frameon=False)

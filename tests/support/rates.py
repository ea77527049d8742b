"""Shares and quantiles of a trial beside their goals, with 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

_Z = 1.959964


@dataclass(frozen=True)
class Row:
    """One figure: its goal in words, its value in words, whether it is reached; None where there is no case for it."""

    figure: str
    goal: str
    value: str
    reached: bool | None


def wilson(hits: int, n: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    if not n:
        return 0.0, 1.0
    p, z = hits / n, _Z**2 / n
    half = _Z * math.sqrt(p * (1 - p) / n + z / (4 * n))
    return max(0.0, (p + z / 2 - half) / (1 + z)), min(1.0, (p + z / 2 + half) / (1 + z))


def counted(figure: str, goal: float, hits: int, n: int, *, most: bool = False) -> Row:
    sign = "≤" if most else "≥"
    if not n:
        return Row(figure, f"{sign} {100 * goal:g} %", "no cases", None)
    low, high = wilson(hits, n)
    value = f"{100 * hits / n:.1f} % ({100 * low:.1f} … {100 * high:.1f}), {hits} of {n}"
    return Row(figure, f"{sign} {100 * goal:g} %", value, hits / n <= goal if most else hits / n >= goal)


def time_row(times_s: Iterable[float], most_s: float) -> Row:
    seconds = [time_s for time_s in times_s if math.isfinite(time_s)]
    if not seconds:
        return Row("time a case", f"≤ {most_s:g} s", "no cases", None)
    text = f"median {np.median(seconds):.2f} s, p90 {np.percentile(seconds, 90):.2f} s, most {max(seconds):.1f} s"
    return Row("time a case", f"≤ {most_s:g} s", text, bool(np.median(seconds) <= most_s))


def table(rows: Sequence[Row]) -> list[str]:
    """Lines of figure, goal, value and whether it is reached."""
    width, wide = (max(len(text) for text in column) for column in ([r.figure for r in rows], [r.goal for r in rows]))
    mark = {True: "reached", False: "NOT REACHED", None: ""}
    lines = [f"{'figure':{width}}  {'goal':{wide}}  value"]
    return lines + [
        f"{row.figure:{width}}  {row.goal:{wide}}  {row.value}  {mark[row.reached]}".rstrip() for row in rows
    ]

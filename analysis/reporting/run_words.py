"""What is said of analysed runs of one test: what their uncertainties mean, and acw against cw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.measures.link_angle import CircleResult
from analysis.measures.pooled import ONE_RUN, BetweenRuns, Pairs, Pooled
from analysis.measures.quantity import Quantity
from analysis.measures.results import Result
from analysis.reporting.labels import in_order, whole_label

_LARGEST_OF_NOISE = ("hysteresis_max_deg", "hysteresis_max_mm")
_BEYOND = 4.0
"""Standard uncertainties beyond which two eccentricities are not of one ball by chance. Chosen: odds of 10 000 to 1."""


def what_u_is(group: Sequence[Result], repeated: Sequence[Pooled]) -> str:
    """What the uncertainties of a group mean: of means, and of runs that nothing repeats."""
    if not repeated:
        return ONE_RUN
    runs = " and ".join(f"{len(mean.runs)} runs {mean.title}" for mean in repeated)
    means = f"{runs}: mean ± standard uncertainty of the mean, sd between the runs"
    titles = dict.fromkeys(result.title for result in group)
    single = [title for title in titles if title not in {mean.title for mean in repeated}]
    return f"{means}; {' and '.join(single)}: {ONE_RUN}" if single else means


def figure_in_words(name: str, figure: Quantity | BetweenRuns) -> str:
    """A figure as people read it. Where the largest hysteresis is smaller than u it is noise, and no more than u is
    known of it."""
    value = figure.mean if isinstance(figure, BetweenRuns) else figure
    if name in _LARGEST_OF_NOISE and value.value < value.u < np.inf:
        return f"≤ {value.rounded_u} {value.sign}"
    return str(figure)


def eccentricities_in_words(group: Sequence[Result]) -> list[str]:
    """Why the eccentricities by angle and by distance differ, in a line, where they do by more than noise explains."""
    apart = []
    for result in group:
        angle, distance = (result.figures.get(f"{by}eccentricity_mm") for by in ("", "distance_"))
        if angle is None or distance is None:
            continue
        u = float(np.hypot(angle.u, distance.u))
        away = abs(angle.value - distance.value)
        if np.isfinite(u) and away > _BEYOND * u:
            apart.append((away, away / u))
    if not apart:
        return []
    away, times = max(apart)
    return [
        f"the eccentricities by angle and by distance differ by up to {away:.3f} mm, {times:.0f} u: u holds the noise "
        "of the readings, and not the arm's own error once a lap, which turns the tool and shifts its circle by "
        "different amounts; the ball's own place is known to about that difference"
    ]


def pairs_in_words(both: Pairs | None) -> list[str]:
    """acw against cw in a line, if there is such a pair."""
    if both is None or both.lag is None:
        return []
    figures = "; ".join(
        f"{whole_label(name)} {figure_in_words(name, both.figures[name])}" for name in in_order(both.figures)
    )
    count = f" ({len(both.runs)} pairs)" if len(both.runs) > 1 else ""
    return [f"acw against cw{count}: {figures}"]


def lag_in_words(both: Pairs | None, group: Sequence[Result]) -> list[str]:
    """The lag of the gauges, and which runs are not a pair, one line each."""
    if not isinstance(group[0].found, CircleResult):
        return []
    if both is None:
        return ["one direction cannot show a lag between gauges and robot: analyse acw and cw together"]
    lag, lines = both.lag, list(both.refused)
    if lag is None:
        return lines
    if abs(lag.value) < 2 * lag.u:
        return [*lines, f"a lag of the gauges behind the robot is not detected: {lag}"]
    driven = both.runs[0][0].found
    rad_s = abs(driven.curve.rate) if isinstance(driven, CircleResult) else 0.0
    words = f"the gauges lag the robot by {lag}: the shifts of acw and cw are off by "
    words += (
        f"{np.degrees(rad_s * abs(lag.value) / 1000):.2g}° in opposite directions, which their u does not include; "
    )
    return [*lines, words + "describe the gauge by `timing` in the rig file, or run rig diagnose"]


def warmth_in_words(group: Sequence[Result]) -> list[str]:
    """How warm the joints of each run were, where its robot showed it, one line each."""
    lines = []
    for result in group:
        if warmth := result.measured.condition.warmth:
            means, rises = ([getattr(warming, key) for warming in warmth.values()] for key in ("mean_c", "rise_c"))
            most = max(rises, key=abs)
            line = f"{result.title}, {result.name}: joints {min(means):.1f} to {max(means):.1f} °C in the mean"
            lines.append(f"{line}; axis {list(warmth)[rises.index(most)]} changed by {most:+.1f} °C within the run")
    return lines

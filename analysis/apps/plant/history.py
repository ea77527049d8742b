"""History of a robot: each figure of each test over the runs, with dated changes and the standing against the limit.

A series stands like its newest run (ISO 14253-1). It crosses a bound at the first run proven beyond it after the last
run proven within. Outliers are excluded, except in the newest runs: sudden damage looks like one at first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date

import numpy as np

from analysis.apps.plant.changes import Change, Trend, trend_of
from analysis.apps.plant.collect import Collected
from analysis.apps.plant.records import RunRecord
from analysis.apps.report.texts import ENGLISH
from analysis.procedures.shared.quantity import Quantity
from analysis.robot.kinematics.arm import Array
from rigs.errors import FileError, UseError
from rigs.schema.limits import Limit, Limits, Standing

WATCHED = (
    *("band_deg", "circular_deviation_mm"),
    *(f"play_j{axis}_deg" for axis in range(1, 7)),
    *(f"friction_j{axis}_a" for axis in range(1, 7)),
    *("band_mm", "spread_mean_mm", "rp_mean_mm"),
    *("uni_mean_mm", "bi_mean_mm", "reversal_mean_mm"),
    *("rms_mm", "rms_deg", "repeat_mm"),
)
"""One figure of each kind. The others repeat these, or depend on the mounting of ball and gauges."""
CORRECTED = {"targets": "corrected programs", "entries": "with values entered"}
_OF_AN_AXIS = {"play_j": "play", "temperature_j": "mean temperature", "warming_j": "warming within a run"}


@dataclass(frozen=True)
class Series:
    title: str
    figure: str
    runs: tuple[RunRecord, ...]
    trend: Trend
    limit: Limit | None = None

    @property
    def corrected(self) -> str:
        return self.runs[0].corrected

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        return tuple(run.figures[self.figure] for run in self.runs)

    @property
    def values(self) -> Array:
        return np.array([quantity.value for quantity in self.quantities])

    @property
    def unit(self) -> str:
        return self.quantities[0].sign

    @property
    def label(self) -> str:
        return label_of(self.figure)


@dataclass(frozen=True)
class History:
    collected: Collected
    series: tuple[Series, ...]

    @property
    def robot(self) -> str:
        return self.collected.robot

    @property
    def changed(self) -> list[tuple[Series, Change]]:
        changes = [(series, change) for series in self.series for change in series.trend.changes]
        return sorted(changes, key=lambda pair: (pair[0].runs[pair[1].first].when.timestamp(), pair[1].chance))


def label_of(figure: str) -> str:
    """`play of axis 2`."""
    for prefix, words in _OF_AN_AXIS.items():
        if figure.startswith(prefix):
            return f"{words} of axis {figure[len(prefix)]}"
    return ENGLISH.whole_label(figure)


def history_of(
    collected: Collected, figure: str | None = None, since: date | None = None, limits: Limits | None = None
) -> History:
    """Follow each figure over the runs. limits: in place of those of the newest run."""
    runs = [run for run in collected.runs if since is None or run.when.date() >= since]
    names = {name for run in runs for name in run.figures}
    if not runs:
        problem = "no run has figures" if since is None else f"runs since {since} have no results"
        remedy = "list the runs with rig runs, or give an earlier --since"
        raise FileError(collected.robot, problem, remedy, code="run.missing")
    if figure is not None and figure not in names:
        problem, remedy = f"the runs have no quantity {figure!r}", f"choose from {', '.join(sorted(names))}"
        raise UseError("--figure", problem, remedy)
    tolerances = collected.limits if limits is None else limits
    picked = []
    for title, group in programs_of(runs):
        test = group[0].test
        limited = sorted(name for name in names.difference(WATCHED) if tolerances.of(test, name) is not None)
        for name in [*WATCHED, *limited] if figure is None else [figure]:
            with_figure = tuple(run for run in group if name in run.figures and np.isfinite(run.figures[name].value))
            if with_figure:
                picked.append((title, name, with_figure))
    series = []
    for title, name, with_figure in picked:
        quantities = [run.figures[name] for run in with_figure]
        values, u = (np.array([getattr(quantity, part) for quantity in quantities]) for part in ("value", "u"))
        trend = trend_of(values, np.nan_to_num(u, posinf=0.0), len(picked))
        series.append(Series(title, name, with_figure, trend, tolerances.of(with_figure[0].test, name)))
    return History(collected, tuple(series))


def programs_of(runs: Iterable[RunRecord]) -> list[tuple[str, list[RunRecord]]]:
    """Comparable runs with a title, such as `yaw acw, placement left, corrected programs`.

    Runs of a corrected program show the correction, not the arm.
    """
    groups: dict[tuple[str, str, str, str], list[RunRecord]] = {}
    for run in runs:
        groups.setdefault(run.key, []).append(run)
    driven = Counter((title, placement) for title, placement, _ in {key[:3] for key in groups})
    titled = []
    for (title, placement, program, corrected), group in sorted(groups.items()):
        words = [title, f"placement {placement}" if placement else "", CORRECTED.get(corrected, "")]
        words += [f"program {program}"] if driven[title, placement] > 1 else []
        titled.append((", ".join(filter(None, words)), group))
    return titled


_CROSSED: dict[Standing, tuple[tuple[Standing, ...], Standing]] = {
    "pass": (("pass",), "fail"),
    "watch": (("watch", "fail"), "pass"),
    "fail": (("fail",), "pass"),
}
"""By the standing of the newest run: standings of the first run after the crossing, and of the last before it."""


@dataclass(frozen=True)
class JudgedSeries:
    limit: Limit
    standing: Standing
    bound: float
    since: RunRecord
    newest: RunRecord
    beyond: tuple[RunRecord, ...]
    count: int


def judge(series: Series) -> JudgedSeries | None:
    """Judge the newest run of a series by its limit; None without a limit."""
    if series.limit is None:
        return None
    last = max(np.flatnonzero(~series.trend.wild), default=-1)
    kept = enumerate(zip(series.runs, series.quantities, series.trend.wild, strict=True))
    runs = [(run, quantity) for k, (run, quantity, is_outlier) in kept if not is_outlier or k > last]
    standings = [series.limit.standing(quantity.value, quantity.u) for _, quantity in runs]
    # The deciding bound in the unit of the figure: `fail` if exceeded, otherwise the lower bound
    bounds = [size for size in (series.limit.watch, series.limit.fail) if size is not None]
    bound = bounds[-1] if standings[-1] == "fail" else bounds[0]
    against = [Limit(fail=bound).standing(quantity.value, quantity.u) for _, quantity in runs]
    after, before = _CROSSED[standings[-1]]
    crossed = max((k for k, standing in enumerate(against) if standing == before), default=-1) + 1
    since = next(k for k in range(crossed, len(runs)) if against[k] in after)
    beyond = tuple(run for (run, _), standing in zip(runs, standings, strict=True) if standing == "fail")
    return JudgedSeries(series.limit, standings[-1], bound, runs[since][0], runs[-1][0], beyond, len(runs))

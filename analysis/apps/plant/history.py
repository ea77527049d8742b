"""History of a robot: each figure of each test over the runs, with dated changes and the standing against the limit.

A series stands like its newest run (ISO 14253-1). It crosses a bound at the first run proven beyond it after the last
run proven within. Outliers are excluded, except in the newest runs: sudden damage looks like one at first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np

from analysis.apps.plant.changes import FALSE_ALARMS, FEWEST, NEWEST, Change, Trend, trend_of
from analysis.apps.plant.collect import Collected, MarkedCheck
from analysis.apps.plant.records import RunRecord, in_time
from analysis.apps.report.texts import ENGLISH
from analysis.procedures.shared.quantity import Quantity
from analysis.robot.kinematics.arm import Array
from rigs.errors import FileError, UseError
from rigs.schema.limits import Limit, Limits, Standing
from rigs.text import counted, enumerated, escape_text

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
    """limits: in place of those of the newest run."""
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
    """None without a limit."""
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


# ----------------------------------------------------------------------------------------------------------------------
# In plain sentences.

_MOST_NAMED = 5
_MONTHS = ("Jan", "Feb", "March", "April", "May", "June", "July", "Aug", "Sept", "Oct", "Nov", "Dec")


def sentences(history: History) -> list[str]:
    moved = [movement_line(check) for check in history.collected.checks if check.has_moved]
    limited = [line for series in history.series for line in _limit_sentences(series)]
    # Simultaneous changes of a figure in several tests in the same direction, the most certain first
    groups: list[list[tuple[Series, Change]]] = []
    for candidate in history.changed:
        for group in groups:
            if _alike(group[0], candidate):
                group.append(candidate)
                break
        else:
            groups.append([candidate])
    changed = []
    for group in groups:
        (series, change), *others = sorted(group, key=lambda member: member[1].chance)
        also = [its_series.title for its_series, _ in others]
        seen = f"; {enumerated(also)} also show{'s' * (len(also) == 1)} the change" if also else ""
        size, words = change_words(series, change)
        changed.append(
            f"{words[0].upper()}{words[1:]} ({series.title}: by {size}; runs {series.runs[change.first].name} and "
            f"{series.runs[change.last].name}{seen})."
        )
    if moved or changed or all(is_short(series) for series in history.series):
        return [*moved, *limited, *changed]
    return [*limited, "All changes are within the scatter between runs."]


def change_words(series: Series, change: Change) -> tuple[Quantity, str]:
    size = Quantity(change.after - change.before, change.u, series.quantities[0].unit)
    verb = "rose" if change.after > change.before else "fell"
    levels = f"from {size.rounded(change.before)} to {size.rounded(change.after)} {series.unit}"
    when = f"{dates(series, change)}{', and may continue' if change.is_last else ''}"
    return size, f"{series.label} {verb} {levels} {when}"


def movement_line(marked: MarkedCheck) -> str:
    against = enumerated(list(marked.check.reference[:_MOST_NAMED]))
    return f"{_day(marked.when)}, " + escape_text(f"run {marked.run} compared with {against}: {marked.check.answer}")


def origin(history: History) -> str:
    runs = _runs_of(history)
    return simulated_runs(sum(run.simulated for run in runs), len(runs))


def too_few(history: History) -> str:
    runs = _runs_of(history)
    if not runs:
        return "The runs contain none of the monitored quantities."
    begin = "There is only 1 run" if len(runs) == 1 else f"There are {len(runs)} runs"
    return f"{begin}, {_span(runs)}: changes can be detected only from {2 * FEWEST} runs per test."


def _runs_of(history: History) -> list[RunRecord]:
    return in_time({run.name: run for series in history.series for run in series.runs}.values())


def remarks(history: History) -> list[str]:
    runs = _runs_of(history)
    short = sum(map(is_short, history.series))
    alarms = f"; for an unchanged robot, {FALSE_ALARMS:.0%} of histories report a change"
    looked_at = f"{counted(len(history.series), 'series', 'series')} of {counted(len(runs), 'run')} evaluated"
    lines = [looked_at + (alarms if short < len(history.series) else "")]
    if short:
        lines.append(f"{short} of the series have fewer than {2 * FEWEST} runs, too few to detect a change")
    if any(len(series.runs) > NEWEST for series in history.series):
        lines.append(f"changes are detected only in the newest {NEWEST} runs of a series")
    lines += [movement_line(check) for check in history.collected.checks if not check.has_moved]
    wild: dict[str, list[str]] = {}
    for series in history.series:
        for run, is_outlier in zip(series.runs, series.trend.wild, strict=True):
            if is_outlier:
                wild.setdefault(run.name, []).append(f"{series.label} of {series.title}")
    named = list(wild.items())[:_MOST_NAMED]
    lines += [
        f"run {escape_text(name)} is an outlier and was not used to detect changes in {enumerated(of)}"
        for name, of in named
    ]
    if len(wild) > _MOST_NAMED:
        lines.append(f"{len(wild) - _MOST_NAMED} further outliers were not used to detect changes")
    return lines


def doubts(history: History) -> list[str]:
    broken = [(record.name, record.problem) for record in history.collected.broken]
    return [*history.collected.notes, *without_figures(broken)]


def without_figures(runs: Sequence[tuple[str, str]]) -> list[str]:
    if not runs:
        return []
    lines = [f"{counted(len(runs), 'run has no figures and is', 'runs have no figures and are')} ignored:"]
    lines += [escape_text(f"  {name}: {why}") for name, why in runs[:_MOST_NAMED]]
    if len(runs) > _MOST_NAMED:
        lines.append(f"  and {len(runs) - _MOST_NAMED} more, listed by --json")
    return lines


def is_short(series: Series) -> bool:
    return len(series.runs) < 2 * FEWEST


def against_limit(series: Series, *, dated: bool = True) -> str:
    """`beyond 0.1 since 2026-05-03`; empty without a limit."""
    judged = judge(series)
    if judged is None:
        return ""
    word = {"pass": "within", "watch": "watch", "fail": "beyond"}[judged.standing]
    is_dated = dated and judged.standing != "pass" and judged.count > 1
    since = f" since {judged.since.when.date()}" if is_dated else ""
    return f"{word} {judged.bound:g}{since}"


def _limit_sentences(series: Series) -> list[str]:
    judged = judge(series)
    if judged is None or (judged.standing == "pass" and not judged.beyond):
        return []
    figure = f"{series.label[0].upper()}{series.label[1:]} of {series.title}"
    newest = judged.newest.figures[series.figure]
    if judged.count == 1:
        stands = "is outside" if judged.standing == "fail" else "possibly exceeds"
        of = f"run {judged.newest.name} of {_day(judged.newest.when)}"
        return [f"{figure} {stands} the limit of {judged.bound:g} {series.unit}: {of} has {newest}."]
    since = f"{judged.bound:g} {series.unit} since {_day(judged.since.when)} (run {judged.since.name})"
    standing = {
        "pass": f"was outside the limit, and has been within {since}",
        "watch": f"has possibly exceeded the limit of {since}",
        "fail": f"has been outside the limit of {since}",
    }[judged.standing]
    beyond = judged.beyond
    among = f"; {len(beyond)} of {judged.count} runs outside, {_span(beyond)}" if beyond else ""
    return [f"{figure} {standing}: the newest run has {newest}{among}."]


def dates(series: Series, change: Change) -> str:
    """`between 3 and 17 May 2026`, or clock times within a day."""
    first, last = series.runs[change.first].when, series.runs[change.last].when
    if first.date() == last.date():
        return f"on {_day(first)} between {first:%H:%M} and {last:%H:%M}"
    same_year, same_month = first.year == last.year, (first.year, first.month) == (last.year, last.month)
    begin = str(first.day) if same_month else f"{first.day} {_MONTHS[first.month - 1]}"
    return f"between {begin if same_year else _day(first)} and {_day(last)}"


def _span(runs: Sequence[RunRecord]) -> str:
    """`from 1 May 2026 to 6 May 2026`."""
    first, last = _day(runs[0].when), _day(runs[-1].when)
    return f"on {first}" if first == last else f"from {first} to {last}"


def _day(when: date) -> str:
    return f"{when.day} {_MONTHS[when.month - 1]} {when.year}"


def _alike(pair: tuple[Series, Change], other_pair: tuple[Series, Change]) -> bool:
    """Changes of a figure in two tests at the same time and in the same direction."""
    (series, change), (its_series, its) = pair, other_pair
    begin = max(series.runs[change.first].when, its_series.runs[its.first].when)
    end = min(series.runs[change.last].when, its_series.runs[its.last].when)
    is_same = series.figure == its_series.figure and series is not its_series
    return is_same and (change.after > change.before) == (its.after > its.before) and begin <= end


def simulated_runs(simulated: int, runs: int) -> str:
    if not simulated:
        return ""
    if simulated == runs:
        which, whose = "This run was" if runs == 1 else "All runs were", "No real robot was measured."
    else:
        which = f"{simulated} of {runs} runs {'was' if simulated == 1 else 'were'}"
        whose = f"{'It does' if simulated == 1 else 'They do'} not show a real robot."
    return f"{which} simulated or recorded in an emulated cell. {whose}"

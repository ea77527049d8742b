"""The history of a robot in sentences: changes, limits, remarks and doubts."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date

from analysis.apps.plant.changes import FALSE_ALARMS, FEWEST, NEWEST, Change
from analysis.apps.plant.collect import MarkedCheck
from analysis.apps.plant.history import History, Series, judge
from analysis.apps.plant.records import RunRecord, in_time
from analysis.procedures.shared.quantity import Quantity
from rigs.text import counted, enumerated, escape_text

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

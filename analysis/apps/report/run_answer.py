"""The answer of analysed runs: figures of each test, remarks on uncertainties, the truth of an emulated cell, JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.apps.report.blocks import Block, Cell, Heading, Row, Sentence, Table, paragraphs
from analysis.apps.report.texts import ENGLISH, LEADING, Texts, in_order, joined
from analysis.procedures.circle import CircleResult
from analysis.procedures.pooled import ONE_RUN, BetweenRuns, Pooled, figure_columns, pairs_of, pooled
from analysis.procedures.results import Result, by_test
from analysis.procedures.shared.quantity import Quantity
from rigs.errors import FileError
from rigs.files import read_bytes
from rigs.text import counted

_UNPLACED_DEG = 15.0
"""Standard uncertainty beyond which no place is shown: ± 2 u would cover a sixth of the circle."""
_LARGEST_OF_NOISE = ("hysteresis_max_deg", "hysteresis_max_mm")
_BEYOND = 4.0
"""Multiple of u beyond which two eccentricities contradict each other. Chosen: odds of 10 000 to 1."""


_MOST_BYTES = 1_000_000
_REMEDY = "give the truth.json that rig emulate wrote"


@dataclass(frozen=True)
class TruthComparison:
    """deviation_u: deviation in standard uncertainties."""

    truth: float
    deviation_u: float


def compare(results: Sequence[Result], path: Path) -> list[dict[str, TruthComparison]]:
    """Raises FileError if the file is not the truth of these runs. Results without a truth have no comparisons."""
    try:
        truth = json.loads(read_bytes(path, _MOST_BYTES))
        comparisons = []
        for result in results:
            manifest = result.measured.run.manifest
            if truth["rig"] != manifest.rig_name:
                raise KeyError(manifest.rig_name)
            values = truth[manifest.test][manifest.direction] if manifest.test in truth else {}
            figures = ((name, result.figures[name], float(value)) for name, value in values.items())
            comparisons.append(
                {name: TruthComparison(true, (seen.value - true) / seen.u) for name, seen, true in figures}
            )
    except OSError as error:
        raise FileError.of_os(path, error, _REMEDY, code="file.unreadable") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise FileError(str(path), "is not the truth of these runs", _REMEDY, code="runs.not_comparable") from None
    if not any(comparisons):
        problem = f"does not cover the {results[0].test} test"
        raise FileError(str(path), problem, "leave --truth out", code="runs.not_comparable")
    return comparisons


@dataclass(frozen=True)
class Column:
    """Figures by name under a title, and a line below some of them: sd between runs, or the truth."""

    title: str
    figures: Mapping[str, Quantity]
    below: Mapping[str, str]


def columns_of(group: Sequence[Result], texts: Texts) -> list[Column]:
    """The mean of repeated runs, each other run, and the comparison of both directions."""
    columns = []
    for column in figure_columns(group):
        title = texts("acw_against_cw") if column.kind == "pairs" else column.direction
        key = "mean_of_runs" if column.kind == "mean" else "pairs"
        note = column.run if column.kind == "run" else texts(key, count=column.count)
        below = {name: f"{texts('sd')} {sd}" for name, sd in column.sd.items()}
        columns.append(Column(joined([title, note], ", "), column.figures, below))
    return columns


def figure_table(columns: Sequence[Column], texts: Texts, *more: tuple[str, ...]) -> Table:
    rows = list[Row]()
    names = in_order(name for column in columns for name in column.figures)
    for name in names:
        cells = []
        for column in columns:
            figure = column.figures.get(name)
            is_unplaced = figure and name.endswith("_at_deg") and not figure.u < _UNPLACED_DEG
            text = texts("no_place") if is_unplaced else figure_in_words(name, figure) if figure else ""
            cells.append(Cell(text, (column.below.get(name, "") if figure and text == str(figure) else "",)))
        rows.append((texts.label(name), *cells))
    ranks = (*("unusual" if name in LEADING else "" for name in names), *[""] * len(more))
    titles = (texts("value_and_u"), *(column.title for column in columns))
    return Table(titles, (*rows, *more), range(1, len(titles)), ranks, "stack")


def runs_answer(
    results: Sequence[Result], truths: Sequence[dict[str, TruthComparison]] = (), *, each: bool = False
) -> list[Block]:
    """each: add a table with a column for each run, as truths always do."""
    blocks = list[Block]()
    truth_of = {id(result): truth for result, truth in zip(results, truths, strict=False)}
    for group in by_test(results):
        repeated = any(means.figures for means in pooled(group))
        blocks.append(Heading(f"{group[0].measured.rig.name} · {ENGLISH.test(group[0].test)}"))
        if not truths:
            columns = columns_of(group, ENGLISH)
            blocks.append(figure_table(columns, ENGLISH, *([] if repeated else _facts(group, len(columns)))))
        if truths or (each and repeated):
            columns = []
            for result in group:
                below = {
                    name: f"truth {result.figures[name].rounded(one.truth)} ({one.deviation_u:+z.1f}u)"
                    for name, one in truth_of.get(id(result), {}).items()
                    if name in result.figures
                }
                columns.append(Column(f"{result.title}, {result.name}", result.figures, below))
            blocks.append(figure_table(columns, ENGLISH, *_facts(group, len(columns))))
        hint = "; --each shows the single runs" if repeated and not each else ""
        first, *remarks = remarks_of(group)
        blocks += paragraphs((first + hint, *remarks), "note")
    if truths:
        agree = [abs(one.deviation_u) <= 2 for by_name in truths for one in by_name.values()]
        verdict = f"{sum(agree)} of {len(agree)} figures agree with the truth within 2 u"
        blocks.append(Sentence(verdict, "pass" if all(agree) else "fail"))
    doubts = [doubt for group in by_test(results) for doubt in doubts_of(group)]
    return [*blocks, *paragraphs(doubt_lines(doubts, with_title=True), "doubt")]


def _facts(group: Sequence[Result], columns: int) -> list[tuple[str, ...]]:
    rows = [("samples", *(f"{result.found.samples}" for result in group))]
    if any(result.measured.u_lag_s for result in group):  # uncertainty of the time of the gauges relative to the robot
        rows.append(("time, gauges to robot", *(f"± {result.measured.u_lag_s * 1e3:.1f} ms" for result in group)))
    return [(*row, *[""] * (columns - len(group))) for row in rows]


def remarks_of(group: Sequence[Result]) -> list[str]:
    return [what_u_is(group), *_lag_lines(group), *eccentricities_in_words(group), *_warmth_lines(group)]


def what_u_is(group: Sequence[Result]) -> str:
    repeated = [means for means in pooled(group) if means.figures]
    if not repeated:
        return ONE_RUN
    runs = " and ".join(f"{len(mean.runs)} {mean.title} runs" for mean in repeated)
    means = f"mean of {runs} ± standard uncertainty of the mean; sd: standard deviation between the runs"
    titles = dict.fromkeys(result.title for result in group)
    single = [title for title in titles if title not in {mean.title for mean in repeated}]
    return f"{means}; {' and '.join(single)}: {ONE_RUN}" if single else means


def figure_in_words(name: str, figure: Quantity | BetweenRuns) -> str:
    """A largest hysteresis below u is noise, and shown as the bound u."""
    value = figure.mean if isinstance(figure, BetweenRuns) else figure
    if name in _LARGEST_OF_NOISE and value.value < value.u < np.inf:
        return f"≤ {value.rounded_u} {value.sign}"
    return str(figure)


def eccentricities_in_words(group: Sequence[Result]) -> list[str]:
    apart_um = 0.0
    for result in group:
        angle, distance = (result.figures.get(f"{by}eccentricity_mm") for by in ("", "distance_"))
        if angle and distance and abs(angle.value - distance.value) > _BEYOND * np.hypot(angle.u, distance.u):
            apart_um = max(apart_um, 1000 * abs(angle.value - distance.value))
    words = f"the two estimates of the ball's place, by angle and by distance, differ by {apart_um:.0f} µm: take this "
    return [f"{words}as the uncertainty of the place"] if apart_um else []


def _lag_lines(group: Sequence[Result]) -> list[str]:
    driven, both = group[0].found, pairs_of(group)
    if not isinstance(driven, CircleResult):
        return []
    if both is None:
        return ["a single direction cannot show a lag between gauges and robot: analyse acw and cw together"]
    if (lag := both.lag) is None:
        return list(both.refused)
    line = f"no significant lag between gauges and robot: {lag}"
    if abs(lag.value) >= 2 * lag.u:
        off_deg = np.degrees(abs(driven.curve.rate * lag.value) / 1000)
        line = (
            f"the gauges lag the robot by {lag}: the shifts of acw and cw are off by {off_deg:.2g}° in opposite "
            "directions, which their u does not include; describe the gauge by `timing` in the rig file, or run rig "
            "diagnose"
        )
    return [*both.refused, line]


def _warmth_lines(group: Sequence[Result]) -> list[str]:
    lines = []
    for result in group:
        if warmth := result.measured.condition.warmth:
            means, rises = ([getattr(warming, key) for warming in warmth.values()] for key in ("mean_c", "rise_c"))
            most = max(rises, key=abs)
            line = f"{result.title}, {result.name}: joints {min(means):.1f} to {max(means):.1f} °C in the mean"
            lines.append(f"{line}; axis {list(warmth)[rises.index(most)]} changed by {most:+z.1f} °C within the run")
    return lines


def doubts_of(group: Sequence[Result]) -> list[tuple[Result, str]]:
    doubts = [(result, doubt) for result in group for doubt in result.doubts]
    return doubts + [(result, why) for means in pooled(group) for result, why in means.left_out]


def doubt_lines(doubts: Sequence[tuple[Result, str]], *, with_title: bool = False) -> list[str]:
    """Each doubt with its runs. Doubts that differ only in figures appear once."""
    alike: dict[str, dict[str, list[str]]] = {}
    for result, doubt in doubts:
        run = f"{result.title}, {result.name}" if with_title else result.name
        alike.setdefault(_FIGURE.sub("0", doubt), {}).setdefault(doubt, []).append(run)
    lines = []
    for runs_of_doubt in alike.values():
        (doubt, runs), *others = runs_of_doubt.items()
        count = sum(len(runs) for _, runs in others)
        similar = f" (similar in {counted(count, 'more run')})" if count else ""
        lines.append(f"{', '.join(runs)}{similar}: {doubt}")
    return lines


_FIGURE = re.compile(r"-?\d+\.\d+")


def as_object(results: Sequence[Result], truths: Sequence[dict[str, TruthComparison]] = ()) -> dict[str, Any]:
    runs = [result.to_dict() for result in results]
    for run, truth in zip(runs, truths, strict=False):
        run["truth"] = truth
    groups = by_test(results)
    return {
        "runs": runs,
        "between_runs": [_pooled_object(runs_mean) for group in groups for runs_mean in pooled(group)],
        "remarks": [what_u_is(group) for group in groups],
        "acw_against_cw": [
            {
                "rig": group[0].measured.rig.name,
                "test": group[0].test,
                "runs": [result.measured.path for acw_and_cw in both.runs for result in acw_and_cw],
                "figures": {name: _between_object(figure) for name, figure in both.figures.items()},
                "lag": both.lag,
                "refused": both.refused,
            }
            for group in groups
            if (both := pairs_of(group))
        ],
    }


def _pooled_object(runs_mean: Pooled) -> dict[str, Any]:
    every = runs_mean.runs or tuple(result for result, _ in runs_mean.left_out)
    return {
        "rig": every[0].measured.rig.name,
        "test": every[0].test,
        "direction": every[0].measured.run.manifest.direction,
        "runs": [result.measured.path for result in runs_mean.runs],
        "left_out": {str(result.measured.path): why for result, why in runs_mean.left_out},
        "figures": {name: _between_object(figure) for name, figure in runs_mean.figures.items()},
    }


def _between_object(figure: BetweenRuns | Quantity) -> Quantity | dict[str, Any]:
    if isinstance(figure, Quantity):
        return figure
    return asdict(figure.mean) | {"sd_between_runs": figure.sd, "runs": figure.runs}

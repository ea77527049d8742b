"""The figures of entries as tables of markdown."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from tests.trials.ground.score import Figure, Scores

Entries = Mapping[str, Scores]


def markdown(entries: Entries) -> str:
    """Tables of accuracy and uncertainty, an entry a column."""
    honest = [[row, *(honesty(scores[row]) for scores in entries.values())] for row in rows_of(entries)]
    return "\n".join([
        "Accuracy: rms of the error in µm at poses that were not given.", "", accuracy(entries, rows_of(entries)), "",
        "Uncertainty: rms of error over stated u (1 where u is true; above, too sure), share within 2 u.", "",
        table(["task", *entries], honest),
    ])  # fmt: skip


def any_scores(entries: Entries) -> Scores:
    """Scores of one entry; all have the same rows."""
    return next(iter(entries.values()))


def rows_of(entries: Entries) -> list[str]:
    return list(any_scores(entries))


def accuracy(entries: Entries, rows: list[str]) -> str:
    """Table of errors, with that of the nominal arm."""
    lines = []
    for row in rows:
        nominal = any_scores(entries)[row]["nominal_um"]
        lines.append([row, str(nominal.of), f"{nominal.value:.0f}", *(erred(own[row]) for own in entries.values())])
    return table(["task", "test poses", "nominal", *entries], lines)


def erred(own: Mapping[str, Figure]) -> str:
    """Error of an entry; what it did not answer counts as the nominal arm's, and is told."""
    if own["answered"].value == 0:
        return "not entered"
    left = "" if own["answered"].value == 1 else f", {100 * own['answered'].value:.0f} % answered"
    return interval(own["error_um"], lambda value: f"{value:.0f}") + left


def honesty(own: Mapping[str, Figure]) -> str:
    """Return how true the stated u of an entry is."""
    ratio, within = own["error_over_u"], own["within_2u"]
    if not ratio.of:
        return "–"
    return f"{interval(ratio, lambda value: f'{value:.2f}')}; {100 * within.value:.0f} %"


def interval(one: Figure, told: Callable[[float], str]) -> str:
    return "–" if math.isnan(one.value) else f"{told(one.value)} ({told(one.low)} … {told(one.high)})"


def table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)

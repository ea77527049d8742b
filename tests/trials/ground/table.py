"""The figures of entries as tables of markdown, and as one picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from tests.trials.ground.score import Figure, Scores

Entries = Mapping[str, Scores]
COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple", "tab:brown")


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


def draw(entries: Entries, path: Path) -> None:
    """Draw what each entry leaves of the nominal error, task by task, and how true its u is."""
    import matplotlib.pyplot as plt  # noqa: PLC0415 - slow to import
    from matplotlib.ticker import NullLocator, ScalarFormatter  # noqa: PLC0415

    rows = rows_of(entries)
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(11, 1 + 0.5 * len(rows)), width_ratios=(3, 2), sharey=True, layout="constrained"
    )
    at = np.arange(len(rows))[::-1].astype(float)
    nominal = [any_scores(entries)[row]["nominal_um"].value for row in rows]
    left.plot(nominal, at, "|", color="0.4", markersize=14, label="nominal arm")
    for k, (entry, scores) in enumerate(entries.items()):
        y = at + 0.13 * (len(entries) / 2 - 0.5 - k)
        for axes, name in ((left, "error_um"), (right, "error_over_u")):
            known = [scores[row][name] for row in rows]
            shown = [j for j, one in enumerate(known) if one.of and scores[rows[j]]["answered"].value > 0]
            value = np.array([[known[j].low, known[j].value, known[j].high] for j in shown]).reshape(-1, 3)
            axes.errorbar(
                value[:, 1], y[shown], xerr=np.maximum(np.abs(value[:, 1:2] - value[:, [0, 2]]).T, 0), fmt="o",
                markersize=4, capsize=2, color=COLOURS[k % len(COLOURS)], label=entry if axes is left else None,
            )  # fmt: skip
    left.set(xlabel="error at poses that were not given, µm rms", yticks=at, yticklabels=rows)
    right.axvline(1, color="0.6", linestyle="--", linewidth=1)
    right.set(xlabel="error over stated u, rms (1: u is true)")
    for axes, ticks in ((left, (20, 50, 100, 200, 500, 1000, 2000, 5000)), (right, (0.25, 0.5, 1, 2, 4))):
        axes.set_xscale("log")
        low, high = axes.get_xlim()
        axes.set_xticks([tick for tick in ticks if low < tick < high], minor=False)
        axes.xaxis.set_major_formatter(ScalarFormatter())
        axes.xaxis.set_minor_locator(NullLocator())
        axes.grid(color="0.9", axis="x")
    figure.legend(frameon=False, loc="outside upper center", ncols=len(entries) + 1)
    figure.savefig(path, dpi=100)
    plt.close(figure)

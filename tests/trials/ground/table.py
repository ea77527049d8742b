"""The figures of entries as tables of markdown."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from tests.support import trial
from tests.trials.ground.score import Figure, Scores

Entries = Mapping[str, Scores]


def markdown(entries: Entries) -> str:
    """Tables of accuracy and uncertainty, an entry a column. All entries have the same rows."""
    errors, honest = [], []
    for row, first in next(iter(entries.values())).items():
        nominal = first["nominal_um"]
        own = [scores[row] for scores in entries.values()]
        errors.append([row, nominal.of, f"{nominal.value:.0f}", *map(erred, own)])
        honest.append([row, *map(honesty, own)])
    return "\n".join([
        "Accuracy: rms of the error in µm at poses that were not given.", "",
        trial.markdown(["task", "test poses", "nominal", *entries], errors), "",
        "Uncertainty: rms of error over stated u (1 where u is true; above, too sure), share within 2 u.", "",
        trial.markdown(["task", *entries], honest),
    ])  # fmt: skip


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

"""Stated probabilities against the truth: reliability table, Brier score, diagram, and the fit of the calibration.

`scripts/dev stated_odds KEEP… --picture odds.png` reads the answers that `blind`, `unknown` and `known_faults` left in
their directories `--keep`. With `--fit FILE` it fits the probability of a name to its log odds, and writes the
calibration that rig uses.
"""

from __future__ import annotations

import json
import math
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from tests.support.rates import wilson
from tests.support.trial import Trial, main, markdown
from tests.trials.blind.answers import answer_of
from tests.trials.blind.scoring import RealCase
from tests.trials.unknown.judging import truth_of_name
from tests.worlds.unknown.arms import Array
from tests.worlds.unknown.cells import draw_cell
from tests.worlds.unknown.faults import draw_faulty

EDGES = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Limits of the classes of stated probabilities."""
READINGS = {"circle": "circles", "pose": "poses", "touch": "touches"}
_RIDGE = 1e-3
"""Precision of both parameters that keeps them finite if the classes separate."""


@dataclass(frozen=True)
class Stated:
    """A name of an answer with its stated probability. world: `unknown` if the cell has a cause that rig does not
    know, otherwise `known`. log_odds: before the calibration, None for names of usual size or if not stated.
    """

    world: str
    readings: str
    cell: str
    seed: int
    name: str
    probability: float
    log_odds: float | None
    is_right: bool


# --- names of kept answers


def stated_in(root: Path) -> list[Stated]:
    """Names of all answers in a directory of a trial. Names of a cause that is related to the truth are omitted."""
    return [*_of_blind_trial(root), *_of_unknown_trial(root)]


def _of_blind_trial(root: Path) -> Iterator[Stated]:
    for file in sorted(root.glob("cases/*/answer.json")):
        truth, answer = _read(root / "truth" / f"{file.parent.name}.json"), _read(file)
        case = RealCase(truth, answer_of(answer))
        cell = "unknown" if truth["outside"] else "known", "circles", file.parent.name, int(truth["seed"])
        listed = zip(case.answer.listed, answer.get("effects", ()), strict=True)
        yield from _stated(cell, ((effect, case.has(named)) for named, effect in listed))


def _of_unknown_trial(root: Path) -> Iterator[Stated]:
    for file in sorted(root.glob("cell-*/*/answer.json")):
        seed, variant = int(file.parts[-3].removeprefix("cell-")), file.parent.name
        drawn = draw_faulty(seed)[0] if variant == "faulty" else draw_cell(seed)
        cell = drawn.sound() if variant == "sound" else drawn
        world = "known" if cell.cause is None else "unknown"
        truth = {"right": True, "wrong": False, "related": None}
        effects = _read(file).get("effects") or []
        judged = ((effect, truth[truth_of_name(cell, effect)]) for effect in effects)
        yield from _stated((world, READINGS[cell.test], f"{variant} {seed}", seed), judged)


def _stated(cell: tuple[str, str, str, int], judged: Iterator[tuple[Any, bool | None]]) -> Iterator[Stated]:
    for effect, is_right in judged:
        if is_right is not None and effect.get("posterior") is not None:
            # The decision is about faults: effects of usual size do not determine the calibration.
            log_odds = effect.get("log_odds") if effect.get("doubt") != "usual" else None
            yield Stated(*cell, effect["name"], effect["posterior"], log_odds, is_right)


def _read(file: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return content


# --- table and diagram


@dataclass(frozen=True)
class Class:
    """Names whose stated probability is in (low, high]. stated: mean of the stated probabilities, NaN without names."""

    low: float
    high: float
    stated: float
    names: int
    right: int

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share of right names."""
        return wilson(self.right, self.names)


def classes_of(names: Sequence[Stated]) -> list[Class]:
    found = []
    for low, high in pairwise(EDGES):
        own = [one for one in names if low < one.probability <= high or one.probability == low == 0]
        stated = sum(one.probability for one in own) / len(own) if own else math.nan
        found.append(Class(low, high, stated, len(own), sum(one.is_right for one in own)))
    return found


def brier_score(names: Sequence[Stated]) -> float:
    """Mean squared difference of probability and truth (Brier 1950): 0 is perfect, 0.25 is a coin."""
    return float(np.mean([(one.probability - one.is_right) ** 2 for one in names]))


def parts_of(names: Sequence[Stated]) -> dict[str, list[Stated]]:
    """All names, and those of each world and kind of readings."""
    parts = {"all": list(names)}
    for one in sorted(names, key=lambda one: (one.world, one.readings)):
        parts.setdefault(f"{one.world} causes, {one.readings}", []).append(one)
    return parts


def table(names: Sequence[Stated]) -> str:
    rows = []
    for part, own in parts_of(names).items():
        for one in classes_of(own):
            if one.names:
                low, high = one.interval
                right = f"{one.right} of {one.names} ({100 * low:.0f} … {100 * high:.0f} %)"
                bounds = f"{100 * one.low:g} … {100 * one.high:g} %"
                inside = "yes" if low <= one.stated <= high else "no"
                rows.append([part, bounds, f"{100 * one.stated:.1f} %", right, inside])
        rows.append(
            [part, "Brier score", f"{brier_score(own):.3f}", f"{sum(n.is_right for n in own)} of {len(own)}", ""]
        )
    return markdown(["names", "stated", "mean", "right", "mean in the interval"], rows)


def draw_diagram(names: Sequence[Stated], file: Path) -> None:
    """Draw the share of right names over the stated probability, with binomial 95 % intervals."""
    import matplotlib.pyplot as plt  # noqa: PLC0415 - slow to import

    figure, panels = plt.subplots(1, 2, figsize=(10, 5), sharey=True, layout="constrained")
    for axes, world in zip(panels, ("known", "unknown"), strict=True):
        axes.plot([0, 100], [0, 100], color="0.6", linestyle="--", linewidth=1, label="as often as stated")
        for k, readings in enumerate(READINGS.values()):
            own = [one for one in names if (one.world, one.readings) == (world, readings)]
            shown = [one for one in classes_of(own) if one.names]
            if not shown:
                continue
            stated = 100 * np.array([one.stated for one in shown]) + (k - 1)  # side by side
            right = 100 * np.array([one.right / one.names for one in shown])
            low, high = 100 * np.array([one.interval for one in shown]).T
            label = f"{readings} ({len(own)} names)"
            error = np.maximum([right - low, high - right], 0)  # rounded, the interval may end short of 0 or 100 %
            axes.errorbar(stated, right, error, fmt="o^s"[k], capsize=3, label=label)
        axes.set(xlim=(-2, 103), ylim=(-2, 103), title=f"{world} causes", xlabel="stated probability in %, class mean")
        axes.legend(loc="upper left", frameon=False)
        axes.grid(color="0.9")
    panels[0].set_ylabel("share of right names in %, with 95 % interval")
    figure.savefig(file, dpi=110)
    plt.close(figure)


# --- calibration


def fitted_calibration(names: Sequence[Stated]) -> tuple[float, float]:
    """Intercept and slope of the logistic function that is most likely for these names (Platt 1999)."""
    used = [(one.log_odds, one.is_right) for one in names if one.log_odds is not None]
    A = np.array([[1.0, log_odds] for log_odds, _ in used])
    is_right = np.array([right for _, right in used], dtype=float)

    def loss(x: Array) -> float:
        return float(np.logaddexp(0, A @ x).sum() - is_right @ A @ x + _RIDGE / 2 * x @ x)

    intercept, slope = minimize(loss, np.zeros(2), tol=1e-12).x
    return float(intercept), float(slope)


def with_calibration(names: Sequence[Stated], file: Path) -> list[Stated]:
    """Names with the probabilities of a calibration in place of those that were stated."""
    content = _read(file)
    intercept, slope = float(content["intercept"]), float(content["slope"])
    return [
        replace(one, probability=1 / (1 + math.exp(-intercept - slope * one.log_odds)))
        for one in names
        if one.log_odds is not None
    ]


def write_calibration(names: Sequence[Stated], file: Path) -> None:
    """Fit the calibration, and write it with its origin."""
    used = [one for one in names if one.log_odds is not None]
    if len({one.is_right for one in used}) < 2:
        raise SystemExit("error: --fit needs right and wrong names with log odds")
    intercept, slope = fitted_calibration(used)
    seeds = sorted(one.seed for one in used)
    content = {
        "origin": "scripts/dev stated_odds --fit",
        "date": date.today().isoformat(),
        "seeds": [seeds[0], seeds[-1]],
        "cells": len({one.cell for one in used}),
        "names": len(used),
        "intercept": round(intercept, 4),
        "slope": round(slope, 4),
    }
    file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def draw(given: Namespace) -> Iterator[Namespace]:
    yield given


def judged(given: Namespace) -> str:
    names = [one for root in given.keep for one in stated_in(Path(root))]
    if given.calibration:
        names = with_calibration(names, given.calibration)
    if not names:
        return "no names"
    if given.picture:
        draw_diagram(names, given.picture)
    if given.fit:
        write_calibration(names, given.fit)
    return table(names)


TRIAL = Trial(
    draw,
    judged,
    options={
        "KEEP": ([], "directories that were given to those trials as --keep"),
        "picture": (Path, "write the reliability diagram to this PNG file"),
        "calibration": (Path, "judge the probabilities by this calibration, not those of the answers"),
        "fit": (Path, "fit the calibration to these names, and write it to this JSON file"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

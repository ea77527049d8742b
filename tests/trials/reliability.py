"""The table of a blind trial in the real world, and its reliability diagram, from kept results."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.support.rates import wilson
from tests.support.trial import Trial, main
from tests.trials.blind.scoring import Odds, RealCase, real_cases_of, real_report, reliability


def draw(given: Namespace) -> Iterator[tuple[list[Path], Path | None]]:
    yield [Path(root) for root in given.keep], given.picture


def judged(case: tuple[list[Path], Path | None]) -> str:
    roots, picture = case
    cases = [one for root in roots for one in kept_cases(root)]
    if picture:
        draw_odds(reliability(cases), picture)
    return f"{len(cases)} cases\n{real_report(cases)}"


def kept_cases(root: Path) -> list[RealCase]:
    """Cases of a directory that were answered."""
    answers = {file.parent.name: _read(file) for file in sorted(root.glob("cases/*/answer.json"))}
    truths = [_read(root / "truth" / f"{name}.json") for name in answers]
    return real_cases_of(truths, answers)


def _read(file: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return content


def draw_odds(bins: Sequence[Odds], file: Path) -> None:
    """Draw the share of right names against the mean of the stated odds, with binomial 95 % intervals."""
    import matplotlib.pyplot as plt  # noqa: PLC0415 - slow to import

    told = [one for one in bins if one.names]
    odds = 100 * np.array([one.told for one in told])
    right = 100 * np.array([one.right / one.names for one in told])
    low, high = 100 * np.array([wilson(one.right, one.names) for one in told]).reshape(-1, 2).T
    figure, axes = plt.subplots(figsize=(6, 5.5), layout="constrained")
    axes.plot([0, 100], [0, 100], color="0.6", linestyle="--", linewidth=1, label="right as often as stated")
    axes.errorbar(odds, right, [right - low, high - right], fmt="o", color="tab:blue", capsize=4, label="this trial")
    for x, y, one in zip(odds, right, told, strict=True):
        label = f"{one.right} of {one.names}"
        axes.annotate(label, (x, y), xytext=(-8, -4), textcoords="offset points", ha="right", fontsize=9)
    axes.set(xlim=(40, 103), ylim=(0, 103), xlabel="stated odds of a name in %, mean of each class")
    axes.set_ylabel("share of names that are right in %, with 95 % interval")
    axes.legend(loc="lower right", frameon=False)
    axes.grid(color="0.9")
    figure.savefig(file, dpi=110)
    plt.close(figure)


TRIAL = Trial(
    draw,
    judged,
    options={
        "KEEP": ([], "the directories that were given to the blind trial as --keep"),
        "picture": (Path, "write the diagram to this PNG file"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

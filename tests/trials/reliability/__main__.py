"""The table of a blind trial in the real world, and its reliability diagram, from kept results."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.trials.blind.real_scoring import Odds, RealCase, real_cases_of, real_report, reliability
from tests.trials.blind.scoring import wilson


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="scripts/dev reliability",
        description="Print the table of `scripts/dev blind --world real --keep DIR`, as far as it has come, and draw "
        "how often names were right against the odds that were stated.",
    )
    parser.add_argument("keep", nargs="+", type=Path, help="the directories that were given as --keep")
    parser.add_argument("--picture", type=Path, help="write the diagram to this PNG file")
    return parser.parse_args()


def main() -> None:
    given = arguments()
    cases = [case for root in given.keep for case in kept_cases(root)]
    print(f"{len(cases)} cases")
    print(real_report(cases))
    if given.picture:
        draw(reliability(cases), given.picture)


def kept_cases(root: Path) -> list[RealCase]:
    """Return the cases of a directory that were answered."""
    answers = {file.parent.name: _read(file) for file in sorted(root.glob("cases/*/answer.json"))}
    truths = [_read(root / "truth" / f"{name}.json") for name in answers]
    return real_cases_of(truths, answers)


def _read(file: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return content


def draw(bins: Sequence[Odds], file: Path) -> None:
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


if __name__ == "__main__":
    main()

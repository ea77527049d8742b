"""First line and tiles of twenty diagnoses, for a reader who says what to do tomorrow.

`scripts/dev first_lines` prints them in random order without the truth; `--key` adds truth and right act of each for
the judge. Goal: a reader who knows nothing of the cases is right in 18 of 20.
"""

from __future__ import annotations

import argparse

import numpy as np
from rich.console import Console

from analysis import diagnose
from analysis.apps.report.blocks import on_screen
from analysis.apps.report.diagnosis_answer import summary_blocks
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import LANGUAGES, texts_of
from tests.trials.first_lines.cases import drawn


def main() -> None:
    """Print the cases."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="of the cells and of their order (1)")
    parser.add_argument("--key", action="store_true", help="print the truth and the right act as well")
    parser.add_argument("--lang", choices=LANGUAGES, default="en", help="language (en)")
    given = parser.parse_args()
    texts, console = texts_of(given.lang), Console(width=100, highlight=False)
    cases = list(drawn(given.seed))
    for number, k in enumerate(np.random.default_rng(given.seed).permutation(len(cases)), 1):
        case, cell = cases[k]
        found = diagnose(cell.runs, rig=cell.rig, unseen=cell.unseen, tolerance_um=cell.tolerance_um)
        console.rule(str(number))
        console.print(on_screen(summary_blocks(summarise(found, texts), texts)))
        if given.key:
            console.print(f"\n[dim]{case.name}: {case.truth}. Right: {case.tomorrow}.")


if __name__ == "__main__":
    main()

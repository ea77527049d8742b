"""Tables of poses as others write them: which are imported without a word, with one question, or not."""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import get_args

from tests.support import drawn_tables
from tests.support.foreign_tables import Foreign, drawn, foreign_tables, in_format, tried
from tests.support.trial import Trial, main, markdown

Result = tuple[str, str, str]
"""Group, outcome, and the line about the file."""


Case = Foreign | tuple[int, drawn_tables.Drawn]


def draw(given: Namespace) -> Iterator[Case]:
    """Drawn files alone, or the tables of others and drawn poses in every format."""
    if given.files:
        for seed in range(given.seed, given.seed + given.files):
            yield seed, drawn_tables.drawn(seed, new=given.new)
        return
    yield from (foreign for foreign in foreign_tables() if foreign.is_here)
    for seed in range(given.drawn):
        rig, poses = drawn(seed)
        yield from in_format(poses, rig)


def imported(case: Case) -> Result:
    with tempfile.TemporaryDirectory(prefix="rig-tables-") as folder:
        if isinstance(case, Foreign):
            done = tried(case, Path(folder))
            outcome = f"{done.outcome}, wrong in silence: {done.wrong}" if done.wrong else done.outcome
            return "measured" if case.real else "in the format", outcome, f"{case.words}: {outcome}"
        seed, file = case
        judged = drawn_tables.judged(file, Path(folder))
    outcome = "wrong in silence" if judged.wrong else judged.outcome
    is_told = judged.wrong or "answer" in outcome or (file.sound and judged.outcome == "refused")
    last = (judged.lines.strip().splitlines() or [""])[-1]
    line = f"  {seed}, {file.arm}, {file.exporter}, {file.trouble}: {outcome}: {judged.wrong or last}"
    return file.trouble, outcome, line * bool(is_told)


def report(done: Sequence[Result]) -> str:
    """Files by group and outcome."""
    counts = Counter((group, outcome) for group, outcome, _ in done)
    known = (*get_args(drawn_tables.Outcome), "wrong in silence")
    outcomes = dict.fromkeys(
        [*(one for one in known if any(one == own for _, own, _ in done)), *(own for _, own, _ in done)]
    )
    rows = [
        [group, *(counts[group, outcome] for outcome in outcomes)] for group in sorted({group for group, *_ in done})
    ]
    total = ["all", *(sum(counts[group, outcome] for group, *_ in rows) for outcome in outcomes)]
    return markdown(["", *outcomes], [*rows, total])


TRIAL = Trial(
    draw,
    imported,
    report,
    line=lambda one: one[2],
    options={
        "drawn": (0, "sets of few or many poses in every format (0)"),
        "files": (0, "drawn files of every exporter and trouble alone (0)"),
        "new": (False, "draw them with the added troubles and exporters"),
        "seed": (0, "of the first of these files (0)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

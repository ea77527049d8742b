"""Every next line and remedy that rig prints on the golden cells, followed: lines, ends, and which are dead."""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

from tests.support.measured_series import DATA
from tests.support.trial import Trial, main
from tests.trials.next_lines.next_line_cases import HintCase, cases, followed
from tests.trials.next_lines.next_lines import Followed, table


def draw(given: Namespace) -> Iterator[HintCase]:
    for case in cases(given.data):
        if (not given.names or case.name in given.names) and (case.quick or not given.quick):
            yield case


def judged(case: HintCase) -> tuple[str, Followed]:
    with tempfile.TemporaryDirectory() as work:
        return case.name, followed(case, Path(work))


TRIAL = Trial(
    draw, judged, lambda done: table(dict(done)), line=lambda one: f"{one[0]}: {one[1]}",
    failed=lambda done: any(one.dead for _, one in done),
    options={
        "NAMES": ([], "cases to follow (all)"),
        "quick": (False, "those alone that each commit follows"),
        "data": (DATA, "the folder of measured data (../shared/data)"),
    },
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main(TRIAL))

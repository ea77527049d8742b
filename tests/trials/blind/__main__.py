"""The blind trial of `rig diagnose`: effects hidden by a generator that shares no code with rig.

Seeds below 90000 are for development. A report uses others, never looked at before; say which. Ctrl-C prints what
there is; with `--keep` the same command goes on.
"""

from __future__ import annotations

import json
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from tests.support.trial import Trial, main, seeds
from tests.trials.blind.scoring import real_cases_of, real_report
from tests.trials.blind.trial import Job, answered, make_case
from tests.worlds.stranger import REAL_KINDS

Result = tuple[Job, dict[str, Any]]


def draw(given: Namespace) -> Iterator[tuple[Job, Namespace]]:
    """Cases of each kind in turn, in a directory that is kept or goes at the end."""
    kinds = given.kinds.split(",")
    if unknown := set(kinds) - set(REAL_KINDS):
        raise SystemExit(f"error: no such kind: {', '.join(sorted(unknown))}; known are {', '.join(REAL_KINDS)}")
    with tempfile.TemporaryDirectory(prefix="rig-blind-") as root:
        for seed in seeds(given):
            yield from ((Job(kind, seed, given.keep or Path(root)), given) for kind in kinds)


def judged(case: tuple[Job, Namespace]) -> Result:
    job, given = case
    if given.generate_only:
        make_case(job)
        return job, {}
    return job, answered(job) | {"truth": json.loads(job.truth.read_text(encoding="utf-8"))}


def line(result: Result) -> str:
    job, answer = result
    return f"{job}: {answer.get('condition', answer.get('error', f'{job.case}, truth {job.truth}'))}"


def report(done: Sequence[Result]) -> str:
    answers = {job.name: answer for job, answer in done if answer}
    cases = real_cases_of([answer.pop("truth") for answer in answers.values()], answers)
    return f"{len(cases)} cases\n{real_report(cases)}" if cases else ""


TRIAL = Trial(
    draw, judged, report, line=line, count=20,
    options={
        "kinds": (",".join(REAL_KINDS), f"some of {','.join(REAL_KINDS)} (all)"),
        "generate_only": (False, "make the cases of --keep, diagnose nothing"),
        "keep": (Path, "a directory for cases, truths and answers; what is there is used again"),
    },
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main(TRIAL))

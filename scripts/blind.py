"""The blind trial: hidden effects by a generator that shares no code with rig, diagnosed and scored (scripts/blind)."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

from scoring import cases_of, report
from stranger import KINDS, SCALES
from trial import Job, run_all

FIRST_REPORTED = 10_000


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="scripts/blind",
        description="Generate cases of every kind, diagnose them blindly, print the figures to beat.",
        epilog=f"Seeds 0 to {FIRST_REPORTED - 1} are for development. A report uses seeds from {FIRST_REPORTED} on, "
        "never looked at before; say which. Ctrl-C prints what there is; with --keep, the same command goes on.",
    )
    parser.add_argument("--cases", type=int, default=20, help="of each kind (20); a report has 300")
    parser.add_argument("--seed", type=int, default=0, help="of the first case; the others follow (0)")
    parser.add_argument("--kinds", default=",".join(KINDS), help=f"some of {','.join(KINDS)} (all)")
    parser.add_argument("--scale", choices=SCALES, default=SCALES[0], help="what background and sizes are shares of")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument(
        "--keep", type=Path, help="a directory for cases, truths and answers; what is there is used again"
    )
    given = parser.parse_args()
    given.kinds = given.kinds.split(",")
    if unknown := set(given.kinds) - set(KINDS):
        parser.error(f"no such kind: {', '.join(sorted(unknown))}; known are {', '.join(KINDS)}")
    return given


def main() -> None:
    given = arguments()
    with nullcontext(given.keep) if given.keep else tempfile.TemporaryDirectory(prefix="rig-blind-") as root:
        trial(given, Path(root))


def trial(given: argparse.Namespace, root: Path) -> None:
    """Every case, then the table."""
    seeds = range(given.seed, given.seed + given.cases)
    jobs = [Job(kind, seed, given.scale, root) for seed in seeds for kind in given.kinds]
    answers: dict[str, dict[str, Any]] = {}
    begin = time.monotonic()
    with suppress(KeyboardInterrupt):
        for job, answer in run_all(jobs, given.jobs):
            answers[job.name] = answer
            said = answer.get("verdict", answer.get("error"))
            line = f"{len(answers)} of {len(jobs)} · {job.kind} {job.seed}: {said}"
            sys.stderr.write(f"\r\033[K{line[:110]}" if sys.stderr.isatty() else f"{line}\n")
    seconds = time.monotonic() - begin
    sys.stderr.write("\n" * sys.stderr.isatty())
    whose = "for development" if given.seed < FIRST_REPORTED else "for a report"
    told = jobs[: len(answers)]
    print(
        f"{len(told)} of {len(jobs)} cases, seeds {seeds.start} to {told[-1].seed if told else '-'} ({whose}), "
        f"scale {given.scale}, {seconds:.0f} s"
    )
    print(report(cases_of([json.loads(job.truth.read_text(encoding="utf-8")) for job in told], answers)))


if __name__ == "__main__":
    main()

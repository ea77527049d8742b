"""The blind trial of `rig diagnose`: effects hidden by a generator that shares no code with rig."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

from tests.trials.blind.real_scoring import as_json, real_cases_of, real_report
from tests.trials.blind.scoring import cases_of, report
from tests.trials.blind.trial import Job, make_case, run_all
from tests.worlds.stranger import KINDS, REAL_KINDS, SCALES

FIRST_REPORTED = 10_000
WORLDS = {"quiet": KINDS, "real": REAL_KINDS}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="scripts/dev blind",
        description="Generate cases of every kind, diagnose them blindly, print the figures to beat.",
        epilog=f"Seeds 0 to {FIRST_REPORTED - 1} are for development. A report uses seeds from {FIRST_REPORTED} on, "
        "never looked at before; say which. Ctrl-C prints what there is; with --keep, the same command goes on.",
    )
    parser.add_argument("--world", choices=WORLDS, default="quiet", help="a quiet cell, or cells as they are (quiet)")
    parser.add_argument("--cases", type=int, default=20, help="of each kind (20); a report has 200 or more")
    parser.add_argument("--seed", type=int, default=0, help="of the first case; the others follow (0)")
    known = "; ".join(f"{world}: {','.join(kinds)}" for world, kinds in WORLDS.items())
    parser.add_argument("--kinds", help=f"some of {known} (all)")
    parser.add_argument(
        "--scale", choices=SCALES, default=SCALES[0], help="quiet: what background and sizes are shares of"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes; 0: one on each core (1)")
    parser.add_argument("--generate-only", action="store_true", help="make the cases of --keep, diagnose nothing")
    parser.add_argument("--json", type=Path, help="real: write table and reliability data to this file too")
    parser.add_argument(
        "--keep", type=Path, help="a directory for cases, truths and answers; what is there is used again"
    )
    given = parser.parse_args()
    given.kinds = given.kinds.split(",") if given.kinds else list(WORLDS[given.world])
    if unknown := set(given.kinds) - set(WORLDS[given.world]):
        names = ", ".join(WORLDS[given.world])
        parser.error(f"no such kind in the {given.world} world: {', '.join(sorted(unknown))}; known are {names}")
    if given.generate_only and not given.keep:
        parser.error("--generate-only needs --keep DIR, where the cases go")
    if given.json and given.world != "real":
        parser.error("--json belongs to --world real")
    return given


def main() -> None:
    given = arguments()
    with nullcontext(given.keep) if given.keep else tempfile.TemporaryDirectory(prefix="rig-blind-") as root:
        trial(given, Path(root))


def trial(given: argparse.Namespace, root: Path) -> None:
    """Every case, then the table."""
    seeds = range(given.seed, given.seed + given.cases)
    jobs = [Job(kind, seed, given.scale, root, given.world) for seed in seeds for kind in given.kinds]
    answers: dict[str, dict[str, Any]] = {}
    begin = time.monotonic()
    with suppress(KeyboardInterrupt):
        if given.generate_only:
            for job, failed in run_all(jobs, given.jobs, make_case):
                made = failed["error"] if failed else f"{job.case}, truth {job.truth}"
                print(f"{job.kind} {job.seed}: {made}")
            return
        for job, answer in run_all(jobs, given.jobs):
            answers[job.name] = answer
            said = answer.get("condition", answer.get("error"))
            line = f"{len(answers)} of {len(jobs)} · {job.kind} {job.seed}: {said}"
            sys.stderr.write(f"\r\033[K{line[:110]}" if sys.stderr.isatty() else f"{line}\n")
    seconds = time.monotonic() - begin
    sys.stderr.write("\n" * sys.stderr.isatty())
    whose = "for development" if given.seed < FIRST_REPORTED else "for a report"
    told = jobs[: len(answers)]
    world = f"scale {given.scale}" if given.world == "quiet" else "real world"
    print(
        f"{len(told)} of {len(jobs)} cases, seeds {seeds.start} to {told[-1].seed if told else '-'} ({whose}), "
        f"{world}, {seconds:.0f} s"
    )
    print(scored(given, [json.loads(job.truth.read_text(encoding="utf-8")) for job in told], answers))


def scored(given: argparse.Namespace, truths: Sequence[dict[str, Any]], answers: dict[str, dict[str, Any]]) -> str:
    """The table of the world, and the file of it that was asked for."""
    if given.world == "quiet":
        return report(cases_of(truths, answers))
    cases = real_cases_of(truths, answers)
    if given.json:
        given.json.write_text(json.dumps(as_json(cases), indent=1) + "\n", encoding="utf-8")
    return real_report(cases)


if __name__ == "__main__":
    main()

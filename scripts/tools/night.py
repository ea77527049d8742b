"""Run everything that a commit does not: slow tests, storms, fuzz, benchmarks, LinuxCNC; at most three hours.

A failure does not end the night. The result of each part goes into docs/evidence/nightly.md, beside the one before, and
its output into dist/night.
"""

from __future__ import annotations

import argparse
import datetime as dt
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from scripts.tools.nightly import PAGE, ROOT, commit

LOGS = ROOT / "dist" / "night"
BEGIN, END = "<!-- parts of the night -->", "<!-- end of the parts -->"
_GRACE_S = 20.0
"""Time between the request to end and the end by force: a trial stops its daemons."""
_LONGEST_LINE = 90


def _needs_linuxcnc() -> str:
    if os.geteuid() != 0:
        return "not root, which installs and starts LinuxCNC"
    return "" if shutil.which("apt-get") else "not on Debian"


def _needs_booted() -> str:
    return "" if os.geteuid() == 0 and Path("/run/systemd/system").is_dir() else "not root under systemd"


def _needs_bench() -> str:
    return "" if (ROOT / ".venv-bench").is_dir() else "its packages are not installed: scripts/dev bench --help"


@dataclass(frozen=True)
class Part:
    """A part of the night. minutes: after them it is ended, and failed. missing: why it cannot run here, or ""."""

    name: str
    command: tuple[str, ...]
    minutes: float
    missing: Callable[[], str] = str


PARTS = (
    Part("slow tests: kill, power cut, hostile, browser", ("scripts/dev", "nightly", "--keep", "--hours", "1.2"), 85),
    Part("storm", ("scripts/dev", "storm", "480", "--jobs", "2"), 15),
    Part("fuzz", ("scripts/dev", "fuzz", "--inputs", "100000", "--files", "3000", "--jobs", "2"), 20),
    Part("golden answers", ("scripts/dev", "golden"), 10),
    Part("mutations of the code", ("scripts/dev", "mutants", "10"), 14),
    Part(
        "proving ground, a tiny one", ("scripts/dev", "ground", "run", "dist/night/ground", "--seed", "1", "--tiny"), 10
    ),
    Part("rooms removed", ("scripts/dev", "without", "certify", "pair", "paper", "window", "--quick"), 10),
    Part("pace", ("scripts/pace", "5", "--turns", "1"), 6),
    Part("benchmarks", ("scripts/bench",), 20, _needs_bench),
    Part("soak", ("scripts/soak", "--recording", "60", "--times", "30"), 5),
    Part("LinuxCNC", ("scripts/linuxcnc-cell", "dist/night/linuxcnc"), 20, _needs_linuxcnc),
    Part("service under systemd", ("scripts/dev", "booted"), 5, _needs_booted),
)
"""In this order: what finds most comes first."""


@dataclass(frozen=True)
class Outcome:
    part: str
    result: str
    """passed, failed, too long, or skipped."""
    minutes: float
    detail: str
    """Last line of the output, or the reason for a skipped part."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="WORD", help="run some parts; the others keep their row"
    )
    parser.add_argument("--hours", type=float, default=3.0, help="begin no part that would end later (3)")
    parser.add_argument("--list", action="store_true", help="print the parts and run none")
    given = parser.parse_args()
    parts = [part for part in PARTS if not given.only or any(word in part.name for word in given.only)]
    if given.list:
        for part in parts:
            print(f"{part.minutes:4.0f} min  {part.name}: {' '.join(part.command)}  {part.missing()}".rstrip())
        return 0
    outcomes = spend(parts, LOGS, time.monotonic() + 3600 * given.hours)
    page = PAGE.read_text(encoding="utf-8")  # after the parts: the slow tests have written their own result into it
    PAGE.write_text(page_with(page, outcomes, commit()), encoding="utf-8")
    return int(any(outcome.result in ("failed", "too long") for outcome in outcomes))


def spend(parts: Sequence[Part], logs: Path, ends_s: float) -> list[Outcome]:
    """Run the parts one after the other. A part that might end after `ends_s` is skipped."""
    logs.mkdir(parents=True, exist_ok=True)
    outcomes = []
    for part in parts:
        reason = part.missing()
        if not reason and time.monotonic() + 60 * part.minutes > ends_s:
            reason = "the night was over"
        outcomes.append(Outcome(part.name, "skipped", 0, reason) if reason else run(part, logs))
        print(f"{outcomes[-1].result:8} {part.name}: {outcomes[-1].detail}", flush=True)
    return outcomes


def run(part: Part, logs: Path) -> Outcome:
    log, began_s = logs / (re.sub(r"\W+", "-", part.name) + ".log"), time.monotonic()
    with log.open("wb") as out:
        child = subprocess.Popen(
            part.command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=True
        )
        try:
            result = "failed" if child.wait(60 * part.minutes) else "passed"
        except subprocess.TimeoutExpired:
            result = "too long"
        finally:
            _end(child)
    lines = log.read_text("utf-8", "replace").split("\n")
    last = next((line.strip() for line in reversed(lines) if line.strip()), "no output")
    return Outcome(part.name, result, (time.monotonic() - began_s) / 60, last[:_LONGEST_LINE])


def _end(child: subprocess.Popen[bytes]) -> None:
    """Stop the process group of a part: first SIGTERM, then SIGKILL. Does nothing if the part has exited."""
    for kind in (signal.SIGTERM, signal.SIGKILL):
        if child.poll() is not None:
            return
        os.killpg(child.pid, kind)
        try:
            child.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            continue


_COLUMNS = ["part", "result", "minutes", "of", "before", "last line, or reason"]


def rows_of(page: str) -> dict[str, list[str]]:
    """The cells of each part on the page."""
    rows = page.partition(BEGIN)[2].partition(END)[0].splitlines()
    cells = [[cell.strip() for cell in row.strip("|").split(" | ")] for row in rows if row.startswith("| ")]
    return {row[0]: row for row in cells[2:]}


def page_with(page: str, outcomes: Sequence[Outcome], state: str) -> str:
    """The page with the rows of these parts, each with the day, the commit and its result before; other parts keep
    theirs.
    """
    start, _, rest = page.partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise ValueError(f"{PAGE.name} has no marks {BEGIN} and {END}")
    rows, of = rows_of(page), f"{dt.datetime.now(tz=dt.UTC).date()}, {state}"
    for one in outcomes:
        before = rows.get(one.part)
        if before and one.result == "skipped":
            continue  # what it did last says more
        told = f"{before[1]}, {before[2]}" if before else "–"
        detail = one.detail.replace("|", "/")
        rows[one.part] = [one.part, one.result, f"{one.minutes:.0f}", of, told, f"`{detail}`"]
    table = [_COLUMNS, ["---"] * len(_COLUMNS), *rows.values()]
    lines = [f"| {' | '.join(row)} |" for row in table]
    return f"{start}{BEGIN}\n\n" + "\n".join(lines) + f"\n\n{END}{after}"


if __name__ == "__main__":
    sys.exit(main())

"""Run the tests marked `nightly`, which have more cases than the tests of each commit."""

from __future__ import annotations

import argparse
import datetime as dt
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.support.durations import Durations, durations
from tests.support.nightly import NIGHT_IS_OVER

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "evidence" / "nightly.md"
BEGIN, END = "<!-- last night -->", "<!-- end -->"
MOST_FILES = 15


@dataclass(frozen=True)
class Night:
    """Result of a night: number of tests by outcome (passed, failed, skipped, not begun), failed tests, and
    duration.
    """

    ended: Mapping[str, int]
    failed: Sequence[str]
    minutes: float

    @property
    def is_whole(self) -> bool:
        """Return whether every test was started and none failed."""
        return not self.failed and not self.ended.get("not begun") and self.ended.get("passed", 0) > 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, epilog="Other arguments go to pytest, files among them.")
    parser.add_argument("--numprocesses", "-n", default="2", help="how many processes (2)")
    parser.add_argument("--hours", type=float, default=2.0, help="no test is begun after so long (2)")
    parser.add_argument("--keep", action="store_true", help=f"write the result into {PAGE.relative_to(ROOT)}")
    asked, others = parser.parse_known_args()
    print(expected(durations()), flush=True)
    began_s = time.time()
    with tempfile.TemporaryDirectory(prefix="night-") as scratch:
        report = Path(scratch) / "report.xml"
        code = ran(asked.numprocesses, began_s + 3600 * asked.hours, report, others)
        if not report.exists():
            return code
        night = read(report, (time.time() - began_s) / 60)
    if code == pytest.ExitCode.INTERRUPTED:
        print("interrupted: the tests that had not begun are not counted")
        return code
    print(summary(night))
    if asked.keep:
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(page_with(text, result(night, commit(), others, durations())), encoding="utf-8")
    return code or int(not night.is_whole)


def expected(took: Durations) -> str:
    """Describe the expected duration according to earlier runs."""
    seconds = [time for name, time in took.tests.items() if name in took.nightly]
    return f"{len(seconds)} tests of a night have run here before: {sum(seconds) / 60:.0f} minutes of processor time"


def ran(processes: str, ends_s: float, report: Path, others: Sequence[str]) -> int:
    """Run the nightly tests and return the exit code of pytest. No test starts after `ends_s`."""
    command = [sys.executable, "-m", "pytest", "-m", "nightly", "--dist", "worksteal", "--numprocesses", processes]
    command += [f"--night-ends={ends_s:.0f}", f"--junitxml={report}", *others]
    return subprocess.run(command, cwd=ROOT, check=False).returncode


def read(report: Path, minutes: float) -> Night:
    """Return the result from a JUnit report of pytest."""
    ended: Counter[str] = Counter()
    failed = []
    for case in ElementTree.parse(report).iter("testcase"):  # noqa: S314 - written by pytest above
        skipped = case.find("skipped")
        if case.find("failure") is not None or case.find("error") is not None:
            ended["failed"] += 1
            failed.append(f"{case.get('classname', '')}::{case.get('name', '')}")
        elif skipped is not None:
            ended["not begun" if NIGHT_IS_OVER in (skipped.get("message") or "") else "skipped"] += 1
        else:
            ended["passed"] += 1
    return Night(ended, failed, minutes)


def summary(night: Night) -> str:
    """Format the result in a single line."""
    counts = ", ".join(f"{night.ended.get(word, 0)} {word}" for word in ("passed", "failed", "skipped", "not begun"))
    return f"{counts}, in {night.minutes:.0f} minutes"


def result(night: Night, state: str, others: Sequence[str], took: Durations) -> str:
    """Format the result for the page, with the longest files."""
    what = f"of `{' '.join(others)}` alone" if others else "whole"
    day = dt.datetime.now(tz=dt.UTC).date().isoformat()
    lines = [f"{day}, commit {state}, {what}: {summary(night)}.", ""]
    lines += [f"Failed: `{name}`" for name in night.failed]
    names = {name: seconds for name, seconds in took.tests.items() if name in took.nightly}
    files = sorted(Durations(names).by_file().items(), key=lambda row: -row[1])
    lines += ["", "| file | processor time, s |", "| --- | --- |"]
    lines += [f"| `{name}` | {seconds:.0f} |" for name, seconds in files[:MOST_FILES]]
    lines += [f"| all {len(files)} files | {sum(names.values()):.0f} |"]
    return "\n".join(lines)


def commit() -> str:
    """Return the commit of this tree, marked if there are uncommitted changes."""
    said = ["git", "describe", "--always", "--dirty", "--exclude", "*"]
    return subprocess.run(said, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip() or "unknown"


def page_with(page: str, told: str) -> str:
    """Return the page with a new result between its markers."""
    before, _, rest = page.partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise ValueError(f"{PAGE.name} has no marks {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{told}\n\n{END}{after}"


if __name__ == "__main__":
    sys.exit(main())

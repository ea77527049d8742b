"""Apply random small changes to daq, analysis and rigs, and count how many of them the tests detect."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from compileall import compile_dir
from pathlib import Path
from py_compile import PycInvalidationMode

from tests.support.durations import Durations, durations
from tests.support.mutants import Mutant, drawn, files_for

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / ".pytest_cache" / "mutants.json"
FOLDERS = ("rigs", "daq", "analysis", "docs", "tests", "scripts", "systemd")
UNKNOWN_S = 5.0
"""Assumed time of test files that have not been measured here: half of the files take less than 2 s."""
HANGS_S = 3600.0
"""Time after which a mutant that blocks a test counts as detected; the limits of pytest are far shorter."""
ENDS = {0: "missed", 1: "found", 2: "found", 5: "missed"}
"""Result by exit code of pytest: 2 means that a module can no longer be imported, 5 that there is no test."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=10, help="how many (10)")
    parser.add_argument("--seed", type=int, default=1, help="of the draw (1)")
    parser.add_argument("--seconds", type=float, default=60.0, help="processor time of tests for each mutant (60)")
    parser.add_argument("--night", action="store_true", help="also by a night what each commit missed")
    parser.add_argument("--only", nargs="+", default=[""], metavar="PATH", help="those of these folders or files alone")
    parser.add_argument("--root", type=Path, default=ROOT, help="the tree whose code and tests are taken (this one)")
    asked = parser.parse_args()
    root = asked.root.resolve()
    mutants = [one for one in drawn(root, sys.maxsize, asked.seed) if one.path.startswith(tuple(asked.only))]
    took, results = durations(), []
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        tree = copied(root, Path(scratch) / "tree")
        for number, mutant in enumerate(mutants[: asked.count], start=1):
            found = looked_for(mutant, tree, took, asked.seconds, asked.night)
            results.append({**mutant.to_dict(), **found})
            print(f"{number:3d}  {found['by'] or 'missed':9}  {mutant}  {found['test']}", flush=True)
            KEPT.parent.mkdir(exist_ok=True)
            KEPT.write_text(json.dumps(results, indent=1), encoding="utf-8")
    print("\n" + counted(results))
    return 0


def copied(root: Path, tree: Path) -> Path:
    """Copy a tree without generated files, and compile it so that a changed file is recognised by its content."""
    for name in FOLDERS:
        shutil.copytree(root / name, tree / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for file in root.iterdir():
        if file.is_file():
            shutil.copy(file, tree)
    if (data := root.parent / "shared").exists():
        (tree.parent / "shared").symlink_to(data.resolve())
    compile_dir(tree, quiet=2, invalidation_mode=PycInvalidationMode.CHECKED_HASH)
    return tree


def looked_for(mutant: Mutant, tree: Path, took: Durations, seconds: float, night: bool) -> dict[str, str]:
    """Run the tests for a mutant. Return the detecting set of tests (commit, night, or empty) and the failing test."""
    path = tree / mutant.path
    sound = path.read_text(encoding="utf-8")
    path.write_text(mutant.applied(sound), encoding="utf-8")
    try:
        for by in ("commit", "night")[: 1 + night]:
            files = within(files_for(tree, mutant.path), took, seconds, by == "night")
            marks = "nightly" if by == "night" else ""
            end, test = tried(tree, files, marks)
            if end == "found":
                return {"by": by, "test": test}
    finally:
        path.write_text(sound, encoding="utf-8")
    return {"by": "", "test": ""}


def within(files: Sequence[str], took: Durations, seconds: float, night: bool) -> list[str]:
    """Return the first files with a total test time of up to `seconds`, at least one file."""
    tests = {name: time for name, time in took.tests.items() if (name in took.nightly) == night}
    by_file = Durations(tests).by_file()
    chosen, sum_s = list[str](), 0.0
    for file in files:
        took_s = by_file.get(file, UNKNOWN_S)
        if not chosen or sum_s + took_s <= seconds:
            chosen.append(file)
            sum_s += took_s
    return chosen


def tried(tree: Path, files: Sequence[str], marks: str) -> tuple[str, str]:
    """Run tests until one fails. Return the result and the failing test."""
    if not files:
        return "missed", ""
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "-m", marks, *files]
    try:
        done = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, check=False, timeout=HANGS_S
        )
    except subprocess.TimeoutExpired:
        return "found", "(it waits for ever)"
    if done.returncode < 0:
        return "found", f"(pytest ended by signal {-done.returncode})"
    if done.returncode not in ENDS:
        raise RuntimeError(f"pytest ended with {done.returncode}: {done.stdout[-2000:]}{done.stderr[-2000:]}")
    failed = [line.split()[1] for line in done.stdout.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    return ENDS[done.returncode], failed[0] if failed else ""


def counted(results: Sequence[dict[str, str | int]]) -> str:
    """Format the numbers of detected mutants, in total and for each kind."""
    rows = []
    for kind in ("", *sorted({str(one["kind"]) for one in results})):
        by = Counter(one["by"] for one in results if one["kind"] == kind or not kind)
        words = f"{by['commit']} found by each commit, {by['night']} by a night, {by['']} missed"
        rows.append(f"{kind or 'all'}: {sum(by.values())} mutants, {words}")
    return "\n".join(rows)


if __name__ == "__main__":
    sys.exit(main())

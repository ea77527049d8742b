"""The blind trial: cases are generated, imported, diagnosed and scored. Only this module uses both the independent
world and rig.

The truth is stored in a separate tree, and the diagnosis has no access to it.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import shutil
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from tests.worlds.stranger import generate_real

_WHOLE = "imported"
"""File that marks a completely imported case."""
_ANSWER = "answer.json"
_INTERRUPTED = 130
"""Exit code after SIGINT: 128 plus the number of the signal."""


@dataclass(frozen=True)
class Job:
    """A case of the trial, with the directories of its tables and of its truth."""

    kind: str
    seed: int
    root: Path

    def __str__(self) -> str:
        return f"{self.kind} {self.seed}"

    @property
    def name(self) -> str:
        """A name without information, because the paths of the runs show it to the diagnosis."""
        return f"case-{zlib.crc32(f'{self.kind} {self.seed} real'.encode()):08x}"

    @property
    def case(self) -> Path:
        return self.root / "cases" / self.name

    @property
    def truth(self) -> Path:
        return self.root / "truth" / f"{self.name}.json"


def make_case(job: Job) -> None:
    """Generate and import a case, unless an earlier trial did."""
    if (job.case / _WHOLE).exists():
        return
    shutil.rmtree(job.case, ignore_errors=True)
    generate_real(job.kind, job.seed, job.case.parent, job.truth.parent, name=job.name)
    import_case(job.case)
    (job.case / _WHOLE).touch()


def run_job(job: Job) -> dict[str, Any]:
    """Generate, import and diagnose; the answer with its `seconds`, or an `error` instead, which also a case is whose
    tables are refused. A case that is there already is used again."""
    begin = time.process_time()
    try:
        make_case(job)
        runs = runs_of(job.case)
        begin = time.process_time()
        answer = diagnose_case(runs["train"], runs["held_out"], runs["unseen"])
    except (Exception, SystemExit) as error:  # noqa: BLE001 - one bad case is an answer that is missing
        answer = {"error": f"{type(error).__name__}: {error}"}
    answer |= {"seconds": time.process_time() - begin, "code": code()}
    (job.case / _ANSWER).write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
    return answer


@cache
def code() -> str:
    """Digest of all files of rig that contribute to an answer."""
    import analysis  # noqa: PLC0415
    import rigs  # noqa: PLC0415

    files = [file for package in (analysis, rigs) for file in Path(package.__path__[0]).rglob("*.*")]
    told = sorted(file for file in files if file.suffix in (".py", ".yaml"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in told)).hexdigest()[:16]


def import_case(case: Path) -> None:
    """The case's tables as run directories."""
    from analysis import read_table, save_run  # noqa: PLC0415

    for line, run in _listed(case):
        run.parent.mkdir(exist_ok=True)
        direction = line["direction"] or None
        table = read_table(case / line["file"], case / line["rig"], line["test"], direction, operator="a stranger")
        save_run(table, run)
        (case / line["file"]).unlink()


def runs_of(case: Path) -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {"train": [], "held_out": [], "unseen": []}
    for line, run in _listed(case):
        found[line["use"]].append(run)
    return found


def _listed(case: Path) -> list[tuple[dict[str, str], Path]]:
    with (case / "runs.csv").open(encoding="utf-8", newline="") as file:
        return [(line, case / "runs" / Path(line["file"]).stem) for line in csv.DictReader(file)]


def diagnose_case(run_dirs: Sequence[Path], held_out: Sequence[Path], unseen: Sequence[Path]) -> dict[str, Any]:
    """Output of `rig diagnose RUN… --hold-out RUN… --unseen RUN… --json`, run in this process."""
    from analysis.cli import app  # noqa: PLC0415

    arguments = ["diagnose", *map(str, run_dirs), "--json"]
    for option, runs in (("--hold-out", held_out), ("--unseen", unseen)):
        for run in runs:
            arguments += [option, str(run)]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        code_of_exit = app(arguments, standalone_mode=False)
    # What the command makes of Ctrl-C; here it ends the trial, not one diagnosis.
    if code_of_exit == _INTERRUPTED:
        raise KeyboardInterrupt
    answer: dict[str, Any] = json.loads(printed.getvalue())
    return answer


def answered(job: Job) -> dict[str, Any]:
    """The answer that is there, where it is of the same code; else a new one."""
    with contextlib.suppress(OSError, ValueError):
        known: dict[str, Any] = json.loads((job.case / _ANSWER).read_text(encoding="utf-8"))
        if known.get("code") == code() and "error" not in known:
            return known
    return run_job(job)

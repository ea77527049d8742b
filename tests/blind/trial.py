"""The blind trial: cases generated, imported, diagnosed and scored. The one place where stranger and project meet.

The truth lies in a tree of its own, and nothing of it is told to the diagnosis.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import time
import zlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from stranger import generate


@dataclass(frozen=True)
class Job:
    """One case to try: where its tables and its truth go."""

    kind: str
    seed: int
    scale: str
    root: Path

    @property
    def name(self) -> str:
        """Tells nothing: the diagnosis sees it in the paths of the runs."""
        return f"case-{zlib.crc32(f'{self.kind} {self.seed} {self.scale}'.encode()):08x}"

    @property
    def case(self) -> Path:
        return self.root / "cases" / self.name

    @property
    def truth(self) -> Path:
        return self.root / "truth" / f"{self.name}.json"


def diagnosis_exists() -> bool:
    """Whether `rig diagnose` is a command yet."""
    import typer  # noqa: PLC0415

    from analysis.cli import app  # noqa: PLC0415

    return "diagnose" in typer.main.get_command(app).commands  # type: ignore[attr-defined]


def run_job(job: Job) -> dict[str, Any] | None:
    """Generate, import and diagnose; the answer with its `seconds`, an `error` instead, None without a diagnosis."""
    generate(job.kind, job.seed, job.case.parent, job.truth.parent, scale=job.scale, name=job.name)
    runs = import_case(job.case)
    if not diagnosis_exists():
        return None
    begin = time.process_time()
    try:
        answer = diagnose_case(runs["train"], runs["held_out"], runs["unseen"])
    except (Exception, SystemExit) as error:  # noqa: BLE001 - one bad case is an answer that is missing
        answer = {"error": f"{type(error).__name__}: {error}"}
    answer["seconds"] = time.process_time() - begin
    (job.case / "answer.json").write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
    return answer


def import_case(case: Path) -> dict[str, list[Path]]:
    """The case's tables as run directories, by use."""
    from analysis.files.imports import import_table  # noqa: PLC0415

    found: dict[str, list[Path]] = {"train": [], "held_out": [], "unseen": []}
    with (case / "runs.csv").open(encoding="utf-8", newline="") as file:
        for line in csv.DictReader(file):
            run = case / "runs" / Path(line["file"]).stem
            run.parent.mkdir(exist_ok=True)
            import_table(
                case / line["file"],
                run,
                rig_file=str(case / line["rig"]),
                test=line["test"],
                direction=line["direction"] or None,
                operator="a stranger",
            )
            found[line["use"]].append(run)
    return found


def diagnose_case(run_dirs: Sequence[Path], held_out: Sequence[Path], unseen: Sequence[Path]) -> dict[str, Any]:
    """What `rig diagnose RUN… --hold-out RUN… --unseen RUN… --json` prints, run in this process."""
    from analysis.cli import app  # noqa: PLC0415

    arguments = ["diagnose", *map(str, run_dirs), "--json"]
    for option, runs in (("--hold-out", held_out), ("--unseen", unseen)):
        for run in runs:
            arguments += [option, str(run)]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        app(arguments, standalone_mode=False)
    answer: dict[str, Any] = json.loads(printed.getvalue())
    return answer


def run_all(jobs: Sequence[Job], workers: int) -> Iterator[tuple[Job, dict[str, Any] | None]]:
    """Each job with its answer as it ends."""
    if workers <= 1:
        yield from ((job, run_job(job)) for job in jobs)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from zip(jobs, pool.map(run_job, jobs), strict=True)

"""The blind trial: cases are generated, imported, diagnosed and scored. Only this module uses both the independent
world
and rig.

The truth is stored in a separate tree, and the diagnosis has no access to it.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import math
import shutil
import time
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.worlds.stranger import energy_of, gap_of_real, generate, generate_real
from tests.worlds.stranger.cases import Lap

_WHOLE = "imported"
"""Marks a case that is all there."""
_ANSWER = "answer.json"
_INTERRUPTED = 130
"""128 and the number of SIGINT, as shells have it."""


@dataclass(frozen=True)
class Job:
    """One case to try: where its tables and its truth go. scale: of the quiet world."""

    kind: str
    seed: int
    root: Path
    world: str = "real"
    scale: str = "limits"

    def __str__(self) -> str:
        return f"{self.kind} {self.seed}"

    @property
    def name(self) -> str:
        """Tells nothing: the diagnosis sees it in the paths of the runs."""
        what = self.scale if self.world == "quiet" else self.world
        return f"case-{zlib.crc32(f'{self.kind} {self.seed} {what}'.encode()):08x}"

    @property
    def case(self) -> Path:
        return self.root / "cases" / self.name

    @property
    def truth(self) -> Path:
        return self.root / "truth" / f"{self.name}.json"


def make_case(job: Job) -> None:
    """Generate and import a case; one that is there already stays."""
    if (job.case / _WHOLE).exists():
        return
    shutil.rmtree(job.case, ignore_errors=True)
    if job.world == "real":
        generate_real(job.kind, job.seed, job.case.parent, job.truth.parent, name=job.name)
    else:
        generate(job.kind, job.seed, job.case.parent, job.truth.parent, scale=job.scale, name=job.name)
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
    truth = json.loads(job.truth.read_text(encoding="utf-8"))
    # A vibration begins with a phase of its own in every run: nothing takes it out.
    if job.world == "real" and truth["hidden"] and all(one["effect"] != "vibration" for one in truth["hidden"]):
        answer["left_by_truth"] = left_by_truth(truth, job.case, answer)
    (job.case / _ANSWER).write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
    return answer


@cache
def code() -> str:
    """Which code answers: a digest of every file of rig that has a part in it."""
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


def left_by_truth(truth: Mapping[str, Any], case: Path, answer: Mapping[str, Any]) -> dict[str, float]:
    """Share of the faults' energy at the unseen place that those effects of an answer leave which stand.

    A name that is no fault is held against its healthy share, which is in the arm as well.
    """
    standing = [one for one in answer.get("effects") or [] if one.get("stands") is not False]
    faults, named, there = gap_of_real(truth, case, {one["name"] for one in standing})
    energy = energy_of(faults, [lap.added for lap in faults])
    # Below a thousandth of a micrometre the faults do not show at this place.
    if energy < 1e-12 * sum(lap.added.size for lap in faults):
        return {}
    effects = [effect_of(one) for one in standing]
    rig_file, setup = case / "unseen.yaml", truth["setup"]["unseen"]
    starts = (there, np.array(setup["ball_mm"]))
    left = min(_left_fitted(effects, rig_file, setup, named, ball) for ball in starts)
    return {"unseen_place": left / energy}


def _left_fitted(
    effects: Sequence[Any], rig_file: Path, setup: Mapping[str, Any], laps: Sequence[Lap], ball: Any
) -> float:
    """mm² that effects leave of laps. The ball of the model is fitted, from a place (3,) mm on: a wrong length moves it
    by millimetres, more than a linear fit bears."""
    A = np.concatenate([lap.by_setup for lap in laps])
    left = math.inf
    for _ in range(8):
        said = said_by(effects, rig_file, setup, laps, ball)
        rest = [lap.added - one for lap, one in zip(laps, said, strict=True)]
        left = min(left, energy_of(laps, rest))
        step = np.linalg.lstsq(A, np.concatenate([part.ravel() for part in rest]), rcond=0.05)[0][:3]
        ball = ball + step
        if np.abs(step).max() < 1e-4:
            break
    return left


def said_by(
    effects: Sequence[Any], rig_file: Path, setup: Mapping[str, Any], laps: Sequence[Lap], ball_mm: Any = None
) -> list[Any]:
    """What effects, and a ball (3,) elsewhere, add to the readings of laps, (m, 2) mm each, as rig's simulator has
    it."""
    from analysis.procedures.shared.test_kind import nominal_setup, path_of, predict  # noqa: PLC0415
    from analysis.robot.model.predict import model_of  # noqa: PLC0415
    from analysis.runs.tables import CircleTable  # noqa: PLC0415
    from rigs.load import load  # noqa: PLC0415

    plain = model_of(load(str(rig_file))[0])
    grown = replace(plain, effects=tuple(effects))
    said = []
    for lap in laps:
        table = CircleTable("yaw", lap.direction, lap.t_s, lap.q, np.zeros((len(lap.t_s), 2)))  # type: ignore[arg-type]
        nominal = nominal_setup(plain.rig, table)
        there = replace(nominal, ball=np.array(setup["ball_mm"]), zeros_mm=np.array(setup["zeros_mm"]))
        moved = there if ball_mm is None else replace(there, ball=ball_mm)
        path = path_of(plain, table)
        said.append(predict(grown, table, path, moved) - predict(plain, table, path, there))
    return said


def effect_of(one: Mapping[str, Any]) -> Any:
    """An effect of an answer as a rig file would have it."""
    from rigs.effects import VOCABULARY  # noqa: PLC0415

    keys = {key: one[key] for key in ("axis", "field", "gauge", "from_axis", "to_axis") if one.get(key) is not None}
    values = {key: given["value"] for key, given in one["parameters"].items()}
    return VOCABULARY[one["effect"]].model_validate(values | keys)


def diagnose_case(run_dirs: Sequence[Path], held_out: Sequence[Path], unseen: Sequence[Path]) -> dict[str, Any]:
    """What `rig diagnose RUN… --hold-out RUN… --unseen RUN… --json` prints, run in this process."""
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

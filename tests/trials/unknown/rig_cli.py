"""rig as its user runs it: commands in processes of their own, with their processor time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.support.cpu_limit import cpu_s
from tests.worlds.unknown.cells import Cell
from tests.worlds.unknown.files import write_cell

TIMEOUT_S = 1800
_RIG = Path(sys.executable).with_name("rig")


class RigFailedError(Exception):
    """A command of rig ended with an error; the message is its last line."""


def run_rig(*arguments: str | Path) -> tuple[str, float]:
    """Run a command; return what it prints and its processor time, s."""
    begin_s = cpu_s()
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [_RIG, *map(str, arguments)], capture_output=True, text=True, check=False, timeout=TIMEOUT_S, env=environment
    )
    if done.returncode not in (0, 3):  # 3: a run was left out, which the answer says
        raise RigFailedError((done.stderr.strip() or done.stdout.strip() or str(done.returncode)).splitlines()[-1])
    return done.stdout, cpu_s() - begin_s


def import_tables(tables: Sequence[tuple[Path, str, str]], rig_file: Path, directory: Path) -> list[Path]:
    """Import tables (path, test, direction) as run directories, by rig's Python API: a process each costs a second."""
    from analysis import RigError, read_table, save_run  # noqa: PLC0415 - an independent world needs it here alone

    found = []
    directory.mkdir(parents=True, exist_ok=True)
    for path, test, direction in tables:
        try:
            run = read_table(path, rig_file, test, direction or None)  # type: ignore[arg-type]
            found.append(save_run(run, directory / path.stem))
        except RigError as error:
            raise RigFailedError(str(error)) from error
    return found


def kept_answer(cell: Cell, directory: Path, found: Path | None = None) -> dict[str, Any]:
    """Diagnose a cell, unless its directory has the answer already."""
    file = directory / "answer.json"
    if not file.exists():
        runs = import_tables(write_cell(cell, directory), directory / "cell.yaml", directory / "runs")
        file.write_text(json.dumps(diagnose(runs, found), indent=1), encoding="utf-8")
    answer: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return answer


def diagnose(runs: Sequence[Path], found: Path | None = None) -> dict[str, Any]:
    """Diagnose runs; return the JSON answer with `cpu_s`. found: directory that receives the calibrated rig file."""
    output: list[str | Path] = ["-o", found] if found else []
    printed, cpu_s = run_rig("diagnose", *runs, "--json", *output)
    answer: dict[str, Any] = json.loads(printed)
    return answer | {"cpu_s": cpu_s}

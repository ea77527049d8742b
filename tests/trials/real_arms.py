"""First sentence and first act of arms that others measured, by the commands that a person types.

`scripts/dev real_arms DATA` makes tables and rig files as the pages on tables and on any arm say, imports each run with
`rig import`, and lets `rig diagnose` judge by poses or a placement that had no part.
"""

from __future__ import annotations

import json
import sys
import tempfile
from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tests.support.command_line import ran
from tests.support.measured_series import MUKCA_ARMS, mukca
from tests.support.trial import Trial, main, markdown

_HEAD = ("arm", "judged by", "first sentence", "first act", "before → after, mm rms")


@dataclass(frozen=True)
class Arm:
    """An arm that others measured: `make` puts a rig file `cell.yaml` and runs into a directory; `judge` names the run
    that only judges, and `by` is the option that gives it."""

    name: str
    make: Callable[[Path, Path], None]
    judge: str
    by: str


def draw(given: Namespace) -> Iterator[tuple[Arm, Path]]:
    yield from ((arm, given.data) for arm in arms() if arm.name.startswith(given.only))


def arms() -> Iterator[Arm]:
    """Yield every arm with what judges it."""
    for series in ("b", "d"):
        yield Arm(f"UR10 {series.upper()}", partial(_ur10, series), "left", "--hold-out")
    yield Arm("UR5", _ur5, "random", "--hold-out")
    for arm, placement in (("kuka_14", "raised_left"), ("panda_1", "right"), ("panda_2", "front_left")):
        yield Arm(arm, partial(_touched, arm), placement, "--unseen")


def row_of(case: tuple[Arm, Path]) -> list[str]:
    """Row of the table with the answers of the commands about an arm."""
    arm, data = case
    with tempfile.TemporaryDirectory() as scratch:
        directory = Path(scratch)
        arm.make(directory, data)
        runs = sorted(f"runs/{path.name}" for path in (directory / "runs").iterdir())
        used = [run for run in runs if run != f"runs/{arm.judge}"]
        words = ("diagnose", *used, arm.by, f"runs/{arm.judge}", "-o", "found")
        said = _rig(directory, *words).splitlines()
        found = json.loads((directory / "found" / "diagnosis.json").read_text())
        models = [f"found/{path.name}" for path in sorted((directory / "found").glob("*.yaml"))]
        for line in _rig(directory, "correct", *models[:1], "-o", "out", fails=True).splitlines()[:3]:
            print(f"  rig correct: {line}", flush=True)
    first = " ".join(" ".join(said[:3]).split())
    judged, acts = found["accuracy"], found["acts"]
    act = f"{acts[0]['kind']} ({acts[0]['why']}) {acts[0]['effect'] or ''}".strip() if acts else "–"
    gap = " → ".join(f"{judged[key] / 1e3:.3f}" for key in ("before_there_um", "calibrated_um"))
    return [arm.name, arm.judge, first, act, gap]


def _rig(directory: Path, *words: str, fails: bool = False) -> str:
    done = ran(*words, cwd=directory, COLUMNS="2000")
    if done.returncode and not fails:
        raise SystemExit(f"rig {' '.join(words)} ended with {done.returncode}: {done.stderr}")
    return done.stdout + (done.stderr if fails else "")


def _ur10(series: str, to: Path, data: Path) -> None:
    """Poses of a UR10 as they come: two thirds to find, a third to judge by."""
    (to / "cell.yaml").write_text(_rig(to, "example", ".") and (to / "ur10-cell.yaml").read_text())
    lines = (data / "ipa-ur10" / f"series_{series}.csv").read_text().splitlines(keepends=True)
    for run, rows in (("used", [k for k in range(1, len(lines)) if k % 3]), ("left", range(3, len(lines), 3))):
        (to / f"{run}.csv").write_text("".join([lines[0], *(lines[k] for k in rows)]))
        _rig(to, "import", f"{run}.csv", "--rig", "cell.yaml", "--test", "pose", "-o", f"runs/{run}")


def _ur5(to: Path, data: Path) -> None:
    """Poses of a UR5 as they come, with the answer to the one question."""
    (to / "cell.yaml").write_text(f"name: ur5\n{_rig(to, 'arms', 'ur5')}")
    for run in ("grid", "random"):
        (to / f"{run}.csv").write_bytes((data / "jacobi" / f"ur5_{run}.csv").read_bytes())
        words = ("import", f"{run}.csv", "--rig", "cell.yaml", "--test", "pose", "-o", f"runs/{run}")
        _rig(to, *words, fails=True)
        asked = next(to.glob("*.map.yaml"), None)
        if asked is not None:
            answer = "{columns: [x_dif, y_dif, z_dif], unit: mm, meaning: target - measured}"
            asked.write_text(asked.read_text().replace('residual: "?"', f"residual: {answer}"))
            _rig(to, *words, "--map", asked.name)
            asked.unlink()


def _touched(arm: str, to: Path, data: Path) -> None:
    """Touches by placement, as a table that a person writes: socket and joints in degrees."""
    rig_file = (
        f'name: {arm.replace("_", "-")}\n{_rig(to, "arms", MUKCA_ARMS[arm])}tests: {{touch: {{sockets: ["0", "1"]}}}}\n'
    )
    (to / "cell.yaml").write_text(rig_file)
    for placement, (sockets, joints) in mukca(data / "mukca", arm).items():
        head = ",".join(["socket", *(f"q{axis}_deg" for axis in range(1, 8))])
        rows = [
            ",".join([str(socket), *(f"{angle:.6f}" for angle in np.degrees(q))])
            for socket, q in zip(sockets, joints, strict=True)
        ]
        (to / f"{placement}.csv").write_text("\n".join([head, *rows]) + "\n")
        words = ("import", f"{placement}.csv", "--rig", "cell.yaml", "--test", "touch", "--placement", placement)
        _rig(to, *words, "-o", f"runs/{placement}")


TRIAL = Trial(
    draw,
    row_of,
    lambda rows: markdown(_HEAD, rows),
    options={
        "DATA": (Path, "directory with ipa-ur10, jacobi and mukca"),
        "only": ("", "arms whose name begins so (all)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

"""Conventions: false alarms in sound cells of arms from outside, and broken ones told rightly, wrongly or not."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.procedures.checks.check_runs import findings_of
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable, TouchTable
from rigs.arms import load_arm
from rigs.load import load, parse
from rigs.rig import Rig
from tests.support.conventions import BREAKS, driven_on_from, is_right, run_of, sound
from tests.support.measured_series import DATA, MUKCA_ARMS, UR5, jacobi, mukca, ur10
from tests.support.trial import Trial, main
from tests.worlds.arms.seven_axes import run_of as touched_run


def real(folder: Path) -> Iterator[tuple[str, Measured]]:
    """Runs of measured arms that are there: poses of a UR10 twice and of a UR5, touches of two Pandas and an iiwa."""
    for series in "bd":
        if (path := folder / "ipa-ur10" / f"series_{series}.csv").is_file():
            yield f"UR10, series {series}", run_of(PoseTable(*ur10(path), None), series, load("ur10")[0])
    for name in ("grid", "random"):
        if (path := folder / "jacobi" / f"ur5_{name}.csv").is_file():
            yield f"UR5, {name}", run_of(PoseTable(*jacobi(path), None), f"ur5_{name}", _ur5())
    for arm, model in MUKCA_ARMS.items():
        rig = parse(f"name: arm\n{load_arm(model).text}", model)
        for name, touches in sorted(mukca(folder / "mukca", arm).items()):
            yield f"{model}, {arm}, {name}", touched_run(rig, TouchTable(*touches), name, name)


def _ur5() -> Rig:
    """The UR5 by its maker's constants, those of a UR10 in their place."""
    rig = load("ur10")[0]
    axes = tuple(
        axis.model_copy(
            update={key: float(values[k]) for key, values in UR5.items()} | {"beta_deg": 0.0, "offset_deg": 0.0}
        )
        for k, axis in enumerate(rig.robot.axes)
    )
    return rig.model_copy(update={"robot": rig.robot.model_copy(update={"axes": axes})})


@dataclass(frozen=True)
class Checked:
    """Verdict on a cell of a group, its runs, and what was found if that is wrong."""

    group: str
    verdict: str
    runs: int
    said: str = ""


Case = tuple[str, Callable[..., object], tuple[object, ...]]


def draw(given: Namespace) -> Iterator[Case]:
    """Sound cells, sound cells that drive on, measured series, and cells with a broken convention."""
    for make, count in ((sound, given.sound), (driven_on_from, given.driven)):
        yield from (("sound", make, (number, given.seed)) for number in range(count))
    yield from ((f"real: {name}", list, ([run],)) for name, run in real(given.data))
    for kind, (name, make) in enumerate(BREAKS.items()):
        yield from ((name, make, (np.random.default_rng([given.seed, kind, k, 2]), k)) for k in range(given.each))


def checked(case: Case) -> Checked:
    name, make, given = case
    cell: Any = make(*given)
    found = findings_of(cell.runs if name in BREAKS else cell)
    said = "; ".join(f"{', '.join(one.runs)}: {one.convention}: {one.words}" for one in found) or "nothing found"
    if name not in BREAKS:
        return Checked(name, "wrong" if found else "right", len(cell), said)
    wrong = [one for one in found if one.strength != "likely" and not is_right(one, cell)]
    verdict = "right" if any(is_right(one, cell) for one in found) else "wrong" if wrong else "not"
    return Checked(name, verdict, len(cell.runs), f"meant {cell.meant[0]!r} in {cell.runs[0].title}: {said}")


def line(one: Checked) -> str:
    is_shown = one.group.startswith("real") or one.verdict != "right"
    return f"  {one.group}, {one.verdict}: {one.said}" * is_shown


def report(done: Sequence[Checked]) -> str:
    lines = [f"{'':36}{'runs':>6}{'cells':>6}{'right':>6}{'wrong':>6}{'not':>5}"]
    for group in dict.fromkeys(one.group for one in done):
        own = [one for one in done if one.group == group]
        told = Counter(one.verdict for one in own)
        counts = f"{told['right']:6}{told['wrong']:6}{told['not']:5}"
        lines.append(f"{group:36}{sum(one.runs for one in own):6}{len(own):6}{counts}")
    return "\n".join(lines)


TRIAL = Trial(
    draw,
    checked,
    report,
    line=line,
    options={
        "sound": (70, "sound cells (70: some 300 runs)"),
        "driven": (30, "sound cells that drive cw on from acw (30: 120 runs)"),
        "each": (20, "cells of each kind with one convention broken (20)"),
        "seed": (0, "of the first cell (0)"),
        "data": (DATA, "folder of the measured data (../shared/data)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

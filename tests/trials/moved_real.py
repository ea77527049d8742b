"""What moved on tables that others measured: `scripts/dev moved_real DATA`.

Of each series the first half is the reference. Readings of the second half, at random, are the new ones: as they are,
with 0.05° added to one recorded joint, with a base that moved by 0.5 mm and 0.5 mrad, or with a tool that moved by
0.5 mm. The change is exact, so it is known what moved; the arm, the scatter and the drift are real.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.evidence.observation import by_socket, observe
from analysis.movement.inference import compare, study
from analysis.robot.geometry.pose_setup import fit_setup
from analysis.robot.kinematics.arm import forward
from analysis.robot.model.predict import Model, model_of
from analysis.runs.tables import PoseTable, TouchTable
from rigs.arms import load_arm
from rigs.load import parse
from tests.support.measured_series import MUKCA_ARMS, mukca, ur10
from tests.support.moved_cell import label
from tests.support.trial import Trial, main
from tests.trials.moved import share

Array = NDArray[np.float64]
_ZERO = float(np.radians(0.05))
_SHIFT_MM, _TURN = 0.5, 5e-4


def series(data: Path) -> Iterator[tuple[str, Model, PoseTable | TouchTable]]:
    """Yield each series with its nominal arm."""
    for name in ("b", "d"):
        yield f"UR10 {name}", _model("ur10"), PoseTable(*ur10(data / "ipa-ur10" / f"series_{name}.csv"), None)
    for arm, library in MUKCA_ARMS.items():
        for placement, (sockets, q) in mukca(data / "mukca", arm).items():
            rank = np.concatenate([np.arange(n) / n for n in np.unique(sockets, return_counts=True)[1]])
            turn = rank.argsort(kind="stable")  # touches of both sockets in turn
            yield f"{arm} {placement}", _model(library), TouchTable(sockets[turn], q[turn])


def _model(arm: str) -> Model:
    return model_of(parse(f"name: real\n{load_arm(arm).text}", "real"))


def _rows(table: PoseTable | TouchTable, rows: NDArray[np.int64]) -> PoseTable | TouchTable:
    names = [name for name, value in vars(table).items() if isinstance(value, np.ndarray)]
    return replace(table, **{name: getattr(table, name)[rows] for name in names})


def changed(
    model: Model, table: PoseTable | TouchTable, cause: str, rng: np.random.Generator
) -> PoseTable | TouchTable:
    """A table after a movement; a touch of a moved arm has other angles, by the nominal arm."""
    what, _, axis = cause.partition(" ")
    if what == "nothing":
        return table
    if what == "zero":
        q = table.q.copy()
        q[:, int(axis) - 1] += _ZERO * rng.choice([-1, 1])
        return replace(table, q=q)
    direction, turn = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    T = forward(model.arm, table.q)
    if isinstance(table, PoseTable):
        return replace(table, xyz_mm=table.xyz_mm + _seen_shift(T, table.xyz_mm, what, direction, turn))
    shift = _SHIFT_MM * (np.tile(direction, (len(T), 1)) if what == "base" else T[:, :3, :3] @ direction)
    if what == "base":
        shift = shift + np.cross(_TURN * turn, T[:, :3, 3] - T[:, :3, 3].mean(axis=0))
    steps = 1e-6 * np.eye(table.q.shape[1])
    places = [forward(model.arm, table.q + step)[:, :3, 3] - T[:, :3, 3] for step in steps]
    slopes = np.stack(places, axis=2) / 1e-6
    return replace(table, q=table.q - np.einsum("nij,nj->ni", np.linalg.pinv(slopes, rcond=1e-3), shift))


def _seen_shift(T: Array, xyz_mm: Array, what: str, direction: Array, turn: Array) -> Array:
    """Apparent displacement (n, 3) in mm of the target, in the frame of the instrument."""
    if what == "base":
        return np.asarray(_SHIFT_MM * direction + np.cross(_TURN * turn, xyz_mm - xyz_mm.mean(axis=0)))
    R = fit_setup(T, xyz_mm).T_world_base[:3, :3]
    return np.asarray(_SHIFT_MM * T[:, :3, :3] @ direction @ R.T)


def _verdict(found: str, cause: str) -> str:
    if found == cause:
        return "right"
    return {"open": "open", "other": "open", "nothing": "nothing"}.get(found, f"wrong: {found}")


def draw(given: Namespace) -> Iterator[tuple[str, Model, PoseTable | TouchTable, int]]:
    yield from ((*one, given.cases) for one in series(given.data))


def judged(case: tuple[str, Model, PoseTable | TouchTable, int]) -> tuple[str, dict[str, Counter[str]]]:
    """Name of a series, and how often each cause is named, wrong or open at 20 to 1."""
    name, model, table, cases = case
    half, found = len(table.q) // 2, {}
    reference = study(by_socket(observe(model, _rows(table, np.arange(half)), name)))
    for cause in ["nothing", "base", "tool", *(f"zero {k}" for k in range(1, model.arm.axes + 1))]:
        counts = Counter[str]()
        for seed in range(cases):
            rng = np.random.default_rng([seed, *cause.encode()])
            count = min(24 if isinstance(table, PoseTable) else 12, len(table.q) - half)
            rows = np.sort(rng.choice(np.arange(half, len(table.q)), size=count, replace=False))
            new = changed(model, _rows(table, rows), cause, rng)
            compared = compare(reference, by_socket(observe(model, new, name)))
            counts[_verdict(label(compared.identified_cause), cause)] += 1
        found[cause] = counts
    return name, found


def report(done: Sequence[tuple[str, dict[str, Counter[str]]]]) -> str:
    totals: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for name, found in done:
        for cause, counts in found.items():
            for kind in {cause, cause.partition(" ")[0]}:
                totals[name.split()[0], kind] += Counter({v.partition(":")[0]: n for v, n in counts.items()})
    lines = []
    for (arm, cause), counts in totals.items():
        of = counts.total()
        others = ", ".join(f"{verdict} {counts[verdict]}" for verdict in ("open", "nothing", "wrong"))
        lines.append(f"{arm:8s} {cause:8s} of {of}: named {share(counts['right'], of)} %, {others}")
    wrong, of = (sum(c[v] if v else c.total() for (_, k), c in totals.items() if k != "zero") for v in ("wrong", ""))
    return "\n".join([*lines, f"false cause at 20 to 1: {wrong} of {of}, {share(wrong, of)} %"])


TRIAL = Trial(
    draw,
    judged,
    report,
    line=lambda one: f"{one[0]}: { {cause: dict(counts) for cause, counts in one[1].items()} }",
    options={"DATA": (Path, "directory with ipa-ur10 and mukca"), "cases": (5, "draws of each cause and series (5)")},
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

"""Ranked postures against measured errors: `scripts/dev postures DATA [--only NAME]`.

Neighbourhoods of poses are left out of a calibration in turn. `rig postures` ranks the poses that were left out by
their expected error. The error of the nominal arm there was measured: with frame and tool fitted to the poses that were
used. The table compares the half that is predicted better with all, and with the half that is really better.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

from analysis import calibrate
from analysis.apps.postures.expected_error import expected_errors
from analysis.apps.report.diagnosis_report import write_model
from analysis.robot.geometry.pose_setup import fit_setup
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable, TouchTable
from rigs.arms import load_arm
from rigs.load import load, parse
from rigs.rig import Rig
from rigs.schema.robot import Pose
from tests.support.measured_series import MUKCA_ARMS, mukca, ur10, ur10_columns
from tests.support.trial import Trial, main, markdown
from tests.worlds.arms.seven_axes import run_of

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
FOLDS, GROUPS = 5, 20
"""Parts in which neighbourhoods are left out, and neighbourhoods of a series."""
FEWEST_TAUGHT = 9
"""Touches of a placement that determine the ball on the flange and two sockets."""
APART_RAD = 0.1
"""Distance of a joint from which two visits of a target are two postures."""
DRAWS = 2000
"""Bootstrap samples of neighbourhoods."""
HEAD = (
    "series", "poses", "nominal error of all, mm rms", "half predicted better", "ratio, 95 %", "best possible ratio",
)  # fmt: skip


@dataclass(frozen=True)
class Ranked:
    """Poses that were left out: expected and measured error (m,) mm, neighbourhood (m,), and the set (m,) within which
    they are compared."""

    expected_mm: Array
    measured_mm: Array
    group: Integers
    compared: Integers

    def better(self, key: Array) -> NDArray[np.bool_]:
        """A mask of the better half of each compared set by a key (m,)."""
        chosen = np.zeros(len(key), dtype=bool)
        for number in np.unique(self.compared):
            rows = np.flatnonzero(self.compared == number)
            chosen[rows[np.argsort(key[rows], kind="stable")[: (len(rows) + 1) // 2]]] = True
        return chosen

    def ratio(self, key: Array) -> tuple[float, float, float]:
        """Error of the better half over that of all, with the 95 % interval of the bootstrap."""
        chosen, square = self.better(key), self.measured_mm**2
        groups = np.unique(self.group)
        sums = np.array([
            [square[rows & chosen].sum(), (rows & chosen).sum(), square[rows].sum(), rows.sum()]
            for rows in (self.group == number for number in groups)
        ])  # fmt: skip
        rng = np.random.default_rng(0)
        drawn = sums[rng.integers(len(groups), size=(DRAWS, len(groups)))].sum(axis=1)
        low, high = np.percentile(_ratio_of(drawn), [2.5, 97.5])
        return float(_ratio_of(sums.sum(axis=0))), float(low), float(high)


def _ratio_of(sums: Array) -> Array:
    return np.asarray(np.sqrt(sums[..., 0] / sums[..., 1] / (sums[..., 2] / sums[..., 3])))


def groups_of(places: Array) -> Integers:
    """Neighbourhood (n,) of each row (n, k)."""
    return np.asarray(kmeans2(places, GROUPS, minit="++", rng=np.random.default_rng(0))[1], dtype=np.int64)


def calibrated(runs: Sequence[Measured], text: str) -> Rig:
    """Rig file that `rig calibrate` writes for runs, as it is read again."""
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "found.yaml"
        write_model(calibrate(runs), text, path)
        return load(path)[0]


def with_tool(rig: Rig, xyz_mm: Array) -> Rig:
    """A rig with its tool at the target (3,) mm on the flange."""
    x, y, z = (float(value) for value in xyz_mm)
    return rig.model_copy(
        update={"robot": rig.robot.model_copy(update={"tool": Pose(xyz_mm=(x, y, z))})}
    ).calibrated_as(rig)


def tracked(data: Path, series: str) -> Iterator[tuple[str, Ranked]]:
    """Rankings of a series of the UR10: neighbourhoods of the work left out, and among these the postures of
    each target that has several."""
    file = data / "ipa-ur10" / f"series_{series.lower()}.csv"
    q, xyz_mm = ur10(file)
    goals = ur10_columns(file, *(f"Goal {name}" for name in ("x", "y", "z", "roll", "pitch", "yaw")))
    ranked = tracked_ranks(q, xyz_mm, groups_of(goals[:, :3]))
    yield f"UR10 {series}, neighbourhoods left out", ranked
    _, target = np.unique(goals.round(3), axis=0, return_inverse=True)
    target = np.asarray(target.ravel(), dtype=np.int64)
    # a visit that was repeated is no other posture
    several = np.array([np.ptp(q[target == number], axis=0).max() > APART_RAD for number in target])
    if several.any():
        yield f"UR10 {series}, postures of the same target", _of(replace(ranked, compared=target), several)


def _of(ranked: Ranked, rows: NDArray[np.bool_]) -> Ranked:
    return Ranked(ranked.expected_mm[rows], ranked.measured_mm[rows], ranked.group[rows], ranked.compared[rows])


def tracked_ranks(q: Array, xyz_mm: Array, group: Integers) -> Ranked:
    """Return poses q (n, 6) rad with measured places (n, 3) mm, each ranked by a calibration without its
    neighbourhood (n,), among those of its fold."""
    text = f"name: ur10\n{load_arm('ur10').text}"
    expected, measured = np.zeros(len(q)), np.zeros(len(q))
    for fold in range(FOLDS):
        out = group % FOLDS == fold
        used = PoseTable(q[~out], xyz_mm[~out], None)
        rig = calibrated([run_of(parse(text, "cell.yaml"), used, "used", "cell")], text)
        arm = arm_of(rig.robot)
        setup = fit_setup(forward(arm, q[~out]), xyz_mm[~out])
        seen = (setup.T_world_base @ forward(arm, q[out]) @ setup.T_flange_tool)[:, :3, 3]
        measured[out] = np.linalg.norm(seen - xyz_mm[out], axis=1)
        expected[out] = expected_errors(with_tool(rig, setup.T_flange_tool[:3, 3]), q[out], q[~out]).expected_mm
    return Ranked(expected, measured, group, group % FOLDS)


def touched(data: Path, name: str) -> Iterator[tuple[str, Ranked]]:
    """Ranking of the touches of an arm: neighbourhoods left out, frame and tool taught at each placement."""
    text = (
        f'name: {name.replace("_", "-")}\n{load_arm(MUKCA_ARMS[name]).text}tests: {{touch: {{sockets: ["0", "1"]}}}}\n'
    )
    rig, tables = parse(text, "cell.yaml"), sorted(mukca(data / "mukca", name).items())
    q = np.concatenate([q for _, (_, q) in tables])
    socket = np.concatenate([socket for _, (socket, _) in tables])
    placement = np.repeat(np.arange(len(tables)), [len(q) for _, (_, q) in tables])
    group = groups_of(q)
    expected, measured = np.full(len(q), np.nan), np.full(len(q), np.nan)
    for fold in range(FOLDS):
        out = group % FOLDS == fold
        runs = []
        for number, (place, _) in enumerate(tables):
            rows = ~out & (placement == number)
            if rows.any():
                runs.append(run_of(rig, TouchTable(socket[rows], q[rows]), place, place))
        found = calibrated(runs, text)
        for number in range(len(tables)):
            asked, given = (np.flatnonzero(mask & (placement == number)) for mask in (out, ~out))
            if len(asked) and len(given) >= FEWEST_TAUGHT and set(socket[asked]) <= set(socket[given]):
                ball, errors = touch_errors(rig, q, socket, given, asked)
                measured[asked] = errors
                expected[asked] = expected_errors(with_tool(found, ball), q[asked], q[given]).expected_mm
    rows = np.isfinite(measured)
    yield f"{name}, frame taught at each placement", _of(Ranked(expected, measured, group, group % FOLDS), rows)


def touch_errors(rig: Rig, q: Array, socket: NDArray[np.str_], given: Integers, asked: Integers) -> tuple[Array, Array]:
    """Ball (3,) mm on the flange by the given touches of one placement and the nominal arm, and by how far
    (m,) mm the nominal arm misses the sockets at the touches asked."""
    names, T = np.unique(socket[given]).tolist(), forward(arm_of(rig.robot), q)
    unknown = np.zeros((len(given), 3, 3 + 3 * len(names)))
    for row, k in enumerate(given.tolist()):
        begin = 3 + 3 * names.index(socket[k])
        unknown[row, :, :3], unknown[row, :, begin : begin + 3] = T[k, :3, :3], -np.eye(3)
    found = np.linalg.lstsq(unknown.reshape(-1, unknown.shape[2]), -T[given, :3, 3].ravel(), rcond=None)[0]
    ball, sockets = found[:3], found[3:].reshape(-1, 3)
    places = T[asked, :3, 3] + T[asked, :3, :3] @ ball
    errors = places - sockets[[names.index(name) for name in socket[asked].tolist()]]
    return ball, np.linalg.norm(errors, axis=1)


def row_of(name: str, ranked: Ranked) -> list[str]:
    square = ranked.measured_mm**2
    half = np.sqrt(square[ranked.better(ranked.expected_mm)].mean())
    ratio, low, high = ranked.ratio(ranked.expected_mm)
    best = ranked.ratio(ranked.measured_mm)[0]
    whole = np.sqrt(square.mean())
    shares = f"{ratio:.2f} ({low:.2f} to {high:.2f})", f"{best:.2f}"
    return [name, str(len(square)), f"{whole:.3f}", f"{half:.3f}", *shares]


def draw(given: Namespace) -> Iterator[tuple[str, Path]]:
    names = ("UR10 B", "UR10 D", *MUKCA_ARMS)
    yield from ((name, given.data) for name in names if name.startswith(given.only))


def judged(case: tuple[str, Path]) -> list[list[str]]:
    name, data = case
    rankings = tracked(data, name[-1]) if name.startswith("UR10") else touched(data, name)
    return [row_of(title, ranked) for title, ranked in rankings]


def report(done: Sequence[list[list[str]]]) -> str:
    return markdown(HEAD, [row for rows in done for row in rows])


TRIAL = Trial(
    draw,
    judged,
    report,
    options={"DATA": (Path, "directory with ipa-ur10 and mukca"), "only": ("", "series whose name begins so (all)")},
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

"""Calibrations of measured arms by few readings, chosen or random: `scripts/dev few_readings DATA 4`.

Poses or touches of a public series are the possible readings, 150 others the targets. `rig calibrate` fits the first
readings, drawn at random or chosen one at a time for the targets (`rig plan --next`). The first table compares the
error at the targets, in a frame taught there, with the stated u. The second compares the acts of the plan with the act
after all readings, and for 12 chosen readings with the act of the least loss by the measured errors; and predicted
errors with the real ones: of 12 chosen readings before any reading, and of 32 by the first 12.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.apps.certify.target_errors import Work, causes_of
from analysis.apps.planning.next_reading import CORRECT_MIN, MANY, PRICE, next_step
from analysis.apps.planning.possible_readings import TOUCH_MIN, Reading, pool_of_readings, poses_at
from analysis.correction.pose_uncertainty import covered, pose_uncertainty
from analysis.correction.support import supports, why_nothing
from analysis.correction.work import rest_moves_mm
from analysis.robot.geometry.pose_setup import fit_setup
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.tables import PoseTable, TouchTable
from rigs.arms import load_arm
from rigs.errors import RigError
from rigs.load import parse
from rigs.rig import Rig
from tests.support.measured_series import MUKCA_ARMS, mukca
from tests.support.pose_runs import calibrated, with_tool
from tests.support.trial import Trial, main, markdown, seeds
from tests.trials.certify import POOLS, rig_text
from tests.trials.certify import pool_of as measured_pool
from tests.worlds.arms.seven_axes import run_of

Array = NDArray[np.float64]
POSSIBLE, LEFT_OUT, FIRST = 300, 150, 6
"""Possible readings, poses that are left out, and random readings at the begin of a choice."""
RANDOM, CHOSEN = (12, 20, 40), (8, 12, 20, 12 + MANY)
LAST = f"chosen {12 + MANY}"
Case = tuple[str, int, Path]
_RP_MM = 0.1
"""Pose repeatability of the Panda and the iiwa 14 (makers' data sheets)."""


@dataclass(frozen=True)
class Series:
    """Readings of a measured arm in the order of a draw, and targets at q (t, axes) rad."""

    nominal: Rig
    readings: list[Reading]
    calibrated: Callable[[NDArray[np.intp]], Rig]
    """Calibrate with some of the readings."""
    q: Array
    moves: Array
    """Measured displacements (t, 3) mm of the targets from those of the nominal arm, in a frame taught there."""
    taught_there: Callable[[Array], Array]
    """Remove what a frame and tool taught at the targets remove from displacements (k, t, 3) mm."""
    rp_mm: float | None


def divided(count: int, rng: np.random.Generator) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Possible readings and targets, drawn from so many poses."""
    read, rest = np.split(rng.permutation(count), [min(POSSIBLE, 2 * count // 3)])
    return read, rest[:LEFT_OUT]


def poses(name: str, data: Path, rng: np.random.Generator) -> Series:
    (q, xyz_mm), text = measured_pool(data, name), rig_text(name)
    nominal = parse(text, "cell.yaml")
    tool_mm = fit_setup(forward(arm_of(nominal.robot), q), xyz_mm).T_flange_tool[:3, 3]
    read, out = divided(len(q), rng)

    def of_readings(chosen: NDArray[np.intp]) -> Rig:
        rows = np.sort(read[chosen])
        rig = calibrated([run_of(nominal, PoseTable(q[rows], xyz_mm[rows], None), "used", "cell")], text)
        return rig if name == "WAM" else with_tool(rig, tool_mm)

    moves = rest_moves_mm(xyz_mm[out], forward(arm_of(nominal.robot), q[out]))
    rp_mm = load_arm(POOLS[name][1]).repeatability_mm
    return Series(nominal, poses_at(q[read]), of_readings, q[out], moves, lambda moves: moves, rp_mm)


def touches(name: str, data: Path, rng: np.random.Generator) -> Series:
    """Touches of both sockets at two placements. The ball is where it fits the nominal arm best."""
    placements = sorted(mukca(data / "mukca", name).items())
    found = [placements[k] for k in sorted(rng.permutation(len(placements))[:2])]
    sockets = np.concatenate([np.char.add(f"{placement}-", holes) for placement, (holes, _) in found])
    q = np.concatenate([angles for _, (_, angles) in found])
    arm = f"name: arm\n{load_arm(MUKCA_ARMS[name]).text}"
    flange = forward(arm_of(parse(arm, "cell.yaml").robot), q)
    ball_mm = np.linalg.lstsq(_unknown(flange, sockets), -flange[:, :3, 3].ravel())[0][:3]
    names = ", ".join(dict.fromkeys(sockets.tolist()))
    text = (
        f"{arm}  tool: {{xyz_mm: {ball_mm.round(3).tolist()}}}\n"
        f"tests: {{touch: {{sockets: [{names}], ball_mm: [0, 0, 0]}}}}\n"
    )
    nominal = parse(text, "cell.yaml")
    read, out = divided(len(q), rng)

    def of_readings(chosen: NDArray[np.intp]) -> Rig:
        rows = np.sort(read[chosen])
        return calibrated([run_of(nominal, TouchTable(sockets[rows], q[rows]), "used", "cell")], text)

    balls = forward(arm_of(nominal.robot), q[out])
    unknown = _unknown(balls, sockets[out])

    def taught_there(moves: Array) -> Array:
        flat = moves.reshape(-1, len(unknown)).T
        return np.asarray((flat - unknown @ np.linalg.lstsq(unknown, flat)[0]).T.reshape(moves.shape))

    readings = [Reading("touch", TOUCH_MIN, q[k], str(sockets[k])) for k in read]
    moves = taught_there(-balls[None, :, :3, 3])[0]
    return Series(nominal, readings, of_readings, q[out], moves, taught_there, _RP_MM)


def _unknown(frames: Array, sockets: NDArray[np.str_]) -> Array:
    """Columns (3 n, 3 + 3 s): displacements of balls by a shift of the ball on the tool, and by that of each socket."""
    of_sockets = np.equal.outer(sockets, np.unique(sockets))[:, None, :, None] * np.eye(3)[:, None]
    return np.concatenate([frames[:, :3, :3].reshape(-1, 3), of_sockets.reshape(3 * len(frames), -1)], axis=1)


def judged(rig: Rig, series: Series) -> dict[str, Any]:
    """Errors in mm at targets after a correction, share within 2 u of those with a known u, and the planned act.

    `mm` is the error of the nominal arm if rig advises against the model."""
    q, wanted = series.q, forward(arm_of(rig.robot), series.q)
    step = next_step(rig, (q, wanted))
    found: dict[str, Any] = {"act": step.act, "worthwhile": step.worthwhile}
    if why_nothing(rig):
        return found | {"mm": _rms(series.moves), "within": None}
    work = Work(q, wanted, np.full_like(q, np.nan), np.full(len(q), np.nan))
    causes = causes_of(rig, work, (q, wanted), series.rp_mm)
    mean = sum((cause.mean for cause in causes if cause.nature == "correctable"), np.zeros_like(series.moves))
    wrong = series.moves - series.taught_there(mean[None])[0]
    common = np.concatenate([series.taught_there(cause.common) for cause in causes])
    variance = (common**2).sum(axis=(0, 2)) + sum((cause.own**2).sum(axis=(1, 2)) for cause in causes)
    inside = covered(pose_uncertainty(rig, supports(rig)), q)
    is_known = np.ones(len(q), dtype=bool) if inside is None else inside
    is_within = np.linalg.norm(wrong, axis=1) < 2 * np.sqrt(variance)
    return found | {"mm": _rms(wrong), "within": float(np.mean(is_within[is_known])) if is_known.any() else None}


def _rms(moves: Array) -> float:
    return float(np.sqrt(np.mean((moves**2).sum(axis=1))))


def draw(given: Namespace) -> Iterator[Case]:
    for seed in seeds(given):
        yield from ((name, seed, given.data) for name in (*POOLS, *MUKCA_ARMS) if name.startswith(given.only))


def judge(case: Case) -> dict[str, Any]:
    name, seed, data = case
    series = (touches if name in MUKCA_ARMS else poses)(name, data, np.random.default_rng(seed))
    pool, count = pool_of_readings(series.nominal, series.readings, series.q, series.q), len(series.readings)
    chosen = pool.choose(max(CHOSEN), range(FIRST))
    choices = {f"random {number}": np.arange(number) for number in RANDOM} | {"all": np.arange(count)}
    choices |= {f"chosen {number}": chosen[:number] for number in CHOSEN}
    found: dict[str, Any] = {"series": name, "nominal": _rms(series.moves)}
    for label, choice in choices.items():
        try:
            rig = series.calibrated(choice)
        except RigError:  # a socket with a single touch
            found[label] = {"act": "measure", "worthwhile": 0, "mm": found["nominal"], "within": None}
            continue
        found[label] = judged(rig, series)
        if label == "chosen 12":
            further = [series.readings[k] for k in chosen[12:]]
            found[label]["predicted_mm"] = predicted_mm(rig, further, series.q)
            found[label]["typical_mm"] = pool.u_mm(chosen[:12])
    minutes = float(pool.minutes[chosen[12:]].sum())
    found["chosen 12"].setdefault("predicted_mm", None)
    found["chosen 12"]["right"] = right_act(found["nominal"], found["chosen 12"]["mm"], found[LAST]["mm"], minutes)
    return found


def predicted_mm(rig: Rig, further: Sequence[Reading], q: Array) -> float | None:
    """Error in mm rms at targets q (n, axes) rad that a calibration predicts after further readings."""
    if why_nothing(rig):
        return None
    u_mm = pool_of_readings(rig, further, q, q).u_mm(np.arange(len(further)))
    return float(np.hypot(u_mm, pose_uncertainty(rig, supports(rig)).unexplained_mm))


def right_act(now: float, corrected: float, later: float, minutes: float) -> str:
    """Act of the least loss by measured errors in mm: now, corrected, and corrected after further readings."""
    losses = {
        "nothing": now,
        "correct": corrected + PRICE * now * CORRECT_MIN,
        "measure": later + PRICE * now * (CORRECT_MIN + minutes),
    }
    return min(losses, key=lambda act: losses[act])


def _labels(found: dict[str, Any]) -> list[str]:
    return [label for label in found if isinstance(found[label], dict)]


def report(done: Sequence[dict[str, Any]]) -> str:
    labels = _labels(done[0])
    errors, acts = [], []
    for name in dict.fromkeys(one["series"] for one in done):
        of_name = [one for one in done if one["series"] == name]
        cells = [name, str(len(of_name)), f"{np.median([one['nominal'] for one in of_name]):.3f}"]
        for label in labels:
            within = [one[label]["within"] for one in of_name if one[label]["within"] is not None]
            share = f" ({100 * np.mean(within):.0f})" if within else ""
            cells.append(f"{np.median([one[label]['mm'] for one in of_name]):.3f}{share}")
        errors.append(cells)
        for label in labels:
            counts = Counter(one[label]["act"] for one in of_name)
            same = sum(one[label]["act"] == one["all"]["act"] for one in of_name)
            said = ", ".join(f"{act} {count}" for act, count in counts.most_common())
            acts.append([name, label, said, f"{same} of {len(of_name)}"])
        rights = Counter(one["chosen 12"]["right"] for one in of_name)
        agree = sum(one["chosen 12"]["act"] == one["chosen 12"]["right"] for one in of_name)
        right = ", ".join(f"{act} {count}" for act, count in rights.most_common())
        acts.append([name, "right after chosen 12", right, f"{agree} of {len(of_name)} as said"])
        pairs = [(one["chosen 12"]["predicted_mm"], one[LAST]["mm"]) for one in of_name]
        ratios = [predicted / real for predicted, real in pairs if predicted is not None]
        acts.append(
            [name, f"predicted by 12 / real error of {LAST}", ", ".join(f"{ratio:.2f}" for ratio in ratios), ""]
        )
    return "\n\n".join(
        [
            markdown(("series", "draws", "nominal", *labels), errors),
            markdown(("series", "readings", "acts", "as with all"), acts),
        ]
    )


TRIAL = Trial(
    draw,
    judge,
    report,
    lambda one: f"{one['series']}: " + ", ".join(f"{label} {one[label]['mm']:.3f}" for label in _labels(one)),
    count=4,
    options={
        "DATA": (Path, "directory with ipa-ur10, jacobi and mukca"),
        "only": ("", "series whose name begins so (all)"),
    },
    keeps=True,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

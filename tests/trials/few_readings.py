"""Calibrations of measured arms by few readings, chosen or random: `scripts/dev few_readings DATA 4`.

Poses of a public series are the possible readings, and 150 others the targets. `rig calibrate` fits the first readings,
drawn at random or chosen one at a time for the targets (`rig plan --next`). The first table compares the error at the
targets, in a frame taught there, with the stated u. The second compares the acts of the plan with the act after all
readings, and predicted errors with the real ones: of 12 chosen readings before any reading, and of 32 by the first 12.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.apps.planning.next_reading import MANY, next_step
from analysis.apps.planning.possible_readings import pool_of_readings, poses_at
from analysis.apps.postures.target_errors import Work, causes_of
from analysis.correction.pose_uncertainty import covered, pose_uncertainty
from analysis.correction.support import supports, why_nothing
from analysis.correction.work import rest_moves_mm
from analysis.robot.geometry.pose_setup import fit_setup
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.load import parse
from rigs.rig import Rig
from tests.support.pose_runs import calibrated, with_tool
from tests.support.trial import Trial, main, markdown, seeds
from tests.trials.certify import POOLS, rig_text
from tests.trials.certify import pool_of as measured_pool
from tests.worlds.arms.seven_axes import run_of

Array = NDArray[np.float64]
POSSIBLE, LEFT_OUT, FIRST = 300, 150, 6
"""Possible readings, poses that are left out, and random readings at the begin of a choice."""
RANDOM, CHOSEN = (12, 20, 40), (8, 12, 20, 12 + MANY)
Case = tuple[str, int, Path]


def judged(rig: Rig, name: str, q: Array, xyz_mm: Array) -> dict[str, Any]:
    """Errors in mm at targets after a correction, share within 2 u of those with a known u, and the planned act.

    `mm` is the error of the nominal arm if rig advises against the model."""
    wanted, is_used = forward(arm_of(rig.robot), q), not why_nothing(rig)
    moves, step = rest_moves_mm(xyz_mm, wanted), next_step(rig, (q, wanted))
    found: dict[str, Any] = {"act": step.act, "worthwhile": step.worthwhile}
    if not is_used:
        return found | {"mm": _rms(np.linalg.norm(moves, axis=1)), "within": None}
    work = Work(q, wanted, np.full_like(q, np.nan), np.full(len(q), np.nan))
    causes = causes_of(rig, work, (q, wanted), load_arm(POOLS[name][1]).repeatability_mm)
    wrong = np.linalg.norm(moves - sum(cause.mean for cause in causes if cause.nature == "correctable"), axis=1)
    u_mm = np.sqrt(sum((cause.common**2).sum(axis=(0, 2)) + (cause.own**2).sum(axis=(1, 2)) for cause in causes))
    inside = covered(pose_uncertainty(rig, supports(rig)), q)
    is_known = np.ones(len(q), dtype=bool) if inside is None else inside
    within = float(np.mean((wrong < 2 * u_mm)[is_known])) if is_known.any() else None
    return found | {"mm": _rms(wrong), "within": within}


def _rms(sizes: Array) -> float:
    return float(np.sqrt(np.mean(sizes**2)))


def draw(given: Namespace) -> Iterator[Case]:
    for seed in seeds(given):
        yield from ((name, seed, given.data) for name in POOLS if name.startswith(given.only))


def judge(case: Case) -> dict[str, Any]:
    name, seed, data = case
    (q, xyz_mm), text = measured_pool(data, name), rig_text(name)
    nominal = parse(text, "cell.yaml")
    tool_mm = fit_setup(forward(arm_of(nominal.robot), q), xyz_mm).T_flange_tool[:3, 3]
    order = np.random.default_rng(seed).permutation(len(q))
    possible = min(POSSIBLE, 2 * len(q) // 3)
    read, out = order[:possible], order[possible : possible + LEFT_OUT]
    pool = pool_of_readings(nominal, poses_at(q[read]), q[out], q[out])
    order_chosen = pool.choose(max(CHOSEN), range(FIRST))
    chosen = read[order_chosen]
    choices = {f"random {count}": read[:count] for count in RANDOM} | {"all": read}
    choices |= {f"chosen {count}": chosen[:count] for count in CHOSEN}
    found: dict[str, Any] = {"series": name}
    for label, choice in choices.items():
        rows = np.sort(choice)
        rig = calibrated([run_of(nominal, PoseTable(q[rows], xyz_mm[rows], None), "used", "cell")], text)
        rig = rig if name == "WAM" else with_tool(rig, tool_mm)
        found[label] = judged(rig, name, q[out], xyz_mm[out])
        if label == "chosen 12":
            found[label]["predicted_mm"] = predicted_mm(rig, q[chosen[12:]], q[out])
            found[label]["typical_mm"] = pool.u_mm(order_chosen[:12])
    return found


def predicted_mm(rig: Rig, further: Array, q: Array) -> float | None:
    """Error in mm rms at targets q (n, axes) rad that a calibration predicts after further poses (m, axes) rad."""
    if why_nothing(rig):
        return None
    u_mm = pool_of_readings(rig, poses_at(further), q, q).u_mm(np.arange(len(further)))
    return float(np.hypot(u_mm, pose_uncertainty(rig, supports(rig)).unexplained_mm))


def report(done: Sequence[dict[str, Any]]) -> str:
    labels = [label for label in done[0] if label not in ("series", "case")]
    errors, acts = [], []
    for name in dict.fromkeys(one["series"] for one in done):
        of_name = [one for one in done if one["series"] == name]
        cells = [name, str(len(of_name))]
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
        last = f"chosen {12 + MANY}"
        pairs = [(one["chosen 12"]["predicted_mm"], one[last]["mm"]) for one in of_name]
        ratios = [predicted / real for predicted, real in pairs if predicted is not None]
        acts.append(
            [name, f"predicted by 12 / real error of {last}", ", ".join(f"{ratio:.2f}" for ratio in ratios), ""]
        )
    return "\n\n".join(
        [markdown(("series", "draws", *labels), errors), markdown(("series", "readings", "acts", "as with all"), acts)]
    )


TRIAL = Trial(
    draw,
    judge,
    report,
    lambda one: (
        f"{one['series']}: " + ", ".join(f"{label} {one[label]['mm']:.3f}" for label in one if label != "series")
    ),
    count=4,
    options={"DATA": (Path, "directory with ipa-ur10 and jacobi"), "only": ("", "series whose name begins so (all)")},
    keeps=True,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

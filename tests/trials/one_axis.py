"""One axis at a time in five arms of another generator: curves by direction and plays against the truth.

Each arm has what sound ones show and a play of one joint. `scripts/dev one_axis` prints, of poses one axis at a time,
how far curves and plays are off in their u, and what a diagnosis of 30 poses, of these sweeps, and of both leaves at
200 poses that had no part, mm rms.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from analysis.diagnosis.diagnose import diagnose
from analysis.procedures.pose import evaluate
from analysis.robot.kinematics.arm import arm_of
from analysis.runs.tables import PoseTable
from rigs.effects import Backlash
from rigs.schema.effect import name_of
from rigs.schema.robot import Robot
from tests.support.trial import Trial, main
from tests.worlds.arms.one_axis import ARMS, BALL_MM, driven, true_curve
from tests.worlds.arms.seven_axes import Truth, draw_postures, run_of


def draw(given: Namespace) -> Iterable[tuple[int, str]]:
    return enumerate(ARMS)


def judged(case: tuple[int, str]) -> str:
    return "\n".join(_lines(*case))


def _lines(number: int, name: str) -> Iterator[str]:
    rig, truth, sweeps = driven(name, number)
    result = evaluate(sweeps, arm_of(rig.robot), 0.02)
    plays = [result.figures[f"axis{curve.axis}_reversal_deg"] for curve in result.axes]
    true = np.degrees(truth.play)
    off = np.array([(play.value - size) / play.u for play, size in zip(plays, true, strict=True)])
    curves = [missed / u for *_, missed, u in (true_curve(truth, sweeps, curve) for curve in result.axes)]
    hidden = int(np.argmax(true))
    yield (
        f"{name}: {len(sweeps.q)} poses; play of axis {hidden + 1} {plays[hidden]}, true {true[hidden]:.4f}; plays "
        f"within 2 u {np.count_nonzero(np.abs(off) < 2)} of {len(off)}; curves off by "
        f"{np.sqrt(np.mean(np.concatenate(curves) ** 2)):.2f} u rms"
    )
    rng = np.random.default_rng(200 + number)
    few, judge = (_poses(rig.robot, truth, rng, count) for count in (30, 200))
    for label, tables in (("30 poses", [few]), ("one axis at a time", [sweeps]), ("both", [few, sweeps])):
        runs = [run_of(rig, table, f"{label} {k}", "cell") for k, table in enumerate(tables)]
        found = diagnose(rig, runs, [run_of(rig, judge, "judge", "cell")], [], lambda _: None)
        assert found.held_out is not None
        size = next((one for one in found.standing if isinstance(one.effect, Backlash)), None)
        play = f"play {size.effect.width_deg:.4f} ± {size.sd['width_deg']:.4f}" if size else "no play"
        names = ", ".join(name_of(one.effect) for one in found.standing) or "nothing"
        left = [found.held_out.before_um / 1e3, found.held_out.calibrated_um / 1e3]
        yield f"  {label}: {left[0]:.3f} -> {left[1]:.3f} mm; {names}; {play}"


def _poses(robot: Robot, truth: Truth, rng: np.random.Generator, count: int) -> PoseTable:
    """Poses over the workspace, each from the one before, as the tracker saw them."""
    q = draw_postures(robot, rng, count)
    came_from = np.vstack([q[:1], q[:-1]])
    seen = truth.places(q, came_from, BALL_MM) + rng.normal(0, truth.scatter_mm, (count, 3))
    return replace(PoseTable(q, seen, None), came_from=came_from)


TRIAL = Trial(draw, judged)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

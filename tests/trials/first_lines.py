"""First line and tiles of drawn diagnoses, for a reader who says what to do tomorrow.

`scripts/dev first_lines` shows sound arms, usual causes, faults, unknown causes, too few readings and movements, of the
arms of `tests/worlds`, in random order and without the truth. `--key` adds truth and right act for the judge. Goal: a
reader who knows nothing of the cases is right in nine of ten.
"""

from __future__ import annotations

import io
import sys
from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console

from analysis import diagnose
from analysis.apps.report.blocks import on_screen
from analysis.apps.report.diagnosis_answer import summary_blocks
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import LANGUAGES, Language, texts_of
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.load import parse
from rigs.rig import Rig
from tests.support.trial import Trial, main
from tests.worlds.arms.seven_axes import (
    Array,
    Fault,
    Seen,
    Truth,
    constants_of,
    draw_truth,
    pose_table,
    run_of,
    touch_table,
)
from tests.worlds.arms.yielding_base import OnStand, Stand
from tests.worlds.stranger.screws import arm_from

BALL_MM = np.array([30.0, 10.0, 120.0])
"""Place of the target on the flange."""
POSES = 120


@dataclass(frozen=True)
class Drawn:
    """Runs of a cell: those to diagnose, and those at other postures for validation."""

    rig: Rig
    runs: list[Measured]
    unseen: list[Measured]
    tolerance_um: float | None = None


@dataclass(frozen=True)
class Case:
    """A cell, its truth, and the right acts of tomorrow."""

    name: str
    truth: str
    tomorrow: str
    draw: Callable[[np.random.Generator], Drawn]


def rig_of(arm: str) -> Rig:
    """An arm of the library with two sockets."""
    return parse(f"name: {arm}\n{load_arm(arm).text}tests: {{touch: {{sockets: [A, B]}}}}\n", f"{arm}.yaml")


def perfect(rig: Rig, *faults: Fault) -> Truth:
    """An arm without errors except zeros that are off."""
    nominal, truth = constants_of(rig.robot), draw_truth(rig.robot, np.random.default_rng(0), ())
    zero = np.zeros_like(nominal.zero)
    for fault in faults:
        zero[fault.axis - 1] = np.radians(fault.size)
    off = replace(nominal, a=0 * zero, d=0 * zero, alpha=0 * zero, zero=zero)
    arm = arm_from(replace(nominal, zero=nominal.zero + zero))
    return Truth(arm, 0 * zero, (), 0 * zero, truth.scatter_mm, off)


def tracked(
    *faults: Fault,
    arm: str = "ur10e",
    poses: int = POSES,
    changed: Callable[[Rig, Truth], Seen] = lambda _, truth: truth,
    tolerance_um: float | None = None,
    is_perfect: bool = False,
    is_validated: bool = True,
) -> Callable[[np.random.Generator], Drawn]:
    """Poses of a tracker, and others for validation."""

    def draw(rng: np.random.Generator) -> Drawn:
        rig = rig_of(arm)
        truth = perfect(rig, *faults) if is_perfect else draw_truth(rig.robot, rng, faults)
        seen = changed(rig, truth)
        used = run_of(rig, pose_table(rig.robot, seen, rng, BALL_MM, poses), "poses")
        other = [run_of(rig, pose_table(rig.robot, seen, rng, BALL_MM, 40), "others")] * is_validated
        return Drawn(rig, [used], other, tolerance_um)

    return draw


def touched(*faults: Fault, touches: int) -> Callable[[np.random.Generator], Drawn]:
    """Touches of two sockets by hand."""

    def draw(rng: np.random.Generator) -> Drawn:
        rig = rig_of("ur10e")
        truth = draw_truth(rig.robot, rng, faults)
        return Drawn(rig, [run_of(rig, touch_table(rig.robot, truth, rng, BALL_MM, 2, touches), "touches")], [])

    return draw


def moving(shift_mm: Array, *faults: Fault, of_tool: bool = False) -> Callable[[np.random.Generator], Drawn]:
    """Poses of a tracker; from the middle on, the base or the target on the tool has moved."""

    def draw(rng: np.random.Generator) -> Drawn:
        rig = rig_of("ur10e")
        truth = draw_truth(rig.robot, rng, faults)
        table = pose_table(rig.robot, truth, np.random.default_rng(5), BALL_MM, POSES)
        ball_mm = BALL_MM + shift_mm * of_tool
        later = pose_table(rig.robot, truth, np.random.default_rng(5), ball_mm, POSES)
        half = POSES // 2
        xyz_mm = np.concatenate([table.xyz_mm[:half], later.xyz_mm[half:] + shift_mm * (not of_tool)])
        return Drawn(rig, [run_of(rig, PoseTable(table.q, xyz_mm, None), "poses")], [])

    return draw


def slipped(rig: Rig, truth: Truth) -> Truth:
    """A joint whose link jumps by 0.4 degrees beyond 20 degrees, which no effect of the library describes."""
    return replace(truth, slip=(1, np.radians(-60.0), np.radians(0.4)))


def scattering(rig: Rig, truth: Truth) -> Truth:
    """An instrument that scatters by 2 mm."""
    return replace(truth, scatter_mm=2.0)


def wavy(rig: Rig, truth: Truth) -> Truth:
    """Joints with waves of many orders that are no whole numbers per turn."""
    rng = np.random.default_rng(8)
    waves = tuple(
        (joint, float(order), np.radians(0.04), float(rng.uniform(0, 6)))
        for joint in range(6) for order in rng.uniform(2.2, 9, 3)
    )  # fmt: skip
    return replace(truth, waves=(*truth.waves, *waves))


def geared(_: Rig, truth: Truth) -> Truth:
    """An axis with a gear error of low order, which its load resembles."""
    return replace(truth, waves=(*truth.waves, (2, 2.0, np.radians(0.03), 0.7)))


def on_soft_stand(rig: Rig, truth: Truth) -> OnStand:
    """An arm whose base tilts under its weight."""
    return OnStand(rig.robot, truth, Stand(soft=2e-5, stiff=2e-6, turned=0.4))


CASES = (
    Case("perfect", "no error but the scatter of the tracker", "nothing", tracked(is_perfect=True)),
    Case("tolerated", "ordinary small errors, within the tolerance of 5 mm", "nothing necessary; may correct the robot",
         tracked(tolerance_um=5000.0)),
    Case("ordinary", "ordinary small errors of all constants", "correct the robot (calibrate)", tracked()),
    Case("ordinary-fanuc", "ordinary small errors of all constants", "correct the robot (calibrate)",
         tracked(arm="fanuc-lr-mate-200id")),
    Case("usual-zero", "the zero of axis 3 is off by 0.1°, as usual after mastering by eye",
         "correct the robot, or re-master axis 3", tracked(Fault("zero", 3, 0.1), is_perfect=True)),
    Case("usual-zero-2", "the zero of axis 2 is off by 0.08°", "correct the robot, or re-master axis 2",
         tracked(Fault("zero", 2, -0.08))),
    Case("usual-length", "the link length d of axis 4 is off by 1 mm", "correct the robot",
         tracked(Fault("length", 4, 1.0, "d"))),
    Case("zero", "the zero of axis 4 is off by 0.5°", "re-master axis 4, or correct the robot",
         tracked(Fault("zero", 4, 0.5))),
    Case("play", "axis 3 has a play of 0.15°",
         "repair axis 3; if it is not named, measure as proposed, do not calibrate",
         tracked(Fault("play", 3, 0.15))),
    Case("play-2", "axis 2 has a play of 0.3°",
         "repair axis 2; if it is not named, measure as proposed, do not calibrate",
         tracked(Fault("play", 2, 0.3))),
    Case("compliance", "axis 3 yields by 0.02 °/Nm", "repair axis 3 (or correct the robot)",
         tracked(Fault("compliance", 3, 0.02))),
    Case("soft-small-arm", "axis 2 of a small industrial arm yields by 0.02 °/Nm",
         "correct the robot; no check of rig file or mastering",
         tracked(Fault("compliance", 2, 0.02), arm="abb-irb-120")),
    Case("parallel-axes", "the offset d of axis 3 is off by 3 mm, which those of the parallel axes 2 and 4 look like",
         "correct the robot", tracked(Fault("length", 3, 3.0, "d"))),
    Case("low-gear", "axis 3 has a gear error of two waves per turn, 0.03°", "correct the robot",
         tracked(changed=geared)),
    Case("out-of-range", "the zero of axis 3 is off by 8°", "check mastering and rig file",
         tracked(Fault("zero", 3, 8.0))),
    Case("soft-stand", "the base tilts under the weight of the arm",
         "bolt the base down, or calibrate the robot on this stand", tracked(changed=on_soft_stand)),
    Case("slipped", "the link of axis 2 jumps by 0.4° at one angle, which rig does not know",
         "do not correct; search: measure or check as rig proposes", tracked(changed=slipped)),
    Case("wavy", "waves of many orders on every joint, which rig does not know",
         "measure more, or find the cause; a correction alone is not enough", tracked(changed=wavy)),
    Case("scatter", "the tracker scatters by 2 mm", "find why the readings scatter: measure postures twice",
         tracked(changed=scattering, is_validated=False)),
    Case("few-poses", "ordinary small errors, 12 poses", "measure more",
         tracked(poses=12, is_validated=False)),
    Case("few-touches", "the zero of axis 3 is off by 0.3°, 8 touches", "measure more",
         touched(Fault("zero", 3, 0.3), touches=8)),
    Case("base-moved", "base or tracker moved by 1.5 mm halfway", "fasten what moved, measure again",
         moving(np.array([1.2, -0.8, 0.4]))),
    Case("tool-moved", "the target moved by 2 mm on the tool halfway", "fasten the tool or target, measure again",
         moving(np.array([1.5, 1.0, -0.9]), of_tool=True)),
)  # fmt: skip


@dataclass(frozen=True)
class Shown:
    """A case as it is shown: its number, the seed of its cell, the language, and whether the truth is added."""

    number: int
    case: Case
    seed: int
    language: Language
    has_key: bool


def draw(given: Namespace) -> Iterator[Shown]:
    order = np.random.default_rng(given.seed).permutation(len(CASES)).tolist()
    for number, k in enumerate(order, 1):
        yield Shown(number, CASES[k], 1000 * given.seed + k, given.lang, given.key)


def judged(shown: Shown) -> str:
    texts, case = texts_of(shown.language), shown.case
    cell = case.draw(np.random.default_rng(shown.seed))
    found = diagnose(cell.runs, rig=cell.rig, unseen=cell.unseen, tolerance_um=cell.tolerance_um)
    console = Console(width=100, file=io.StringIO())
    with console.capture() as text:
        console.rule(str(shown.number))
        console.print(on_screen(summary_blocks(summarise(found, texts), texts)))
    key = f"\n{case.name}: {case.truth}. Right: {case.tomorrow}.\n" if shown.has_key else ""
    return text.get() + key


TRIAL = Trial(
    draw,
    judged,
    options={
        "seed": (1, "seed of the cells and of their order (1)"),
        "key": (False, "add the truth and the right act"),
        "lang": ("en", "language (en)", LANGUAGES),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

"""Arms on stands of another generator: whether a base that yields is named, with its size, and never on a firm one.

`scripts/dev stands 24` draws arms on firm pedestals, on carts and on columns, half of them with a fault of a joint, and
measures 150 poses of each, or touches of `--sockets` fixed to the floor. Printed: what was named, sizes within 2 u, and
the error at poses that were not used, nominal and calibrated.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.judge.result import Diagnosis, Named
from analysis.procedures.shared.test_kind import path_of
from analysis.robot.geometry.pose_setup import fit_setup, position_error
from analysis.robot.model.predict import model_of, moved
from rigs.arms import load_arm
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.effect import name_of, size_field
from tests.support.trial import Trial, main, seeds
from tests.worlds.arms.seven_axes import Fault, draw_faults, draw_truth, pose_table, run_of, touch_table
from tests.worlds.arms.yielding_base import OnStand, Stand

ARMS = ("ur10e", "doosan-m1013", "kuka-kr-6-r900-2", "ur5e", "franka-fr3", "abb-irb-120")
BALL_MM = np.array([10.0, -5.0, 120.0])
KINDS = ("firm", "cart", "column")
_STIFF_JOINTS = 0.15
"""Compliance of the joints of machines relative to light arms, which the generator draws: up to 0.9 µrad/Nm."""


@dataclass(frozen=True)
class Case:
    """An arm on its stand: hidden and identified effects."""

    kind: str
    arm: OnStand
    faults: tuple[Fault, ...]
    found: Diagnosis

    def names(self, *, of_base: bool) -> list[Named]:
        """The faults that are named, of the base or of the arm."""
        return [named for named in self.found.standing if named.effect.effect.startswith("base_") == of_base]


def draw_stand(kind: str, rng: np.random.Generator) -> Stand:
    """A pedestal bolted to a floor (up to 0.2 µrad/Nm), a cart or table of profiles (1 to 4 µrad/Nm), or a lifting
    column (4 to 15 µrad/Nm about one line, a quarter of that across; 5 to 9 mrad were measured under a light arm)."""
    height = float(rng.uniform(300, 1000))
    if kind == "firm":
        return Stand(height, *[rng.uniform(2e-8, 1.2e-7)] * 2, anchors=rng.uniform(0, 8e-8))
    if kind == "cart":
        return Stand(height, *[rng.uniform(4e-7, 1.5e-6)] * 2, anchors=rng.uniform(6e-7, 2.5e-6), firmer=0.1)
    soft = float(rng.uniform(4e-6, 1.5e-5))
    return Stand(height, soft, soft / 4, rng.uniform(0, np.pi), sag=rng.choice([0.0, 1e-4]), firmer=0.1)


def draw_case(number: int, sockets: int) -> tuple[Rig, Case]:
    rng = np.random.default_rng([57, number])
    kind, text = KINDS[number % 3], load_arm(ARMS[(number // 3) % len(ARMS)]).text
    rig = parse(f"name: cell\n{text}" + ("tests: {touch: {sockets: [A, B, C, D]}}\n" if sockets else ""), "cell.yaml")
    faults = draw_faults(rig.robot, rng, 1) if rng.uniform() < 0.5 else ()
    truth = draw_truth(rig.robot, rng, faults)
    if rig.robot.design == "industrial":
        truth = replace(truth, soft=_STIFF_JOINTS * truth.soft)
    arm = OnStand(rig.robot, truth, draw_stand(kind, rng))
    if sockets:
        table = touch_table(rig.robot, arm, rng, BALL_MM, sockets, 60)
        return rig, Case(kind, arm, faults, diagnose(rig, [run_of(rig, table)], [], [], lambda _: None))
    table = pose_table(rig.robot, arm, rng, BALL_MM, 150)
    return rig, Case(kind, arm, faults, diagnose(rig, [run_of(rig, table)], [], [], lambda _: None))


def errors_um(rig: Rig, case: Case) -> tuple[float, float]:
    """The error at poses that were not used, µm rms, of the nominal arm and of the calibrated one."""
    rng = np.random.default_rng(8)
    unseen = pose_table(rig.robot, case.arm, rng, BALL_MM, 150)
    found = [named.effect for named in case.found.written]
    found += list(case.found.calibrated.effects) if case.found.calibrated else []
    errors = []
    for effects in ([], found):
        model = model_of(rig, effects)
        T = moved(model, path_of(model, unseen)).T
        missed = position_error(T, unseen.xyz_mm, fit_setup(T, unseen.xyz_mm))
        errors.append(1e3 * float(np.sqrt(np.mean(np.sum(missed**2, axis=1)))))
    return errors[0], errors[1]


@dataclass(frozen=True)
class Counted:
    """The line of an arm: its kind of stand, whether its base is named, base sizes and how many are within 2 u, its
    faults and how many are named, names in vain."""

    kind: str
    line: str
    is_base_named: bool
    sizes: tuple[bool, ...]
    faults: tuple[bool, ...]
    vain: int


def draw(given: Namespace) -> Iterator[tuple[int, int]]:
    for number in seeds(given):
        yield number, given.sockets


def counted(case: tuple[int, int]) -> Counted:
    rig, arm = draw_case(*case)
    truth, said, sizes = arm.arm.tensor_deg(), [], []
    for one in arm.found.standing:
        field = size_field(one.effect)
        size, u = float(getattr(one.effect, field)), one.sd[field]
        said.append(f"{name_of(one.effect)} {size:.3g} ± {u:.2g}")
        if one.effect.effect == "base_yields" and arm.kind != "firm":
            sizes.append(abs(size - truth.get(one.effect.seat, 0.0)) < 2 * u)
    hidden = {fault.name for fault in arm.faults}
    names = {name_of(one.effect) for one in arm.names(of_base=False)}
    nominal, calibrated = errors_um(rig, arm)
    really = ", ".join(f"{way} {size:.3g}" for way, size in truth.items())
    line = (
        f"{case[0]} {rig.robot.name}, {arm.kind} ({really}; {' '.join(sorted(hidden)) or 'no fault'}): "
        f"{'; '.join(said) or 'nothing'}; {nominal:.0f} -> {calibrated:.0f} µm elsewhere"
    )
    is_named = bool(arm.names(of_base=True))
    return Counted(arm.kind, line, is_named, tuple(sizes), tuple(one in names for one in hidden), len(names - hidden))


def report(done: Sequence[Counted]) -> str:
    lines = []
    for kind in KINDS:
        own = [one.is_base_named for one in done if one.kind == kind]
        lines.append(f"{kind}: base named in {sum(own)} of {len(own)}")
    sizes, faults = ([hit for one in done for hit in getattr(one, key)] for key in ("sizes", "faults"))
    lines.append(
        f"sizes within 2 u: {sum(sizes)} of {len(sizes)}; faults of the arm named: {sum(faults)} of {len(faults)}; "
        f"in vain: {sum(one.vain for one in done)}"
    )
    return "\n".join(lines)


TRIAL = Trial(
    draw,
    counted,
    report,
    line=lambda one: one.line,
    count=12,
    options={"sockets": (0, "sockets that 60 touches share; poses without it")},
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

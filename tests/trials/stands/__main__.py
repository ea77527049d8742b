"""Arms on stands of another generator: whether a base that yields is named, with its size, and never on a firm one.

`scripts/dev stands 24` draws arms on firm pedestals, on carts and on columns, half of them with a fault of a joint, and
measures 150 poses of each, or touches of `--sockets` fixed to the floor. Printed: what was named, sizes within 2 u, and
the error at poses that were not used, nominal and calibrated.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.judge.result import Diagnosis, Named
from analysis.procedures.prediction import path_of
from analysis.robot.geometry.pose_setup import fit_setup, position_error
from analysis.robot.model.predict import model_of, moved
from rigs.arms import load_arm
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.effect import name_of, size_field
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
    """One case of a seed."""
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=int, nargs="?", default=12, help="arms to draw")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--sockets", type=int, default=0, help="sockets that 60 touches share; poses without it")
    asked = parser.parse_args()
    seen = dict.fromkeys(KINDS, 0)
    named, sizes, within, vain, faults, faults_named = dict.fromkeys(KINDS, 0), 0, 0, 0, 0, 0
    for number in range(asked.first, asked.first + asked.cases):
        rig, case = draw_case(number, asked.sockets)
        truth, of_base = case.arm.tensor_deg(), case.names(of_base=True)
        seen[case.kind] += 1
        named[case.kind] += bool(of_base)
        said = []
        for one in case.found.standing:
            field = size_field(one.effect)
            size, u = float(getattr(one.effect, field)), one.sd[field]
            said.append(f"{name_of(one.effect)} {size:.3g} ± {u:.2g}")
            if one.effect.effect == "base_yields" and case.kind != "firm":
                sizes += 1
                within += abs(size - truth.get(one.effect.seat, 0.0)) < 2 * u
        hidden = {fault.name for fault in case.faults}
        arm_names = {name_of(one.effect) for one in case.names(of_base=False)}
        faults, faults_named = faults + len(hidden), faults_named + len(hidden & arm_names)
        vain += len(arm_names - hidden)
        nominal, calibrated = errors_um(rig, case)
        really = ", ".join(f"{way} {size:.3g}" for way, size in truth.items())
        print(
            f"{number} {rig.robot.name}, {case.kind} ({really}; {' '.join(sorted(hidden)) or 'no fault'}): "
            f"{'; '.join(said) or 'nothing'}; {nominal:.0f} -> {calibrated:.0f} µm elsewhere",
            flush=True,
        )
    for kind in KINDS:
        print(f"{kind}: base named in {named[kind]} of {seen[kind]}")
    print(
        f"sizes within 2 u: {within} of {sizes}; faults of the arm named: {faults_named} of {faults}; in vain: {vain}"
    )


if __name__ == "__main__":
    main()

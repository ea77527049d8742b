"""Arms whose displayed angles or motors are coupled: errors of single motors, by the named axis and size.

`scripts/dev linkage --cases 20` draws arms of an independent world that computes the linkage
(`tests/worlds/linkage.py`). `diagnose` gets 60 postures of a tracker, each measured twice, and `moved` 28 touches of
two sockets and eight new ones. Printed: named with a size within 2 u or 15 %, wrong sizes, missing, and other names.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.evidence.observation import by_socket, observe
from analysis.movement.inference import compare, study
from analysis.robot.predict import model_of
from analysis.runs.tables import PoseTable, TouchTable
from rigs.arms import load_arm
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.effect import name_of, size_field
from tests.support.trial import Trial, main, seeds
from tests.worlds import linkage as world
from tests.worlds.arms.seven_axes import run_of

FAULTS: dict[str, tuple[str, tuple[float, float]]] = {
    "zero": ("joint_offset", (0.15, 0.4)),
    "play": ("backlash", (0.08, 0.2)),
    "wave": ("transmission_error", (0.08, 0.2)),
    "soft": ("compliance", (1.5e-3, 4e-3)),
}
"""Name in rig, and range of sizes in deg, for soft in deg/Nm: several usual sizes."""
MOVED_DEG = (0.05, 0.15)
"""Range of a zero that moves."""
CASES = [(kind, axis) for kind in FAULTS for axis in (2, 3)]
POSTURES, NOISE_MM, SCATTER_MM = 60, 0.02, 0.05
_ALMOST = 0.15


def rig_for(name: str) -> Rig:
    """Rig of an arm: that of the library, with masses, or with the linkage of a palletiser."""
    shape = world.SHAPES[name]
    robot = load_arm("fanuc-m-10ia" if shape.drive == "crank" else name).robot
    upper = {"mass_kg": 12.0, "centre_mm": (shape.upper / 2, 0.0, 0.0)}
    forearm = {"mass_kg": 8.0, "centre_mm": (shape.elbow, shape.forearm / 2, 0.0)}
    axes = tuple(
        axis.model_copy(update={1: upper, 2: forearm}.get(k, {})) for k, axis in enumerate(robot.axes)
    )  # fmt: skip
    update: dict[str, Any] = {"axes": axes, "payload_kg": 5.0}
    if shape.drive == "crank":
        update["drives"] = robot.coupling
    rig = parse("name: linkage\n" + load_arm("ur5e").text + "tests: {touch: {sockets: [A, B]}}\n", "linkage.yaml")
    return rig.model_copy(update={"robot": robot.model_copy(update=update)})


def drawn(
    name: str, kind: str, axis: int, seed: int, sizes: tuple[float, float]
) -> tuple[world.LinkedArm, world.LinkedArm, float, np.random.Generator]:
    """Draw a sound arm, the same arm with a fault, and the size of the fault."""
    rng = np.random.default_rng([31, seed, axis, *kind.encode()])
    size = float(rng.uniform(*sizes) * (rng.choice([-1, 1]) if kind == "zero" else 1))
    arm = world.drawn_arm(world.SHAPES[name], rng)
    return arm, world.with_fault(arm, kind, axis, size), size, rng


def diagnosed(name: str, kind: str, axis: int, seed: int) -> tuple[str, list[str]]:
    """True if a fault is `right`, of the wrong `size` or `missing` in a diagnosis, and the other names."""
    _, arm, size, rng = drawn(name, kind, axis, seed, FAULTS[kind][1])
    rig = rig_for(name)
    q, came_from, xyz = world.tracked(arm, POSTURES, rng, NOISE_MM)
    found = diagnose(rig, [run_of(rig, PoseTable(q, xyz, None, came_from=came_from))], [], [], lambda _: None)
    wanted, answer, others = f"{FAULTS[kind][0]} {axis}", "missing", list[str]()
    for one in found.standing:
        key = size_field(one.effect)
        value = float(getattr(one.effect, key))
        if name_of(one.effect).startswith(wanted):
            true = arm.zero_deg(axis) if kind == "zero" else size
            answer = "right" if abs(value - true) <= max(2 * one.sd[key], _ALMOST * abs(true)) else "size"
        else:
            others.append(f"{name_of(one.effect)} {value:+.3g}±{one.sd.get(key, 0):.1g}")
    return answer, others


def moved(name: str, kind: str, axis: int, seed: int) -> tuple[str, list[str]]:
    """True if a moved zero is `right`, of the wrong `size` or `missing` in `rig moved`, and another cause."""
    before, after, size, rng = drawn(name, kind, axis, seed, MOVED_DEG)
    model = model_of(rig_for(name))
    sockets = ["A", "B"] * 14
    reference = world.touch_postures(before, sockets, SCATTER_MM, rng)
    new, _ = world.touched(after, reference[:8], sockets[:8], SCATTER_MM, rng)
    runs = [
        by_socket(observe(model, TouchTable(np.array(sockets[: len(motors)]), before.displayed(motors)), "trial"))
        for motors in (reference, new)
    ]
    compared = compare(study(runs[0]), runs[1])
    cause = compared.identified_cause
    if cause is None:
        return "missing", []
    if (cause.what, cause.axis) != ("zero", axis):
        return "missing", [f"{cause.what} {cause.axis or ''}"]
    found_deg = float(np.degrees(compared.posterior.estimates[cause].mean[0]))
    return ("right" if abs(found_deg - size) <= _ALMOST * abs(size) else "size"), []


def draw(given: Namespace) -> Iterator[tuple[str, str, str, int, int]]:
    """Command, arm, fault, axis and seed of each case; `rig moved` judges zeros only."""
    for command in given.command:
        for name in given.arm:
            for kind, axis in CASES:
                if kind in given.kind and axis in given.axis and (command == "diagnose" or kind == "zero"):
                    yield from ((command, name, kind, axis, seed) for seed in seeds(given))


def judged(case: tuple[str, str, str, int, int]) -> tuple[tuple[str, ...], str, list[str]]:
    command, *of_arm = case
    answer, others = (moved if command == "moved" else diagnosed)(*of_arm)  # type: ignore[arg-type]
    return tuple(map(str, case[:4])), answer, others


def report(done: Sequence[tuple[tuple[str, ...], str, list[str]]]) -> str:
    lines = []
    for group in dict.fromkeys(key for key, *_ in done):
        answers = [answer for key, answer, _ in done if key == group]
        others = [name for key, _, names in done if key == group for name in names]
        counts = ", ".join(f"{answers.count(key)} {key}" for key in ("right", "size", "missing"))
        lines.append(f"{' '.join(group)}: {counts} of {len(answers)}; others {others}")
    return "\n".join(lines)


TRIAL = Trial(
    draw,
    judged,
    report,
    line=lambda one: f"{' '.join(one[0])}: {one[1]} {one[2]}",
    count=3,
    options={
        "arm": (tuple(world.SHAPES), "arms (all)"),
        "kind": (tuple(FAULTS), "faults (all)"),
        "axis": ((2, 3), "motors (2 3)"),
        "command": (("moved", "diagnose"), "commands (moved diagnose)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

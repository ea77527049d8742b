"""Uncertainties that `rig plan` predicts, beside those of diagnoses of planted faults.

Faults are planted in arms and cells of a generator that shares no code with rig, whose noise is as wide as the plan
assumes. For each name: the standard uncertainty that the plan foretells (u), that a diagnosis states, and how far its
size is off the truth, both in u.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.diagnosis.plan.expected import ExpectedPosterior, expected_posterior, planned_blocks
from analysis.runs.noise.cell_noise import BALL_MM, JOINT_DEG, SLOW_MM, TARGET_MM, WHITE_MM
from rigs.effects import healthy_size
from rigs.load import load
from tests.support.trial import Trial, main, seeds
from tests.trials.blind.trial import diagnose_case, import_case, runs_of
from tests.worlds.stranger.faults import SIZE, Fault, healthy_of
from tests.worlds.stranger.real.known import Noise, generate_known

NOISE = Noise(WHITE_MM.rms, SLOW_MM.rms, 1.5, JOINT_DEG.rms, BALL_MM.rms, TARGET_MM.rms)
"""As the plan assumes it; slow noise is correlated over 1.5 s there."""
TESTS = ("yaw", "roll", "radial")
TIMES, SIGMAS = 12.0, 12.0
"""A fault is of as many healthy sizes, and of as many standard uncertainties, whichever is more."""
FAULTS = {
    "paper-fanuc": (
        Fault("backlash", {"axis": 2}, 0.0),
        Fault("transmission_error", {"axis": 1}, 0.0, {"order": 8.0, "phase_deg": 40.0}),
        Fault("compliance", {"axis": 2}, 0.0, {"payload_kg": 5.0}),
        Fault("reversal_spike", {"axis": 2}, 0.0, {"decay_s": 0.3}),
        Fault("thermal_growth", {}, 0.0, {"time_constant_s": 600.0}),
    ),
    "ur10e": (
        Fault("joint_offset", {"axis": 3}, 0.0),
        Fault("link_geometry", {"axis": 3, "field": "a"}, 0.0),
        Fault("link_geometry", {"axis": 5, "field": "d"}, 0.0),
        Fault("servo_lag", {"axis": 2}, 0.0),
        Fault("wrist_coupling", {"from_axis": 4, "to_axis": 5}, 0.0),
    ),
}


@dataclass(frozen=True)
class Case:
    """One diagnosis: the size's standard uncertainty, and how far it is off, in the plan's u; nan where not named. And
    the names of all effects that it found."""

    of: str
    u: float
    seed: int
    stated: float
    off: float
    names: tuple[str, ...]


def draw(given: Namespace) -> Iterator[tuple[str, Fault, float, int]]:
    """Rig, fault, the plan's u and the seed of each diagnosis."""
    for robot, faults in FAULTS.items():
        if given.rig not in (None, robot):
            continue
        expected = expected_posterior(*planned_blocks(load(robot)[0].model_copy(update={"effects": ()}), TESTS, 3))
        for fault in faults:
            if fault.name.startswith(given.name):
                size = max(TIMES * healthy_of(fault.effect, fault.keys), SIGMAS * foretold(expected, fault))
                u = foretold(expected, fault, size)
                yield from ((robot, fault.sized(size), u, seed) for seed in seeds(given))


def foretold(expected: ExpectedPosterior, fault: Fault, size: float | None = None) -> float:
    """The plan's standard uncertainty of the size of a fault; of a gear at the nearest order that it looks at."""
    forms = [one for one in expected.candidates if one.name == fault.name]
    order = fault.shape.get("order", 0.0)
    near = [abs(getattr(one.effect, "order", order) - order) for one in forms]
    own = [one for one, away in zip(forms, near, strict=True) if away == min(near)]
    one = own[len(own) // 2]
    healthy = healthy_size(one.effect)
    return expected.sd(one, size and size / healthy) * healthy


def tried(case: tuple[str, Fault, float, int]) -> Case:
    """One arm with the fault, measured and diagnosed."""
    robot, fault, u, seed = case
    of = f"{robot} {fault.name}, {fault.size:.3g}"
    with tempfile.TemporaryDirectory() as made:
        directory = Path(made) / "case"
        truth = generate_known(robot, fault, NOISE, seed, directory)
        import_case(directory)
        answer = diagnose_case(runs_of(directory)["train"], [], [])
    names = tuple(str(one["name"]) for one in answer["effects"])
    found = [one for one in answer["effects"] if one["name"] == fault.name and _is_near(one, fault)]
    if not found:
        return Case(of, u, seed, float("nan"), float("nan"), names)
    size = found[0]["parameters"][SIZE[fault.effect]]
    return Case(of, u, seed, size["sd"] / u, (abs(size["value"]) - abs(truth)) / u, names)


def _is_near(one: dict[str, Any], fault: Fault) -> bool:
    order = fault.shape.get("order")
    return order is None or abs(one["parameters"]["order"]["value"] / order - 1) < 0.1


def line(one: Case) -> str:
    said = f"not named, but {', '.join(one.names) or 'nothing'}"
    if np.isfinite(one.off):
        said = f"stated {one.stated:5.2f} u  off {one.off:+6.2f} u"
    return f"  {one.of}, seed {one.seed}: {said}"


def report(cases: Sequence[Case]) -> str:
    groups = {of: [case for case in cases if case.of == of] for of in dict.fromkeys(case.of for case in cases)}
    lines = [told(of, own[0].u, own) for of, own in groups.items()]
    return "\n".join([*lines, told("all", float("nan"), cases)])


def told(what: str, u: float, cases: Sequence[Case]) -> str:
    """A line: the stated uncertainty (median) and the scatter about the truth (rms), both over the plan's."""
    stated = np.array([one.stated for one in cases])
    off = np.array([one.off for one in cases])
    named = np.isfinite(stated)
    if not named.any():
        return f"{what:<44} u {u:8.3g}  named 0 of {len(cases)}"
    ratio, scatter = float(np.median(stated[named])), float(np.sqrt(np.mean(off[named] ** 2)))
    sure, count = scatter / np.sqrt(2 * named.sum()), f"{named.sum()} of {len(cases)}"
    return f"{what:<44} u {u:8.3g}  stated {ratio:5.2f} u  off {scatter:5.2f} ± {sure:.2f} u  named {count}"


TRIAL = Trial(
    draw,
    tried,
    report,
    line=line,
    count=4,
    options={"rig": (str, "only this one", FAULTS), "name": ("", "only names that begin so")},
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

"""Diagnosis of delivered Universal Robots arms, sound and with hidden faults, with and without their constants.

Each arm is measured by a table of 60 to 200 tracker poses and by yaw, roll and radial circles. Sound arms must have no
fault. A hidden fault is a zero of 0.05° (poses), or play or a gear error of six healthy sizes (circles). Arm 9 has no
circles with its constants, because its joints are counted from half a turn.
"""

from __future__ import annotations

import json
import sys
import tempfile
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.support.command_line import ran
from tests.support.trial import Trial, main
from tests.worlds.factory import FactoryArm, arms, cell_for, write_circles, write_poses
from tests.worlds.stranger.faults import Fault

_NOISE_MM, _ZERO_DEG, _TIMES = 0.03, 0.05, 6.0
_U = 2.0


@dataclass(frozen=True)
class Case:
    """An arm with one hidden fault, or none, measured by `poses` or `circles`."""

    arm: FactoryArm
    by: str
    fault: Fault | None
    seed: int


def draw(given: Namespace) -> Iterator[tuple[Case, bool]]:
    """Each case without and with the calibration file of its arm."""
    for case in cases(given.seed):
        is_chosen = 0 in given.arms or case.arm.number in given.arms
        if is_chosen and case.by in given.by and not (given.sound and case.fault):
            yield case, False
            if case.by == "poses" or not case.arm.counted.any():
                yield case, True


def judged(drawn: tuple[Case, bool]) -> tuple[str, list[str]]:
    """The line of a diagnosis, and the counters that it increases."""
    case, with_file = drawn
    found = diagnosed(case, with_file=with_file)
    return _line(case, found, with_file=with_file), list(_scored(case, found, with_file=with_file))


def report(done: Sequence[tuple[str, list[str]]]) -> str:
    counts = Counter(key for _, keys in done for key in keys)
    return "\n".join(f"{key}: {counts[key]}" for key in sorted(counts))


def cases(seed: int) -> Iterator[Case]:
    """Yield each arm sound and with hidden faults."""
    for arm in arms():
        rng = np.random.default_rng([seed, arm.number])
        for by in ("poses", "circles"):
            yield Case(arm, by, None, int(rng.integers(2**31)))
        zero = Fault("joint_offset", {"axis": int(rng.integers(2, 6))}, _ZERO_DEG * float(rng.choice([-1, 1])))
        yield Case(arm, "poses", zero, int(rng.integers(2**31)))
        axis, phase = int(rng.integers(1, 6)), float(rng.uniform(0, 360))
        play = Fault("backlash", {"axis": axis}, 0.01 * _TIMES, {"preload": 0.0})
        gear = Fault("transmission_error", {"axis": axis}, 0.005 * _TIMES, {"order": 2.0, "phase_deg": phase})
        yield Case(arm, "circles", play if arm.number % 2 else gear, int(rng.integers(2**31)))


def diagnosed(case: Case, *, with_file: bool) -> dict[str, Any] | str:
    """Write the tables of a case, and return the JSON of `rig diagnose`, or its error."""
    rng = np.random.default_rng(case.seed)
    with tempfile.TemporaryDirectory() as scratch:
        directory = Path(scratch)
        case.arm.write_yaml(directory / "calibration.yaml")
        words = ["--calibration", "calibration.yaml"] if with_file else []
        if case.by == "poses":
            zero = np.zeros(6)
            if case.fault:
                zero[int(case.fault.keys["axis"]) - 1] = case.fault.size
            count = int(rng.integers(60, 201))
            write_poses(case.arm, directory / "t.csv", count, rng, zero_deg=zero, raw=with_file, noise_mm=_NOISE_MM)
            words = ["t.csv", "--arm", case.arm.model, *words]
        else:
            cell = cell_for(case.arm)
            (directory / "cell.yaml").write_text(yaml.safe_dump(cell.data, sort_keys=False), encoding="utf-8")
            for test, table in write_circles(case.arm, cell, directory, rng, [case.fault] if case.fault else []):
                made = ("import", table.name, "--rig", "cell.yaml", "--test", test, "-o", f"runs/{table.stem}")
                done = ran(*made, cwd=directory)
                if done.returncode:
                    return done.stderr.strip()
            words = ["runs", "--rig", "cell.yaml", *words]
        done = ran("diagnose", *words, "--json", cwd=directory)
        return json.loads(done.stdout) if not done.returncode else done.stderr.strip()


def _line(case: Case, found: dict[str, Any] | str, *, with_file: bool) -> str:
    hidden = f"{case.fault.name} {case.fault.size:g}" if case.fault else "sound"
    head = f"arm {case.arm.number} {case.arm.model}, {case.by}, {hidden}, {'with' if with_file else 'without'} file: "
    if isinstance(found, str):
        return head + found
    effects = [
        f"{effect['name']}{'!' if effect['stands'] else ''} "
        + " ".join(f"{value['value']:.4g}" for value in effect["parameters"].values())
        for effect in found["effects"]
    ]
    return f"{head}{found['condition']}; {', '.join(effects) or '-'}; {_distances(found)}; {found['seconds']:.0f} s"


def _distances(found: dict[str, Any]) -> str:
    passport = found["passport"] or {}
    known = {key: passport[key] for key in ("data_sheet_um", "controller_um") if passport.get(key)}
    return ", ".join(f"{key} {of['value']:.1f} ± {of['u']:.1f}" for key, of in known.items())


def _scored(case: Case, found: dict[str, Any] | str, *, with_file: bool) -> Iterator[str]:
    """Counters that a diagnosis increases."""
    kind = case.fault.effect if case.fault else "sound"
    where = f"{kind}, {case.by}, {'with' if with_file else 'without'} file"
    yield f"{where}: diagnoses"
    if isinstance(found, str):
        yield f"{where}: refused"
        return
    faults = [effect["name"] for effect in found["effects"] if effect["stands"]]
    if case.fault is None:
        if faults:
            yield f"{where}: false fault"
        yield f"{where}: condition {found['condition']}"
        if with_file and (of := (found["passport"] or {}).get("controller_um")):
            yield f"{where}: distance from the controller {'within' if of['value'] <= _U * of['u'] else 'beyond'} 2 u"
        return
    if case.fault.name in [effect["name"] for effect in found["effects"]]:
        yield f"{where}: named"
    if case.fault.name in faults:
        yield f"{where}: called a fault"
    if set(faults) - {case.fault.name}:
        yield f"{where}: other fault"


TRIAL = Trial(
    draw,
    judged,
    report,
    line=lambda one: one[0],
    options={
        "seed": (1, "seed of faults and poses (1)"),
        "arms": ([0], "numbers of the arms (0: all)"),
        "by": (("poses", "circles"), "only these measurements (both)"),
        "sound": (False, "only sound arms"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

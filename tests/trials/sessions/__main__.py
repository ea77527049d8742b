"""Whole sessions in emulated cells, with hidden effects and with trouble: finished, named, error before and after.

Arms, effects and trouble are drawn from the seed: one to three effects in an arm, a maker's language, and up to three
of ten kinds of trouble. What is said of the arm is read from what the session wrote; what was hidden it never sees.
"""

from __future__ import annotations

import json
import math
import random
import shutil
import statistics
import subprocess
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import yaml

from analysis.apps.session.session_state import Aim, SessionDirectory
from rigs.load import load
from tests.support.trial import Trial, main

ARMS = ("paper-fanuc", "ur10e-cell")
MAKERS = ("ur", "fanuc", "kuka", "abb", "yaskawa", "linuxcnc")  # this order belongs to the published seeds
AT_ROBOT = ("stop", "pause", "other", "twice", "late")
"""Actions of the operator: stop or pause a program, start a wrong one, start it twice, or come late."""
AT_COMPUTER = ("kill", "interrupt", "kill_rigd", "by_hand", "stranger")
"""The session is killed, or ended by Ctrl-C; rigd is killed; somebody else leaves a run; so does another cell."""
MINUTES = 5.0
LONGEST_S = 1500
"""A session that computes for longer hangs."""


@dataclass(frozen=True)
class Drawn:
    """A session to be tried: what is hidden in which arm, whose language, and the trouble with its time."""

    number: int
    arm: str
    maker: str
    effects: list[dict[str, Any]]
    at_robot: dict[int, str]
    at_computer: list[tuple[float, str]]


def drawn(seed: int, number: int, *, quiet: bool) -> Drawn:
    """Draw a trial."""
    chance = random.Random(f"{seed} {number}")
    effects = [
        _effect(chance, kind) for kind in chance.sample(("play", "zero", "gear", "length"), chance.randint(1, 3))
    ]
    count = 0 if quiet else chance.randint(1, 3)
    kinds = chance.sample(AT_ROBOT + AT_COMPUTER, count)
    at_robot = {chance.randrange(0, 9): kind for kind in kinds if kind in AT_ROBOT}
    at_computer = [(chance.uniform(20, 150), kind) for kind in kinds if kind in AT_COMPUTER]
    maker = MAKERS[(number + seed) % len(MAKERS)]
    arm = chance.choice(ARMS) if maker == "ur" else ARMS[0]
    return Drawn(number, arm, maker, effects, at_robot, sorted(at_computer))


def _effect(chance: random.Random, kind: str) -> dict[str, Any]:
    """Draw an effect that a person would want to know of: three to ten times as large as usual."""
    sign = chance.choice((-1, 1))
    match kind:
        case "play":
            axis = chance.randint(1, 5)
            return {"effect": "backlash", "axis": axis, "width_deg": round(chance.uniform(0.01, 0.03), 4)}
        case "zero":
            offset = round(sign * chance.uniform(0.03, 0.1), 4)
            return {"effect": "joint_offset", "axis": chance.randint(2, 5), "offset_deg": offset}
        case "gear":
            return {
                "effect": "transmission_error",
                "axis": chance.choice((4, 6)),
                "order": chance.choice((2, 4, 8, 12)),
                "amplitude_deg": round(chance.uniform(0.012, 0.04), 4),
                "phase_deg": round(chance.uniform(0, 360), 1),
            }
    delta = round(sign * chance.uniform(0.3, 1.0), 3)
    return {"effect": "link_geometry", "axis": chance.choice((3, 4)), "field": "a", "delta": delta}


def judged(case: tuple[Drawn, Path, str]) -> dict[str, Any]:
    """Run a session to its end in a separate process, and return the result. An existing result is read."""
    trial, root, aim = case
    place = root / f"{trial.number:03d}"
    request = json.dumps(_request(trial, place, aim))
    came, kept = place / "came.json", place / "request.json"
    if not (came.exists() and kept.read_text() == request):
        _run(trial, place, request)
    return outcome(trial, place / "session", json.loads(came.read_text()) if came.exists() else {})


def _request(trial: Drawn, place: Path, aim: str) -> dict[str, Any]:
    return {
        "rig": str(place / "cell.yaml"),
        "directory": str(place / "session"),
        "aim": aim,
        "minutes": MINUTES,
        "maker": trial.maker,
        "effects": str(place / "hidden.yaml"),
        "hidden": trial.effects,
        "seed": trial.number,
        "at_robot": trial.at_robot,
        "at_computer": trial.at_computer,
    }


def _run(trial: Drawn, place: Path, request: str) -> None:
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    _, text = load(trial.arm)
    data = yaml.safe_load(text)
    data["name"] = f"trial-{trial.number}-{trial.arm}"
    data["tests"]["circle"] |= {"laps": 1, "speed_mm_s": 50}
    (place / "cell.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
    (place / "hidden.yaml").write_text(yaml.safe_dump({"effects": trial.effects, "eccentricity_mm": [0.5, -0.3, 0.1]}))
    (place / "request.json").write_text(request)
    command = [sys.executable, str(Path(__file__).with_name("troubled_session.py")), str(place / "request.json")]
    with (place / "log.txt").open("ab") as log, suppress(subprocess.TimeoutExpired):
        subprocess.run(command, stdout=log, stderr=log, timeout=LONGEST_S, check=False)


def outcome(trial: Drawn, directory: Path, came: dict[str, Any]) -> dict[str, Any]:
    """Result of a session. came: kind of ending; empty if the process was killed."""
    session = SessionDirectory(directory).read()
    found: dict[str, Any] = {
        "number": trial.number,
        "arm": trial.arm,
        "maker": trial.maker,
        "hidden": [_name(effect) for effect in trial.effects],
        "trouble": [*trial.at_robot.values(), *(kind for _, kind in trial.at_computer)],
        "exits": came.get("exits", []),
        "minutes": round(came.get("minutes", 0.0), 1),
        "computing_s": round(came.get("computing_s", 0.0)),
        "finished": bool(session and session.report),
    }
    if session is None:
        return found
    found |= {
        "runs": sum(len(step.tries) for step in session.steps),
        "planned": len(session.steps),
        "condition": session.answer and session.answer.condition,
        "way": session.correction and session.correction.way,
        "lost": sum(not (directory / "runs" / one.run).is_dir() for step in session.steps for one in step.tries),
    }
    diagnosis: dict[str, Any] = {"effects": [], "acts": []}
    if session.answer is not None:
        diagnosis = json.loads((directory / "found" / session.answer.found / "diagnosis.json").read_text())
    standing = [effect for effect in diagnosis["effects"] if effect["stands"]]
    named = set().union(*map(_names, standing))
    found |= {
        "named": [name for name in found["hidden"] if name in named],
        "invented": [_name(effect) for effect in standing if not _names(effect) & set(found["hidden"])],
        "off_u": _off_u(trial, standing),
        "first_act": " ".join(act[key] for act in diagnosis["acts"][:1] for key in ("kind", "effect") if act[key]),
    }
    verified = session.verified
    if verified and verified.elsewhere_before:
        before, after = verified.elsewhere_before, verified.elsewhere_after
        found |= {"before_um": before.um, "after_um": after.um if after else None, "u_um": after.u_um if after else 0.0}
        stated = session.correction and session.correction.elsewhere
        if stated and after:
            found |= {"stated_um": stated.um, "stated_u_um": stated.u_um}
            found["kept"] = abs(after.um - stated.um) <= 2 * math.hypot(stated.u_um, after.u_um)
    return found


def _names(effect: dict[str, Any]) -> set[str]:
    """The name of an effect that was found, and those of its rivals."""
    return {_name(one) for one in (effect, *effect["rivals"])}


def _off_u(trial: Drawn, standing: list[dict[str, Any]]) -> list[float]:
    """Distance of each named hidden effect from the truth, in u."""
    off: list[float] = []
    for effect in standing:
        hidden = next((one for one in trial.effects if _name(one) == _name(effect)), {})
        for key, found in effect["parameters"].items():
            if key in hidden and key != "phase_deg" and found["sd"]:
                off.append(round((found["value"] - hidden[key]) / found["sd"], 2))
    return off


def _name(effect: dict[str, Any]) -> str:
    return f"{effect['effect']} {effect.get('axis')}"


def line_of(found: dict[str, Any]) -> str:
    errors = f"{found.get('before_um')} -> {found.get('after_um')} um" if "before_um" in found else "-"
    if "stated_um" in found:
        errors += f" (stated {found['stated_um']} ± {found['stated_u_um']}{'' if found['kept'] else ', NOT KEPT'})"
    end = "finished" if found["finished"] else "NOT FINISHED"
    return (
        f"{found['number']:3} {found['arm']:11} {found['maker']:7} {end}"
        f" named {len(found.get('named', []))} of {len(found['hidden'])} ({', '.join(found['hidden'])});"
        f" {found.get('condition')}; first {found.get('first_act')};"
        f" {found.get('way')}: {errors}; {found['minutes']} min, {found.get('runs')} runs of"
        f" {found.get('planned')}; trouble {found['trouble']}, exits {found['exits']}"
    )


def draw(given: Namespace) -> Iterator[tuple[Drawn, Path, str]]:
    for number in range(given.count):
        yield drawn(given.seed, number, quiet=given.quiet), given.output.resolve(), given.aim


def report(outcomes: Sequence[dict[str, Any]]) -> str:
    hidden = sum(len(one["hidden"]) for one in outcomes)
    named = sum(len(one.get("named", [])) for one in outcomes)
    off = [abs(value) for one in outcomes for value in one.get("off_u", [])]
    both = [one for one in outcomes if one.get("after_um") is not None]
    lines = [
        f"sizes within 2 u: {sum(value <= 2 for value in off)} of {len(off)}",
        f"effects that were not hidden: {sum(len(one.get('invented', [])) for one in outcomes)}",
        f"finished {sum(one['finished'] for one in outcomes)} of {len(outcomes)}, named {named} of {hidden}",
        f"runs lost: {sum(one.get('lost', 0) for one in outcomes)}",
    ]
    for key in ("before_um", "after_um") if both else ():
        values = sorted(one[key] for one in both)
        p90 = values[min(len(values) - 1, int(0.9 * len(values)))]
        lines.append(f"{key} at the other place: median {statistics.median(values):.1f}, p90 {p90:.1f} µm")
    stated = [one for one in both if "kept" in one]
    minutes = [one["minutes"] for one in outcomes]
    used = [(one["runs"], one["planned"]) for one in outcomes if "runs" in one]
    return "\n".join([
        *lines,
        f"as stated within 2 u: {sum(one['kept'] for one in stated)} of {len(stated)}",
        f"larger than before: {sum(one['after_um'] > one['before_um'] for one in both)} of {len(both)}",
        f"minutes: median {statistics.median(minutes):.1f}, most {max(minutes):.1f}",
        f"programs driven {sum(runs for runs, _ in used)}, planned {sum(planned for _, planned in used)}",
    ])  # fmt: skip


TRIAL = Trial(
    draw,
    judged,
    report,
    line=line_of,
    count=3,
    seed=1,
    options={
        "quiet": (False, "draw no trouble"),
        "aim": ("faults", "what the sessions are for (faults)", get_args(Aim)),
        "output": (Path("sessions"), "directory for all of them (sessions)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

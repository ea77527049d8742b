"""A realistic case: an arm with all healthy effects and possibly faults, measured in a noisy cell.

`case-0001/` contains `rig.yaml` (without effects), `unseen.yaml` (the same cell with a different circle), a CSV table
per run, and `runs.csv` with the description of each table. The truth is written to a different directory. Kind and seed
determine everything.
"""

from __future__ import annotations

import csv
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.worlds.stranger.cell import ROBOTS, Cell, Place, moved
from tests.worlds.stranger.faults import SIZE, Fault
from tests.worlds.stranger.gauges import Link, own_errors
from tests.worlds.stranger.measure import trace_of
from tests.worlds.stranger.motion import Motion, Track, approaches, track_of, visits
from tests.worlds.stranger.reach import OutOfReachError
from tests.worlds.stranger.real import arm as arms
from tests.worlds.stranger.real import noise as noises
from tests.worlds.stranger.real.oracle import Oracle, Seen
from tests.worlds.stranger.real.programs import BY_RUN, Program, at, circle, program
from tests.worlds.stranger.real.setups import centred, watched
from tests.worlds.stranger.screws import Array
from tests.worlds.stranger.sight import REPEATS, Sight, sight_of
from tests.worlds.stranger.tables import write_rows

REAL_KINDS = (
    "healthy", "one", "one_large", "two", "three", "foreign_large", "foreign_third", "background_low",
    "background_high", "heavy_tails", "off_grid", "dirty",
)  # fmt: skip
LEVEL = {"background_low": 0.3, "background_high": 3.0}
COUNT = {"healthy": 0, "foreign_large": 0, "two": 2, "three": 3}
LEAST_MM = 0.003
"""Minimum effect of a fault in some test; it must also exceed the scatter of a run."""
MOST_MM = 5.0
"""Maximum effect, because gauges have a limited range."""
LAPS = 2
_APPROACH_MM, _ROUNDS = 3.0, 3
_RUN_MIN = 1.5
"""Minutes between runs of a set-up."""
_TRIES = 300


class NothingToHideError(Exception):
    """No random draw satisfied the requirements."""


@dataclass(frozen=True)
class PlannedRun:
    """A row of runs.csv; number: index within the set-up, for noise levels and drift."""

    test: str
    direction: str
    use: str
    number: int

    @property
    def setup(self) -> str:
        return "unseen" if self.use == "unseen" else "radial" if self.test == "repeatability" else self.test


@dataclass(frozen=True)
class Day:
    """All values fixed before a run is simulated."""

    robot: str
    cell: Cell
    track: Track
    unseen: tuple[Cell, Track]
    links: Mapping[str, Link]
    levels: Mapping[str, noises.Levels]
    noise: noises.CellNoise
    targets: dict[str, Array]
    held_out: str
    radials: int


def generate_real(kind: str, seed: int, directory: Path, truth_directory: Path, *, name: str = "") -> Path:
    """Write a case and its truth. Return the directory of the case, `case-SEED` or `name` in `directory`."""
    rng = np.random.default_rng([seed, zlib.crc32(f"real {kind}".encode())])
    day = drawn_day(kind, rng)
    oracle = Oracle(sight_of(day.robot).placed(day.links), day.noise, day.levels, 2 * day.radials, LAPS)
    level = LEVEL.get(kind, 1.0)
    healthy = arms.healthy_arm(level, rng)
    drawn, seen = _faults(oracle, kind, level, rng)
    hidden, rest = [], healthy
    for fault in drawn:
        whole, rest = arms.plant(rest, fault)
        hidden.append(whole)
    foreign = _foreign(oracle, kind, [*hidden, *rest], hidden, rng)
    case = directory / (name or f"case-{seed:05d}")
    case.mkdir(parents=True)
    faults = [*hidden, *rest, *foreign]
    _write(case, replace(day, links=placed_links(day, faults)), faults, rng)
    truth = {
        "case": case.name,
        "kind": kind,
        "seed": seed,
        "rig": day.robot,
        "level": level,
        "hidden": [_hidden_json(oracle, *three) for three in zip(hidden, drawn, seen, strict=True)],
        "outside": [_foreign_json(oracle, fault, level) for fault in foreign],
        "background": [fault_json(fault) | {"healthy": fault.healthy} for fault in rest],
        "scatter_um": {test: 1e3 * mm for test, mm in oracle.scatter_mm().items()},
    }
    truth_directory.mkdir(parents=True, exist_ok=True)
    text = json.dumps(truth, indent=1, default=_plain) + "\n"
    (truth_directory / f"{case.name}.json").write_text(text, encoding="utf-8")
    return case


def drawn_day(kind: str, rng: np.random.Generator) -> Day:
    robot = ROBOTS[rng.integers(len(ROBOTS))]
    sight = sight_of(robot)
    unseen = elsewhere(sight, rng)
    rate = float(noises.log_uniform(50, 500, rng)) if rng.uniform() < 0.15 else 50.0
    noise = noises.drawn_cell(rng, kind, rate)
    cell, targets = sight.cell, sight.targets
    held_out, radials = str(rng.choice(["yaw", "roll"])), int(rng.integers(1, 3))
    numbers = sorted({int(k) for k in targets["target"]})
    places = {"yaw": (cell.circle, 2), "roll": (cell.circle, 2), "radial": (cell.hemisphere, 1)}
    places["unseen"] = (unseen[0].circle, 2)
    links = {}
    for setup, (place, gauges) in places.items():
        way = rng.standard_normal(3)
        off = rng.uniform(0.1, 1.0) * way / np.linalg.norm(way)
        links[setup] = Link(place.centre + off, rng.uniform(-0.3, 0.3, gauges), cell.gauge_at)
    levels = {
        setup: noises.drawn_levels(rng, 2 * REPEATS + 2, gauges, numbers) for setup, (_, gauges) in places.items()
    }
    return Day(robot, cell, sight.track, unseen, links, levels, noise, targets, held_out, radials)


def elsewhere(sight: Sight, rng: np.random.Generator) -> tuple[Cell, Track]:
    """Cell with a circle at a different place or of a different radius."""
    circle = sight.cell.circle
    for _ in range(30):
        if rng.uniform() < 0.5:
            way = rng.standard_normal(3)
            place = replace(
                circle, centre=np.round(circle.centre + rng.uniform(70, 130) * way / np.linalg.norm(way), 3)
            )
        else:
            place = replace(circle, radius=float(rng.choice([50.0, 90.0])))
        try:
            track = track_of(sight.cell, place)
        except (OutOfReachError, np.linalg.LinAlgError):
            continue
        start = np.array([np.interp(0.0, track.psi, column) for column in track.q.T])
        there: Place = replace(place, posture=start)
        return moved(sight.cell, there), replace(track, place=there)
    raise OutOfReachError("no other place for the circle")


def _faults(oracle: Oracle, kind: str, level: float, rng: np.random.Generator) -> tuple[list[Fault], list[Seen]]:
    """Return faults that change some test, no two of them similar, and their visibility."""
    count = COUNT.get(kind, 1)
    scatter = oracle.scatter_mm()
    found: list[Fault] = []
    for _ in range(_TRIES):
        if len(found) == count:
            seen = oracle.look(found, level) if found else []
            alike = {twin for one in seen for twin in one.twins} & {fault.name for fault in found}
            if not alike:
                return found, seen
            found = []
        fault = arms.drawn_fault(rng, kind)
        if fault is None or fault.name in [other.name for other in found]:
            continue
        moves = oracle.moves_mm([fault])
        if max(moves.values()) < MOST_MM and any(mm > max(LEAST_MM, scatter[test]) for test, mm in moves.items()):
            found.append(fault)
    raise NothingToHideError(f"{count} faults: none of {_TRIES} draws moves a test")


def _foreign(
    oracle: Oracle, kind: str, everything: Sequence[Fault], hidden: Sequence[Fault], rng: np.random.Generator
) -> list[Fault]:
    """Return foreign effects. `foreign_large`: 1.5 to 4 times the rms of all others; `foreign_third`: a tenth to a
    third of the fault.
    """
    if not kind.startswith("foreign"):
        return []
    large = kind == "foreign_large"
    beside = _rms(oracle.moves_mm(everything if large else hidden))
    wanted = beside * float(noises.log_uniform(*((1.5, 4.0) if large else (0.1, 1 / 3)), rng))
    for _ in range(_TRIES):
        fault = arms.drawn_foreign(rng)
        for _ in range(3):
            fault = fault.sized(fault.size * wanted / max(_rms(oracle.moves_mm([fault])), 1e-9))
        if abs(fault.size) < 1.0 and max(oracle.moves_mm([fault]).values()) < MOST_MM:
            return [fault]
    raise NothingToHideError("no foreign effect is as large as wanted")


def _rms(moves: Mapping[str, float]) -> float:
    return float(np.sqrt(np.mean([mm**2 for mm in moves.values()])))


def _runs(day: Day, rng: np.random.Generator) -> list[PlannedRun]:
    """Runs in random order of set-ups and within each set-up, numbered within the set-up."""
    ways = [(way, k) for way in ("acw", "cw") for k in range(REPEATS)]
    blocks = []
    for test in ("yaw", "roll"):
        block = [PlannedRun(test, way, "train", number) for number, (way, _) in enumerate(ways)]
        if test == day.held_out:
            block += [PlannedRun(test, way, "held_out", 2 * REPEATS + k) for k, way in enumerate(("acw", "cw"))]
        blocks.append(block)
    targets = [PlannedRun("radial", "", "train", k) for k in range(day.radials)]
    blocks.append([*targets, PlannedRun("repeatability", "", "train", day.radials)])
    blocks.append([PlannedRun("yaw", way, "unseen", k) for k, way in enumerate(("acw", "cw"))])
    shuffled = [blocks[k] for k in rng.permutation(len(blocks))]
    return [block[k] for block in shuffled for k in rng.permutation(len(block))]


def placed_links(day: Day, faults: Sequence[Fault]) -> dict[str, Link]:
    """Set-ups with the drawn eccentricity relative to the true path of this arm."""
    sight, (there, track) = sight_of(day.robot), day.unseen
    found = {}
    for setup, link in day.links.items():
        motions = [view.motion for view in sight.views if view.motion.test == setup]
        cell = there if setup == "unseen" else day.cell
        motions = motions or [circle(cell, track, "yaw", sense, 1) for sense in (1, -1)]
        watches = [watched(cell, motion, trace_of(cell, motion), link) for motion in motions]
        steady = [fault for fault in faults if fault.effect != "vibration"]
        found[setup] = centred(cell, watches, link, steady)
    return found


def motion_of(day: Day, run: PlannedRun, rng: np.random.Generator) -> Motion:
    if run.test == "radial":
        once = np.roll(np.arange(len(day.targets["q"])), int(rng.integers(len(day.targets["q"]))))
        order = np.tile(once, 2)
        return visits(day.cell, day.targets, order, rng.uniform(1.5, 3.0, len(order)))
    if run.test == "repeatability":
        numbers = day.cell.data["tests"]["repeatability"]["targets"]
        return approaches(day.cell, day.targets, numbers, _APPROACH_MM, _ROUNDS)
    cell, track = day.unseen if run.use == "unseen" else (day.cell, day.track)
    return circle(cell, track, run.test, 1 if run.direction == "acw" else -1, LAPS)


def _write(case: Path, day: Day, faults: Sequence[Fault], rng: np.random.Generator) -> None:
    for name, data in (("rig", day.cell.data), ("unseen", day.unseen[0].data)):
        (case / f"{name}.yaml").write_text(yaml.safe_dump(data, sort_keys=False, allow_unicode=True), encoding="utf-8")
    known: dict[tuple[str, str, bool], Program] = {}
    lines: list[list[str]] = [["file", "test", "direction", "use", "rig"]]
    for number, run in enumerate(_runs(day, rng), start=1):
        key = (run.test, run.direction, run.use == "unseen")
        if key not in known or run.test == "radial":
            known[key] = program(day.cell, motion_of(day, run, rng), day.links[run.setup], faults)
        table = f"{number:02d}-{'-'.join(filter(None, [run.test, run.direction]))}.csv"
        write_readings(case / table, day, run, known[key], faults, rng)
        lines.append([table, run.test, run.direction, run.use, "unseen.yaml" if run.use == "unseen" else "rig.yaml"])
    with (case / "runs.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(lines)


def write_readings(
    path: Path, day: Day, run: PlannedRun, made: Program, faults: Sequence[Fault], rng: np.random.Generator
) -> None:
    """Write a run as a table: the program at the reading times of the run, with its scatter and noise.

    Properties independent of the reading times have separate random draws, so a case at two rates differs only in them.
    """
    noise, levels = day.noise, day.levels[run.setup]
    rng, reading = rng.spawn(2)
    if run.direction:
        stamp = noises.stamps(noise, made.t_s[-1], reading)
        t = np.clip(stamp + noise.jitter_s * np.clip(reading.standard_normal(len(stamp)), -2, 2), 0, made.t_s[-1])
        q, g = at(stamp, made.q), at(t, made.readings)
        by_joint, by_ball = at(t, made.by_joint), at(t, made.by_ball)
    else:
        stamp = t = made.t_s
        q, g, by_joint, by_ball = made.q, made.readings, made.by_joint, made.by_ball
    basis = noises.along_lap(2 * np.pi * t / made.t_s[-1])
    joints = np.radians(levels.joints_deg) * basis @ rng.standard_normal((basis.shape[1], 6))
    ball = levels.ball_mm * basis @ rng.standard_normal((basis.shape[1], 3))
    ball = ball + np.outer(run.number * _RUN_MIN + t / 60, levels.drift_mm_min)
    if made.motion.labels is not None:
        ball = ball - noises.stop_scatter(levels, noise.tail_df, made.motion.labels["target"], rng)
    g = g + np.einsum("mkj,mj->mk", by_joint, joints) + np.einsum("mkj,mj->mk", by_ball, ball)
    own = [fault for fault in faults if fault.effect in BY_RUN]
    g = own_errors(g, t, own, float(rng.uniform(0, 2 * np.pi)))
    g = g + noises.slow_noise(levels, run.number, t, made.t_s[-1], rng)
    g = g + levels.white_mm[run.number] * reading.standard_normal(g.shape)
    g = g + noises.wild(noise, levels.white_mm[run.number], len(t), reading)
    marks = made.motion.labels or run.direction
    write_rows(path, stamp, q, g, marks, encoder_deg=noise.encoder_deg, resolution_mm=noise.resolution_mm)


def _hidden_json(oracle: Oracle, whole: Fault, planted: Fault, seen: Seen) -> dict[str, Any]:
    """Truth; `parameters` include the healthy size."""
    return fault_json(whole) | {
        "size": SIZE[whole.effect],
        "planted": planted.size,
        "healthy": whole.healthy,
        "times": abs(planted.size / whole.healthy),
        "worth_um": {test: round(1e3 * mm, 3) for test, mm in oracle.moves_mm([whole]).items()},
        "sigma": seen.sigma,
        "testable": seen.testable,
        "class": sorted({whole.name, *seen.twins}),
    }


def fault_json(fault: Fault) -> dict[str, Any]:
    size = {SIZE.get(fault.effect, "size"): fault.size}
    form = {"rough": fault.rough, "begin": fault.begin}
    return {
        "name": fault.name,
        "effect": fault.effect,
        **fault.keys,
        "parameters": size | dict(fault.shape),
        "form": form,
    }


def _foreign_json(oracle: Oracle, fault: Fault, level: float) -> dict[str, Any]:
    sigma = oracle.unexplained(fault, level)
    return fault_json(fault) | {
        "worth_um": {test: round(1e3 * mm, 3) for test, mm in oracle.moves_mm([fault]).items()},
        "sigma": sigma,
        "testable": sigma >= 7.0,
    }


def _plain(x: Any) -> Any:
    return x.tolist() if hasattr(x, "tolist") else float(x)

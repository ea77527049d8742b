"""Warnings of exchanged gauges: how often false, how often missed, over laps of faulty arms drawn from outside.

The generator of the blind trial makes noiseless yaw laps of arms with every effect at its healthy size and faults of 5
to 100 times that, and sets the ball about the circle that the arm really drives. Each lap is read with the gauges as
they are and exchanged.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import yaml

from analysis.procedures.checks.gauge_sign import order_findings
from analysis.runs.tables import CircleTable
from rigs.load import parse
from rigs.rig import Rig
from tests.worlds.stranger.cell import ROBOTS
from tests.worlds.stranger.draw import candidate
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.joints import Trace
from tests.worlds.stranger.measure import measure, trace_of
from tests.worlds.stranger.motion import Motion
from tests.worlds.stranger.real.arm import TIMES, drawn_foreign, healthy_arm, plant
from tests.worlds.stranger.real.noise import log_uniform
from tests.worlds.stranger.real.programs import circle
from tests.worlds.stranger.real.setups import centred, watched
from tests.worlds.stranger.sight import Sight, sight_of

FAULTS = {"healthy": 0, "one fault": 1, "three faults": 3, "foreign": 0, "joint_offset": 1, "transmission_error": 1}
BALL_MM = {"ball 0.1 to 1 mm off": (0.1, 1.0), "ball 1 to 15 mm off": (1.0, 15.0)}


@cache
def scene(robot: str) -> tuple[Sight, Rig, list[Motion], list[Trace]]:
    """A cell, its rig, and a lap each way."""
    sight = sight_of(robot)
    laps = [circle(sight.cell, sight.track, "yaw", sense, 1) for sense in (1, -1)]
    laps = [replace(lap, rows=lap.rows[::10]) for lap in laps]
    rig = parse(yaml.safe_dump(sight.cell.data, allow_unicode=True), robot)
    return sight, rig, laps, [trace_of(sight.cell, lap) for lap in laps]


def arm(kind: str, rng: np.random.Generator) -> list[Fault]:
    """A healthy arm, and the faults of a kind in it."""
    rest, hidden = healthy_arm(1.0, rng), []
    for _ in range(FAULTS[kind]):
        fault = candidate(rng, [kind] if "_" in kind else None, (0.0, 0.25))
        whole, rest = plant(rest, fault.sized(fault.size * float(log_uniform(*TIMES, rng))))
        hidden.append(whole)
    if kind == "foreign":
        fault = drawn_foreign(rng)
        hidden.append(fault.sized(fault.size * float(log_uniform(*TIMES, rng))))
    return [*hidden, *rest]


def main() -> None:
    parser = argparse.ArgumentParser(prog="scripts/dev exchanged", description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=240, help="laps (240)")
    parser.add_argument("--seed", type=int, default=0, help="of the first lap (0)")
    given = parser.parse_args()
    laps, false, found = Counter[str](), Counter[str](), Counter[str]()
    for number in range(given.count):
        rng = np.random.default_rng([given.seed, number])
        kind, (ball, far_mm) = list(FAULTS)[number % len(FAULTS)], list(BALL_MM.items())[number // 12 % 4 == 3]
        sight, rig, motions, traces = scene(ROBOTS[number // len(FAULTS) % 2])
        way, faults = rng.standard_normal(3), arm(kind, rng)
        off = rng.uniform(*far_mm) * way / np.linalg.norm(way)
        link = Link(sight.cell.circle.centre + off, rng.uniform(-0.3, 0.3, 2), sight.cell.gauge_at)
        watches = [watched(sight.cell, *one, link) for one in zip(motions, traces, strict=True)]
        link = centred(sight.cell, watches, link, [fault for fault in faults if fault.effect != "vibration"])
        k = int(rng.integers(2))
        g_mm = measure(sight.cell, motions[k], faults, link, trace=traces[k])
        t_s, q = motions[k].t[motions[k].rows], motions[k].q[motions[k].rows]
        right, wrong = (CircleTable("yaw", ("acw", "cw")[k], t_s, q, g, None) for g in (g_mm, g_mm[:, ::-1]))
        group = f"{kind}, {ball}"
        laps[group] += 1
        false[group] += len(list(order_findings(right, rig)))
        found[group] += len(list(order_findings(wrong, rig)))
    for group, count in sorted(laps.items()):
        print(f"{group:42} {count:5} laps, {false[group]:3} false warnings, {count - found[group]:4} exchanges missed")


if __name__ == "__main__":
    main()

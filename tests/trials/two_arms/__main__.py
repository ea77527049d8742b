"""How well two arms calibrate each other: drawn cells of an independent world, and a table of coverage and errors.

`python -m tests.trials.two_arms [cases] [touches] [scatter_mm] [pairs…]`. Pairs of arms: ur10e-iiwa, iiwa-ur10e,
irb-iiwa, irb-five, ur10e-four. Each case draws zeros, lengths, twists, gear waves, and a compliance that stiffens with
the torque and that the fit does not know. Each arm is also fitted alone, with as many touches of two fixed
sockets, and both with 24 more touches of two fixed sockets whose distance is known to 0.02 mm.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np

from tests.support.two_arm_cases import (
    KNOWN,
    deviations,
    fitted,
    rig_of,
    touches_alone,
    touches_of_pair,
    with_fixed,
)
from tests.worlds import two_arms as world

KINDS = {"ur10e": world.UR10E, "iiwa": world.IIWA, "irb": world.IRB, "five": world.FIVE, "four": world.FOUR}
PAIRS = ("ur10e-iiwa", "irb-iiwa", "irb-five", "ur10e-four")
KNOWN_TOUCHES = 24
"""Touches of two fixed sockets whose distance is known."""
FIRST_BALL, SECOND_BALL = (60.0, 20.0, 90.0), (-50.0, 30.0, 70.0)


def main(cases: int, touches: int, scatter_mm: float, pairs: list[str]) -> None:
    """Run all cases and print a table for each pair."""
    z: dict[str, list[float]] = {}
    for pair in pairs:
        own, errors = run(pair, cases, touches, scatter_mm)
        print(f"\n{pair}: {cases} cells, {touches} touches, {scatter_mm} mm scatter")
        print_coverage(own)
        print_errors(errors)
        for name, values in own.items():
            z.setdefault(name, []).extend(values)
    print("\nall pairs")
    print_coverage(z)


def run(
    pair: str, cases: int, touches: int, scatter_mm: float
) -> tuple[dict[str, list[float]], dict[str, list[float]]]:
    """Return deviations over u by quantity, and errors by quantity, of all cases of a pair."""
    first, second = (KINDS[name] for name in pair.split("-"))
    rigs = rig_of(first, "first", FIRST_BALL), rig_of(second, "second", SECOND_BALL)
    known_rig = rig_of(first, "first", FIRST_BALL, KNOWN)
    z: dict[str, list[float]] = {}
    errors: dict[str, list[float]] = {}
    begin = time.perf_counter()
    for case in range(cases):
        rng = np.random.default_rng([case, *pair.encode()])
        cell = world.drawn_cell(first, second, rng)
        table = touches_of_pair(cell, touches, scatter_mm, rng)
        found = deviations(cell, fitted(*rigs, table), rng)
        for name, values in found.z.items():
            z.setdefault(name, []).extend(values)
        for name, value in found.error.items():
            errors.setdefault(name, []).append(value)
        fixed = touches_alone(cell.first, second.axes, KNOWN_TOUCHES, scatter_mm, rng)
        known = deviations(cell, fitted(known_rig, rigs[1], with_fixed(table, fixed)), rng)
        z.setdefault("base, known distance", []).extend(known.z["base"])
        errors.setdefault("base, known distance", []).append(known.error["base"])
        for name, own, other, rig, other_rig in (
            ("first", cell.first, cell.second, *rigs), ("second", cell.second, cell.first, *rigs[::-1])
        ):  # fmt: skip
            of_sockets = touches_alone(own, other.kind.axes, touches, scatter_mm, rng)
            alone = deviations(world.Cell(own, other, cell.base), fitted(rig, other_rig, of_sockets), rng, alone=True)
            for quantity, value in alone.error.items():
                errors.setdefault(quantity.replace("first", name) + ", alone", []).append(value)
        print(f"{pair} {case + 1}/{cases} {time.perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)
    return z, errors


def print_coverage(z: dict[str, list[float]]) -> None:
    """Print the share of deviations within 2 u, by quantity."""
    for name, values in z.items():
        size = np.abs(values)
        share, rms = 100 * np.mean(size < 2), np.sqrt(np.mean(size**2))
        print(f"  {name:20} within 2 u {share:5.1f} % of {len(size)}, rms {rms:.2f} u")


def print_errors(errors: dict[str, list[float]]) -> None:
    """Print the median error, by quantity."""
    for name, values in sorted(errors.items()):
        unit = "°" if "zeros" in name or "twists" in name else " mm"
        print(f"  {name:32} {np.median(values):.4f}{unit}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="tests.trials.two_arms", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("cases", type=int, nargs="?", default=20, help="cells of each pair (20)")
    parser.add_argument("touches", type=int, nargs="?", default=60, help="touches of each cell (60)")
    parser.add_argument("scatter_mm", type=float, nargs="?", default=0.05, help="scatter of a touch in mm (0.05)")
    parser.add_argument("pairs", nargs="*", default=list(PAIRS), help=f"pairs of arms ({' '.join(PAIRS)})")
    given = parser.parse_args()
    main(given.cases, given.touches, given.scatter_mm, given.pairs)

"""How well two arms calibrate each other: drawn cells of an independent world, and a table of coverage and errors.

Each case draws zeros, lengths, twists, gear waves, and a compliance that stiffens with
the torque and that the fit does not know. Each arm is also fitted alone, with as many touches of two fixed
sockets, and both with 24 more touches of two fixed sockets whose distance is known to 0.02 mm.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from tests.support.trial import Trial, main, seeds
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


Figures = Mapping[str, list[float]]


def draw(given: Namespace) -> Iterator[tuple[str, int, int, float]]:
    for pair in given.pairs:
        yield from ((pair, seed, given.touches, given.scatter_mm) for seed in seeds(given))


def judged(case: tuple[str, int, int, float]) -> tuple[str, Figures, Figures]:
    """The pair, its deviations over u, and its errors, both by quantity."""
    pair, number, touches, scatter_mm = case
    first, second = (KINDS[name] for name in pair.split("-"))
    rigs = rig_of(first, "first", FIRST_BALL), rig_of(second, "second", SECOND_BALL)
    known_rig = rig_of(first, "first", FIRST_BALL, KNOWN)
    rng = np.random.default_rng([number, *pair.encode()])
    cell = world.drawn_cell(first, second, rng)
    table = touches_of_pair(cell, touches, scatter_mm, rng)
    found = deviations(cell, fitted(*rigs, table), rng)
    z, errors = dict(found.z), {name: [value] for name, value in found.error.items()}
    fixed = touches_alone(cell.first, second.axes, KNOWN_TOUCHES, scatter_mm, rng)
    known = deviations(cell, fitted(known_rig, rigs[1], with_fixed(table, fixed)), rng)
    z["base, known distance"], errors["base, known distance"] = known.z["base"], [known.error["base"]]
    for name, own, other, rig, other_rig in (
        ("first", cell.first, cell.second, *rigs), ("second", cell.second, cell.first, *rigs[::-1])
    ):  # fmt: skip
        of_sockets = touches_alone(own, other.kind.axes, touches, scatter_mm, rng)
        alone = deviations(world.Cell(own, other, cell.base), fitted(rig, other_rig, of_sockets), rng, alone=True)
        errors |= {f"{quantity.replace('first', name)}, alone": [value] for quantity, value in alone.error.items()}
    return pair, z, errors


def report(done: Sequence[tuple[str, Figures, Figures]]) -> str:
    lines = []
    for pair in dict.fromkeys(pair for pair, *_ in done):
        own = [one for one in done if one[0] == pair]
        lines += [f"\n{pair}: {len(own)} cells", *coverage([z for _, z, _ in own]), *medians([e for *_, e in own])]
    return "\n".join([*lines, "\nall pairs", *coverage([z for _, z, _ in done])])


def _joined(parts: Sequence[Figures]) -> dict[str, list[float]]:
    names = dict.fromkeys(name for part in parts for name in part)
    return {name: [value for part in parts for value in part.get(name, ())] for name in names}


def coverage(parts: Sequence[Figures]) -> Iterator[str]:
    """Share of deviations within 2 u by quantity."""
    for name, values in _joined(parts).items():
        size = np.abs(values)
        share, rms = 100 * np.mean(size < 2), np.sqrt(np.mean(size**2))
        yield f"  {name:20} within 2 u {share:5.1f} % of {len(size)}, rms {rms:.2f} u"


def medians(parts: Sequence[Figures]) -> Iterator[str]:
    for name, values in sorted(_joined(parts).items()):
        unit = "°" if "zeros" in name or "twists" in name else " mm"
        yield f"  {name:32} {np.median(values):.4f}{unit}"


TRIAL = Trial(
    draw,
    judged,
    report,
    line=lambda one: f"{one[0]}: base {one[2]['base'][0]:.4f} mm",
    count=20,
    options={
        "touches": (60, "touches of each cell (60)"),
        "scatter_mm": (0.05, "scatter of a touch in mm (0.05)"),
        "pairs": (PAIRS, f"pairs of arms ({' '.join(PAIRS)})"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))

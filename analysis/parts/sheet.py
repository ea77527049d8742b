"""The sheet beside the printed parts: what is printed and bought, how it goes together, what is measured.

Prices are our estimates of what web shops ask for small packs; they bound the cost, and are no offer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from analysis.parts.sizes import Bought, PrintedPart
from rigs.text import plain

_GRAMS_PER_CM3 = 1.24
"""PLA; a part printed with four walls and 40 % inside has some 60 % of its solid's weight."""
_FILLED = 0.6
_EURO_PER_GRAM = 0.025


@dataclass(frozen=True)
class Purchase:
    """A thing to buy: how many, what, its price at most (€) for all, and what it is for."""

    count: int
    name: str
    euro: float
    why: str


def purchases(parts: Sequence[PrintedPart], bought: Bought) -> list[Purchase]:
    """Return what is bought for these parts."""
    seats = sum(part.count * (2 if part.name in {"bar", "link", "long-link"} else 1) for part in parts)
    magnets = seats - sum(part.count for part in parts if part.name == "holder")
    screws = sum(part.count * (2 if part.name == "bar" else 1) for part in parts if part.name in {"bar", "socket"})
    grams = _FILLED * _GRAMS_PER_CM3 * sum(part.count * part.solid.volume_mm3 for part in parts) / 1000
    width, height = bought.magnet_mm
    balls = f"steel balls of {bought.ball_mm:g} mm, grade 100 (ISO 3290-1)"
    return [
        Purchase(3, balls, 9, "the tool's, and two to measure"),
        Purchase(
            magnets, f"neodymium magnets of {width:g} × {height:g} mm, N35 or stronger", 0.8 * magnets, "the seats"
        ),
        Purchase(screws, f"{bought.screw} × 16 countersunk, and one M6 × 12", 4, "sockets and holder"),
        Purchase(1, "two-part epoxy, a small pack", 6, "the tool's ball and the magnets"),
        Purchase(math.ceil(grams), "grams of PLA or PETG", _EURO_PER_GRAM * grams, "printed parts"),
        Purchase(1, "caliper with steps of 0.01 mm, if there is none", 20, "over both balls of the bar"),
    ]


def sheet(parts: Sequence[PrintedPart], bought: Bought, rig_name: str, remarks: Sequence[str]) -> str:
    """Return the sheet as Markdown."""
    things = purchases(parts, bought)
    printed = [f"| {part.count} | `{part.name}.stl` | {part.about} |" for part in parts]
    buy = [f"| {thing.count} | {thing.name} | {thing.euro:.0f} | {thing.why} |" for thing in things]
    total = sum(thing.euro for thing in things)
    bar = next((part for part in parts if part.name == "bar"), None)
    return "\n".join(
        [
            f"# Printed parts of {plain(rig_name)}",
            "",
            "| | file | what it is for |",
            "| --- | --- | --- |",
            *printed,
            "",
            *(f"- {remark}." for remark in remarks),
            *([""] if remarks else []),
            "Print at 100 %, without supports, upright as the files lie, four walls, 40 % inside, layers of 0.2 mm.",
            "`parts.svg` has the dimensions to measure afterwards.",
            "",
            "| | buy | € at most | for |",
            "| --- | --- | --- | --- |",
            *buy,
            "",
            f"Some {total:.0f} € together, {total - things[-1].euro:.0f} € without the caliper: estimates, no offers.",
            "",
            "## Together",
            "",
            "1. Screw each socket to what the robot stands on, then press a magnet into its bore as far as it goes,",
            "   with a drop of epoxy. The ball must rest on the cone and not on the magnet.",
            "2. Glue the tool's ball into the cone of `holder` with epoxy, and let it harden with the ball upwards.",
            "3. Clean balls and cones before each touch; a hair is 0.05 mm.",
            *(_measured(bar, bought) if bar else []),
            "",
        ]
    )


def _measured(part: PrintedPart, bought: Bought) -> list[str]:
    """How the bar gets its length."""
    apart = part.numbers["distance of the sockets"]
    over = part.numbers["over both balls"]
    return [
        f"4. Put a ball on each socket of `bar` and measure over both: about {over:.2f} mm. The distance is that less",
        f"   {bought.ball_mm:g} mm. `rig parts RIG --over-balls-mm {over:.2f}` prints the line for the rig file.",
        f"   A caliper knows it to some 0.02 mm, the printer to some {max(0.1, 0.003 * apart):.1f} mm.",
    ]

"""Documents of the printed parts: a sectional drawing, true to scale at 100 %, and a sheet with parts and checks.

Prices are upper limits for small packs from web shops.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

from analysis.apps.parts.sizes import Bought, PrintedPart
from rigs.text import plain

_GRAMS_PER_CM3 = 1.24
"""PLA; with four walls and 40 % infill, a part has about 60 % of the solid weight."""
_FILLED = 0.6
_EURO_PER_GRAM = 0.025


@dataclass(frozen=True)
class Purchase:
    """price: highest, in €."""

    count: int
    name: str
    euro: float
    why: str


def purchases(parts: Sequence[PrintedPart], bought: Bought) -> list[Purchase]:
    seats = sum(part.count * (2 if part.name in {"bar", "link", "long-link"} else 1) for part in parts)
    magnets = seats - sum(part.count for part in parts if part.name == "holder")
    screws = sum(part.count * (2 if part.name == "bar" else 1) for part in parts if part.name in {"bar", "socket"})
    grams = _FILLED * _GRAMS_PER_CM3 * sum(part.count * part.solid.volume_mm3 for part in parts) / 1000
    width, height = bought.magnet_mm
    balls = f"steel balls of {bought.ball_mm:g} mm, grade 100 (ISO 3290-1)"
    return [
        Purchase(3, balls, 9, "one for the tool, two for measuring"),
        Purchase(
            magnets, f"neodymium magnets of {width:g} × {height:g} mm, N35 or stronger", 0.8 * magnets, "the seats"
        ),
        Purchase(screws, f"{bought.screw} × 16 countersunk, and one M6 × 12", 4, "sockets and holder"),
        Purchase(1, "two-part epoxy, a small pack", 6, "the tool's ball and the magnets"),
        Purchase(math.ceil(grams), "grams of PLA or PETG", _EURO_PER_GRAM * grams, "printed parts"),
        Purchase(1, "caliper with steps of 0.01 mm, if not available", 20, "over both balls of the bar"),
    ]


def sheet(parts: Sequence[PrintedPart], bought: Bought, rig_name: str, remarks: Sequence[str]) -> str:
    things = purchases(parts, bought)
    printed = [f"| {part.count} | `{part.name}.stl` | {part.about} |" for part in parts]
    buy = [f"| {thing.count} | {thing.name} | {thing.euro:.0f} | {thing.why} |" for thing in things]
    total = sum(thing.euro for thing in things)
    bar_steps = list[str]()
    if bar := next((part for part in parts if part.name == "bar"), None):
        apart, over = bar.numbers["distance of the sockets"], f"{bar.numbers['over both balls']:.2f}"
        bar_steps = [
            f"4. Put a ball on each socket of `bar` and measure over both: about {over} mm. The distance is that less",
            f"   {bought.ball_mm:g} mm. `rig parts RIG --over-balls-mm {over}` prints the line for the rig file.",
            f"   A caliper knows it to some 0.02 mm, the printer to some {max(0.1, 0.003 * apart):.1f} mm.",
        ]
    return "\n".join(
        [
            f"# Printed parts of {plain(rig_name)}",
            "",
            "| | file | purpose |",
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
            f"About {total:.0f} € in total, {total - things[-1].euro:.0f} € without the caliper (estimates).",
            "",
            "## Together",
            "",
            "1. Screw each socket to the mounting surface of the robot, then press a magnet fully into the bore,",
            "   with a drop of epoxy. The ball must rest on the cone, not on the magnet.",
            "2. Glue the tool's ball into the cone of `holder` with epoxy, with the ball on top during hardening.",
            "3. Clean balls and cones before each touch; a hair changes the position by 0.05 mm.",
            *bar_steps,
            "",
        ]
    )


_MARGIN, _LINE, _COLUMN, _HEAD = 12.0, 5.0, 62.0, 18.0
"""In mm: margin around a part, line spacing, column width, and space above the parts for a ball."""
_STYLE = (
    ".paper{fill:#fff}text{font:3.4px sans-serif;fill:#1a1a1a}.title{font-weight:bold;font-size:4px}"
    ".part{fill:#e3e8ee;stroke:#1a1a1a;stroke-width:.35}.ball{fill:none;stroke:#0b57a4;stroke-width:.3}"
    ".axis{stroke:#6b6b6b;stroke-width:.2;stroke-dasharray:4 1.2 .6 1.2}.dim{stroke:#0b57a4;stroke-width:.25}"
    ".blue{fill:#0b57a4}"
)


def drawing(parts: Sequence[PrintedPart], title: str) -> str:
    body, x, tallest = list[str](), 0.0, 0.0
    for part in parts:
        low, high = part.solid.corners.min(axis=0), part.solid.corners.max(axis=0)
        width, height = float(high[0] - low[0]), float(high[2])
        column = max(width + 2 * _MARGIN + 14, _COLUMN)
        body += [f'<g transform="translate({x + column / 2:.2f} {_HEAD})">', *_part(part, width, height), "</g>"]
        x += column
        tallest = max(tallest, height + 2 * _MARGIN + _ball_overhang(part) + _LINE * (len(part.numbers) + 2))
    total = tallest + _HEAD
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {x:.1f} {total:.1f}" width="{x:.1f}mm" '
        f'height="{total:.1f}mm" role="img" aria-label="{escape(title, {chr(34): "&quot;"})}">'
    )
    return "\n".join(
        [
            head,
            f"<style>{_STYLE}</style>",
            '<rect class="paper" width="100%" height="100%"/>',
            f'<text class="title" x="{_MARGIN}" y="6">{escape(title)}</text>',
            *body,
            "</svg>\n",
        ]
    )


def _part(part: PrintedPart, width: float, height: float) -> Iterator[str]:
    foot = _MARGIN + height
    axes = [0.0]
    if "distance of the sockets" in part.numbers:
        apart = part.numbers["distance of the sockets"]
        axes = [-apart / 2, apart / 2]
        yield from _across(-apart / 2, apart / 2, _MARGIN - 7.5, f"{apart:.2f}")
        inner = apart - max(radius for radius, _ in part.section) * 2
        box = f'x="{-inner / 2:.3f}" y="{foot - height:.3f}" width="{inner:.3f}" height="{height:.3f}"'
        yield f'<rect class="part" {box}/>'
    # height of the balls above the foot
    balls = [part.numbers[name] for name in ("ball's centre above the foot",) if name in part.numbers]
    if "ball to ball" in part.numbers:
        middle, apart = part.numbers["length"] / 2, part.numbers["ball to ball"]
        balls = [middle - apart / 2, middle + apart / 2]
    for axis in axes:
        for side in (-1, 1):
            points = [f"{axis + side * radius:.3f} {foot - level:.3f}" for radius, level in part.section]
            yield f'<path class="part" d="M{" L".join(points)}Z"/>'
        yield f'<line class="axis" x1="{axis:.3f}" x2="{axis:.3f}" y1="{_MARGIN - 5:.3f}" y2="{foot + 4:.3f}"/>'
        for level in balls:
            yield f'<circle class="ball" cx="{axis:.3f}" cy="{foot - level:.3f}" r="{part.numbers["ball"] / 2:.3f}"/>'
    yield from _across(-width / 2, width / 2, foot + _ball_overhang(part) + 6, f"{width:.1f}")
    right = width / 2 + 4
    yield f'<line class="dim" x1="{right:.2f}" x2="{right:.2f}" y1="{foot - height:.2f}" y2="{foot:.2f}"/>'
    yield f'<text class="blue" x="{right + 1:.2f}" y="{foot - height / 2:.2f}">{height:.1f}</text>'
    lines = [f"{part.count} × {part.name}", *(f"{name}: {value:.2f}" for name, value in part.numbers.items())]
    for number, words in enumerate(lines):
        kind = ' class="title"' if not number else ""
        y = foot + _ball_overhang(part) + 13 + _LINE * number
        yield f'<text{kind} x="{-_COLUMN / 2 + 3:.2f}" y="{y:.2f}">{escape(words)}</text>'


def _ball_overhang(part: PrintedPart) -> float:
    reach = part.numbers.get("ball to ball", 0.0) - part.numbers.get("length", 0.0)
    return reach / 2 + part.numbers["ball"] / 2 if "ball to ball" in part.numbers else 0.0


def _across(left: float, right: float, y: float, words: str) -> Iterator[str]:
    yield f'<line class="dim" x1="{left:.2f}" x2="{right:.2f}" y1="{y:.2f}" y2="{y:.2f}"/>'
    for x in (left, right):
        yield f'<line class="dim" x1="{x:.2f}" x2="{x:.2f}" y1="{y - 1.2:.2f}" y2="{y + 1.2:.2f}"/>'
    middle = (left + right) / 2
    yield f'<text class="blue" text-anchor="middle" x="{middle:.2f}" y="{y - 1:.2f}">{escape(words)}</text>'

"""A plan on the screen and as JSON: detectable sizes, indistinguishable effects, and useful further tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich import box
from rich.console import Group, RenderableType
from rich.table import Column, Table
from rich.text import Text

from analysis.apps.planning.detectability import (
    ASSUMED_JOINT_DEG,
    CapabilityOfTests,
    Detectability,
    SeparatingTest,
    assumed_um,
)
from analysis.cli.plain_console import fold_long_words, right
from analysis.diagnosis.evidence.significance import CERTAIN_SIGMA, ODDS
from analysis.diagnosis.fit.candidates import LARGEST_FAULT
from analysis.diagnosis.fit.selection_state import FAULT
from analysis.diagnosis.plan.expected import (
    SEPARABLE,
    is_detectable,
    is_separable,
)
from analysis.procedures.shared.quantity import quantity_of
from rigs.effect_names import kind_in_words, name_in_words, names_in_words
from rigs.effects import Effect, healthy_size, size_field
from rigs.schema.effect import name_of
from rigs.schema.vocabulary import CIRCLES, TestName
from rigs.text import counted

_TITLE: dict[str, Any] = {"title_style": "bold", "title_justify": "left"}
_MOST = 3
"""Number of further tests listed for a pair."""
_NOISE = {
    "gauges, white": "gauges",
    "along a lap, slow": "slow drift along a lap",
    "the ball, from run to run": "position of the ball between runs",
    "a target, from stop to stop": "position of a target between stops",
    "a touch, each coordinate": "each coordinate of a touch",
}
"""Words on the screen for the parts of the noise, whose names are keys of the JSON."""
_MOST_PAIRS = 6
"""Number of pairs listed for a group of effects that are hard to distinguish, hardest first."""


def as_table(plan: CapabilityOfTests) -> RenderableType:
    """Return detectable, indistinguishable and undetectable effects, and the most useful further test."""
    tests = ", ".join(plan.tests)
    ways = ", circles in both directions" if set(CIRCLES) & set(plan.tests) else ""
    head = Text(f"{tests}: {counted(plan.runs, 'run')} of each test{ways}", style="bold")
    unseen = len(plan.undetectable)
    small = sum(all(map(_small, forms)) for forms in plan.names.values())
    larger = len(plan.names) - small - unseen
    words = f"These tests detect {small} of {len(plan.names)} possible errors as soon as they are faults, {larger} "
    alike = counted(len(plan.pairs), "pair looks", "pairs look")
    words += f"only if they are larger, and {unseen} not at all. {alike} alike.\n"
    columns = ("error", "unit", right("usual"), right("detected from"))
    table = Table(*columns, title=_title("Other errors"), header_style="bold", **_TITLE)
    for kind, seats in _by_seat(plan, joints=False).items():
        for seat, sights in seats.items():
            effect = sights[0].effect
            table.add_row(
                name_in_words(f"{kind} {seat}".rstrip()), _unit(effect), f"{healthy_size(effect):g}", _limit(sights)
            )
    advice = [Text(f"Not possible here: {test}: {reason}", style="dim") for test, reason in plan.impossible]
    best = next((gain for gain in plan.gains if gain.parts + gain.shows), None)
    if best is None:
        none = "No further test would add information." if plan.gains else "The rig file declares no further test."
        advice.append(Text(none))
    else:
        text = f"Most useful further test: {best.test} ({best.why}). It separates {best.parts} of the "
        text += f"{len(plan.pairs)} pairs and detects {best.shows} of the {len(plan.undetectable)} hidden errors."
        advice.append(Text(text, style="bold"))
    assumed = (Text(noise_in_words(plan.tests)), Text(arm_in_words(plan.level)))
    tables = (_axes(plan), Text(), fold_long_words(table), _alike(plan), _hidden(plan))
    return Group(head, *assumed, Text(words), *tables, *advice)


def noise_in_words(tests: Sequence[TestName]) -> str:
    """Return the assumed noise for a plan of these tests."""
    um = [f"{_NOISE.get(name, name)} {um:.1f} µm" for name, um in assumed_um(tests).items()]
    return f"Assumed noise of one run (rms): {'; '.join(um)}; each joint, between runs {ASSUMED_JOINT_DEG:.4f}°"


def arm_in_words(level: float) -> str:
    """Return a phrase on the level of all other errors of the arm, assumed when an effect is to be detected."""
    if level == 1:
        return (
            "Assumed arm: all other errors have their usual size. Use --level for the level that a diagnosis "
            "found, or for an emulated arm."
        )
    return f"Assumed arm: all other errors have {level:g} times their usual size."


def _small(sight: Detectability) -> bool:
    """Return whether an effect is detectable as soon as it is a fault."""
    return not sight.hidden and sight.limit <= FAULT * healthy_size(sight.effect)


def _axes(plan: CapabilityOfTests) -> Table:
    """Return a table of the smallest detectable sizes of joint effects, a column for each axis, within 80 columns."""
    kinds = _by_seat(plan, joints=True)
    most = max([6, *(int(axis) for by_axis in kinds.values() for axis in by_axis)])
    axes = range(1, most + 1)
    table = Table(
        "error", right("usual"), *(right(f"axis {axis}") for axis in axes),
        title=_title("Joints and links"), header_style="bold", box=box.SIMPLE_HEAD, padding=0, show_edge=False,
        **_TITLE,
    )  # fmt: skip
    for kind, by_axis in kinds.items():
        first = next(iter(by_axis.values()))[0]
        cells = [_limit(by_axis.get(str(axis), ()), "\n") for axis in axes]
        below = "\n  worst waves per turn" if any("\n" in cell.plain for cell in cells) else ""
        table.add_row(f"{kind_in_words(kind)} {_unit(first.effect)}{below}", f"{healthy_size(first.effect):g}", *cells)
    return fold_long_words(table)


def _unit(effect: Effect) -> str:
    return quantity_of(effect, size_field(effect), {}).sign


def _title(of: str) -> str:
    return f"{of}: smallest size that is detected ({CERTAIN_SIGMA:g} σ)"


def _by_seat(plan: CapabilityOfTests, *, joints: bool) -> dict[str, dict[str, list[Detectability]]]:
    """Group detectabilities by effect (link constants also by field), then by axis or gauge. Orders of the same gear
    stay together.
    """
    sights_by_kind: dict[str, dict[str, list[Detectability]]] = {}
    for sight in plan.detectabilities:
        kind, _, seat = name_of(sight.effect).partition(" ")
        axis, _, field = seat.partition(".")
        if axis.isdigit() == joints:
            sights_by_kind.setdefault(f"{kind} {field}".rstrip(), {}).setdefault(axis, []).append(sight)
    return sights_by_kind


def _limit(sights: Sequence[Detectability], between: str = " … ") -> Text:
    seen = [sight.limit for sight in sights if not sight.hidden]
    if not seen:
        return Text("–" if sights else "", style="red")
    low, high = f"{min(seen):.2g}", f"{max(seen):.2g}"
    style = "green" if all(map(_small, sights)) else "yellow"
    return Text(low if low == high else f"{low}{between}{high}", style=style)


def _alike(plan: CapabilityOfTests) -> RenderableType:
    if not plan.pairs:
        return Text("All detectable errors can be separated.", style="green")
    title = f"Look alike (odds below {ODDS:g} to 1 at the size of a fault)"
    table = Table("errors", right("distance"), Column("separated by", ratio=1), title=title, **_TITLE)
    symbols = {sight.name: sight.effect.symbol for sight in plan.detectabilities if sight.effect.symbol}
    for group in plan.groups:
        pairs = [pair for pair in plan.pairs if _kind(pair.names[0]) in group]
        for pair in pairs[:_MOST_PAIRS]:
            words = [(name_in_words(name), symbols.get(name)) for name in pair.names]
            names = "\n".join(name if symbol in (None, name) else f"{name} ({symbol})" for name, symbol in words)
            names += f"\n(and {pair.others} more)" if pair.others else ""
            helps = [parting for parting in pair.further if is_separable(parting.sigma)]
            if helps:
                parted = Text("\n".join(f"{parting.test}: {parting.sigma:.0f} σ" for parting in helps[:_MOST]))
            elif pair.further and pair.further[0].sigma > 0.05:
                best = pair.further[0]
                parted = Text(f"no test; best: {best.test}: {best.sigma:.1f} σ", style="yellow")
            else:
                none = "none of the further tests" if pair.further else "the rig file declares no further test"
                parted = Text(none, style="yellow")
            table.add_row(names, f"{pair.sigma:.1f} σ", parted)
        if len(pairs) > _MOST_PAIRS:
            kinds = names_in_words(group)
            table.add_row(
                "", "", Text(f"{len(pairs) - _MOST_PAIRS} more pairs (--json lists all): {kinds}", style="dim")
            )
        table.add_section()
    return fold_long_words(table)


def _kind(name: str) -> str:
    """Return a name without the order of a gear."""
    return name.partition(" order ")[0]


def _hidden(plan: CapabilityOfTests) -> RenderableType:
    if not plan.hidden:
        return Text("Every error can be detected.", style="green")
    columns = (Column("errors", ratio=1), Column("reason", ratio=1), Column("detected by", ratio=1))
    title = f"Not detected, even at {LARGEST_FAULT:g} times the usual size"
    table = Table(*columns, title=title, **_TITLE)
    together: dict[tuple[str, str], list[Detectability]] = {}
    for sight in plan.hidden:
        helps = [parting.test for parting in sight.further if parting.sigma and is_detectable(1 / parting.sigma)]
        together.setdefault((sight.hidden, helps[0] if helps else ""), []).append(sight)
    for (why, test), sights in together.items():
        names = names_in_words(dict.fromkeys(_kind(sight.name) for sight in sights))
        text = "no further test"
        if test:
            sigmas = [sight.further[0].sigma for sight in sights]
            ends = dict.fromkeys((f"{min(sigmas):.2g}", f"{max(sigmas):.2g}"))  # a single value if both are equal
            text = f"{test} ({' … '.join(ends)} σ at the usual size)"
        table.add_row(names.replace("; ", "\n"), why, text)
    return fold_long_words(table)


def as_object(plan: CapabilityOfTests) -> dict[str, Any]:
    """Return the plan as a JSON object with sizes in their usual units."""
    return {
        "tests": list(plan.tests),
        "runs": plan.runs,
        "noise": {"source": "assumed", "um": assumed_um(plan.tests), "joint_deg": ASSUMED_JOINT_DEG},
        "alike_below_sigma": SEPARABLE,
        "effects": [
            {
                "name": sight.name,
                "unit": sight.effect.unit(size_field(sight.effect)),
                "healthy": healthy_size(sight.effect),
                "sd": sight.sd if np.isfinite(sight.sd) else None,
                "limit": None if sight.hidden else sight.limit,
                **({"hidden": sight.hidden, "further": _partings(sight.further)} if sight.hidden else {}),
            }
            for sight in plan.detectabilities
        ],
        "groups": [list(group) for group in plan.groups],
        "pairs": [
            {"names": list(pair.names), "sigma": pair.sigma, "others": pair.others, "further": _partings(pair.further)}
            for pair in plan.pairs
        ],
        "further": [
            {"test": gain.test, "why": gain.why, "parts": gain.parts, "shows": gain.shows} for gain in plan.gains
        ],
        "not_possible": [{"test": test, "reason": reason} for test, reason in plan.impossible],
    }


def _partings(partings: Sequence[SeparatingTest]) -> list[dict[str, Any]]:
    return [{"test": parting.test, "sigma": parting.sigma} for parting in partings]

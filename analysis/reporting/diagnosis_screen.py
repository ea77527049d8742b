"""A diagnosis on the screen, in the order in which a person thinks; 80 columns are enough for it."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from analysis.inference.acts import Doubt
from analysis.inference.candidates import LARGEST_FAULT
from analysis.inference.result import Condition, Diagnosis, Gap
from analysis.inference.state import FAULT
from analysis.reporting.act_words import ActWords, acts_in_words
from analysis.reporting.answer_words import AnswerWords, doubt_words, shown_parts
from analysis.reporting.diagnosis_words import (
    beside_size,
    beside_u,
    closed,
    percent,
    runs_of,
    shortened,
    size,
    sure,
    with_uncertainty,
)
from analysis.reporting.places_table import places_table
from analysis.reporting.stairs import stairs_of, stairs_table
from analysis.reporting.texts import texts_of
from analysis.reporting.wide_tables import whole
from rigs.schema.effect import label_of, name_of

_COLOUR: dict[Condition, str] = {
    "named": "bold yellow",
    "ambiguous": "bold yellow",
    "outside_library": "bold red",
    "undecided": "bold yellow",
    "uncalibrated": "bold green",
    "nothing_unusual": "bold green",
    "not_testable_here": "bold yellow",
}
_MOST_GROUPS = 6
_MOST_NAMES = 40
"""Names of what cannot be seen here, before the rest is only counted."""


def as_screen(found: Diagnosis) -> RenderableType:
    """The two verdicts, the budget, the faults, the gap, remedies, next test, places and remarks."""
    words = AnswerWords(found)
    parts = [Text(words.headline, style=_COLOUR[found.condition])]
    acts = ActWords(found)
    parts += [Text(f"{words.accuracy} {words.judged}"), *([Text(f"Next: {acts.next}")] if acts.next else [])]
    sections = (
        ("What makes the error", _budget(found)),
        ("Fitted effects" if found.given else "Faults", _faults(found)),
        ("What to do", _acts(found)),
        ("How the gap shrinks", _shrinking(found)),
        ("What the model leaves", _gaps(found)),
        ("Still unexplained", _left(found)),
        ("What these tests cannot distinguish", _cannot(found)),
        ("Where model and readings disagree", places_table(found.where)),
        ("Remarks on the data", _doubts(found)),
    )
    shown: list[RenderableType] = [*parts]
    for heading, body in sections:
        if body:
            shown += [Text(f"\n{heading}", style="bold"), *(Padding(part, (0, 0, 0, 2)) for part in body)]
    return Group(*shown, Text(f"\n{_footer(found)}", style="dim"))


def _plain_table(*headings: str, right: Iterable[str] = ()) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim", pad_edge=False)
    for heading in headings:
        number = heading in right
        table.add_column(heading, justify="right" if number else "left", no_wrap=number)
    return whole(table)


def _shrinking(found: Diagnosis) -> list[RenderableType]:
    stairs = stairs_of(found)
    return [stairs_table(stairs)] if stairs else []


def _budget(found: Diagnosis) -> list[RenderableType]:
    """Every part of the error; those below a thousandth of it are counted together."""
    if not found.budget:
        return []
    table = _plain_table("part", "µm rms", "share", "× usual", "class", right=("µm rms", "share", "× usual"))
    words, (large, small) = AnswerWords(found), shown_parts(found)
    for one in large:
        name = ", ".join(filter(None, [words.part_name(one), words.size_of(one)]))
        times = f"{one.times_usual:.1f}" if one.times_usual is not None else ""
        style = "bold" if one.rank == "unusual" else ""
        table.add_row(name, beside_u(one.um, one.u_um), percent(one.share), times, words.rank_of(one), style=style)
    if small:
        share = sum(one.share for one in small)
        table.add_row(f"{len(small)} smaller parts (all with --json)", "", percent(share), "", "", style="dim")
    cut_off = f"× usual: so many times what such an arm shows without a fault; unusual above {FAULT:g}"
    return [table, Text(cut_off, style="dim")]


def _faults(found: Diagnosis) -> list[RenderableType]:
    beside = [
        Text(f"no fault, {doubt_words(why, texts_of('en'))}: {names}", style="dim")
        for why, names in _doubted(found).items()
    ]
    if not found.written:
        return list(beside)
    times, bound = (2.0, "± 2u") if found.condition == "ambiguous" else (1.0, "± u")
    numbers = (f"size {bound}", "µm rms", "how sure", "alone leaves")
    table = _plain_table("effect", *numbers, right=numbers)
    for one in found.written:
        name = " + ".join([name_of(one.effect), *(name_of(twin) for twin in one.twins)])
        odds = "" if found.given else sure(one.posterior)
        row = (size(one, times), f"{one.worth_um:.1f}", odds, _number(one.alone_um))
        table.add_row(Text(name, style="bold"), *row)
        for field in beside_size(one):
            table.add_row(f"  {field}", with_uncertainty(one.effect, field, one.sd, times), "", "", "")
        for rival in one.rivals:
            table.add_row(
                f"  or {name_of(rival.effect)}", size(rival, times), "", sure(rival.posterior), "", style="dim"
            )
    likeliest = Text("the first of each is the likeliest, and the one that -o adds to the rig file", style="dim")
    return [table, *([likeliest] if found.condition == "ambiguous" else []), *beside]


def _doubted(found: Diagnosis) -> dict[Doubt, str]:
    """The fitted effects that the diagnosis does not stand by for another reason than their usual size."""
    by_reason: dict[Doubt, list[str]] = {}
    for one in found.effects:
        if one.doubt is not None and one.doubt != "usual":
            by_reason.setdefault(one.doubt, []).append(f"{label_of(one.effect)} ({one.worth_um:.1f} µm)")
    return {why: ", ".join(names) for why, names in by_reason.items()}


def _gaps(found: Diagnosis) -> list[RenderableType]:
    effects = bool(found.standing)
    last = ("calibrated", "noise floor")
    headings = ("before", "after", *last, "closed") if effects else ("rms", *last)
    table = _plain_table("µm rms", *headings, right=headings)
    places = (("runs used", found.train), ("held-out runs", found.held_out), ("unseen place", found.unseen))
    for name, gap in places:
        if gap is not None:
            ends = (gap.calibrated_um, gap.noise_floor_um)
            cells = (gap.before_um, gap.after_um, *ends) if effects else (gap.before_um, *ends)
            how = "" if gap.keeps_setup else ", own set-up"
            table.add_row(f"{name}{how}", *map(_number, cells), *([_percent(gap)] if effects else []))
    return [table]


def _number(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else ""


def _percent(gap: Gap) -> str:
    share = closed(gap)
    return f"{100 * share:.1f} %" if math.isfinite(share) else ""


def _left(found: Diagnosis) -> list[RenderableType]:
    if found.condition == "not_testable_here":
        return []
    rest = found.remainder
    lines = [Text(f"{rest.um:.1f} µm ({percent(rest.share)} of the gap): {rest.words}")]
    return [*lines, *(Text(f"{runs_of(one)}, {one.part}: {one.words}", style="dim") for one in found.left)]


def _cannot(found: Diagnosis) -> list[RenderableType]:
    lines = [Text(f"{' or '.join(group)}: alike here") for group in found.groups[:_MOST_GROUPS]]
    more = len(found.groups) - _MOST_GROUPS
    lines += [Text(f"and {more} more groups (all with --json)", style="dim")] if more > 0 else []
    names = found.not_testable
    if names:
        rest = len(names) - _MOST_NAMES
        told_all = shortened(names[:_MOST_NAMES]) + (f", and {rest} more" if rest > 0 else "")
        lines.append(
            Text(
                f"not detectable by these tests, even at {LARGEST_FAULT:g} times healthy sizes: {told_all}", style="dim"
            )
        )
    return list(lines)


def _acts(found: Diagnosis) -> list[RenderableType]:
    """All acts by number; the first one is said above."""
    return [Text(f"{k + 1}. {act}") for k, act in enumerate(acts_in_words(found, texts_of("en")))]


def _doubts(found: Diagnosis) -> list[RenderableType]:
    return [Text(doubt, style="yellow") for doubt in found.doubts]


def _footer(found: Diagnosis) -> str:
    runs = "1 run" if len(found.runs) == 1 else f"{len(found.runs)} runs"
    noise = "noise from repeats" if found.repeated else "noise assumed, not from repeats"
    return f"{found.rig.name} · {runs} · {noise} · {found.seconds:.1f} s"

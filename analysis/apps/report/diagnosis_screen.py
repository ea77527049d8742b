"""A diagnosis on the screen, in the order of a reader's questions, for 80 columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.padding import Padding
from rich.segment import Segment
from rich.text import Text

from analysis.apps.report.act_words import acts_in_words
from analysis.apps.report.answer_words import AnswerWords, shown_parts
from analysis.apps.report.diagnosis_words import (
    closed,
    error_size,
    held_out_rows,
    micrometres,
    other_parameters,
    percent,
    remains_lines,
    runs_of,
    size,
    stretch,
    sure,
    with_uncertainty,
)
from analysis.apps.report.stairs import stairs_of, stairs_table
from analysis.apps.report.summary import BarSegment, Summary, Tone
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import Texts, texts_of
from analysis.cli.plain_console import bare_table, right
from analysis.diagnosis.fit.candidates import LARGEST_FAULT
from analysis.diagnosis.fit.selection_state import FAULT
from analysis.diagnosis.judge.acts import Doubt
from analysis.diagnosis.judge.residuals import ResidualPlace
from analysis.diagnosis.judge.result import Diagnosis
from rigs.effect_names import name_in_words, names_in_words, parameter_in_words
from rigs.schema.vocabulary import CIRCLES
from rigs.text import counted

_MOST_PLACES = 6


def places_table(where: Sequence[ResidualPlace]) -> list[RenderableType]:
    """Return a table of the worst places, each with the axis that reverses there."""
    if not where:
        return [Text("They agree everywhere within the noise.")]
    table = bare_table("test", "part", "where", right("axis"), "difference", right("µm rms"), right("sigma"))
    for place in sorted(where, key=lambda place_of_error: -place_of_error.sigma)[:_MOST_PLACES]:
        row = (runs_of(place), place.part, stretch(place), f"{place.joint or ''}", place.why)
        table.add_row(*row, f"{place.rms_um:.1f}", f"{place.sigma:.0f}")
    unlisted = len(where) - _MOST_PLACES
    circles = any(place.test in CIRCLES for place in where)
    notes = [f"and {unlisted} more (--json lists all)"] * (unlisted > 0)
    notes += [
        "distance: mean of both gauges; angle: difference of the gauges; axis: this axis reverses there"
    ] * circles
    return [table, *(Text(note, style="dim") for note in notes)]


_COLOUR: dict[Tone, str] = {"pass": "bold green", "watch": "bold yellow", "fail": "bold red", "unjudged": "bold yellow"}
_MOST_GROUPS = 6
_MOST_NAMES = 40
"""Largest number of undetectable effects listed by name; further ones are only counted."""


def as_screen(diagnosis: Diagnosis) -> RenderableType:
    """Return verdicts, budget, faults, gaps, acts, indistinguishable effects, places and remarks."""
    words, texts = AnswerWords(diagnosis), texts_of("en")
    summary = summarise(diagnosis)
    parts = summary_on_screen(summary, texts, _COLOUR[summary.tone])
    stairs = stairs_of(diagnosis)
    unexplained = []
    if diagnosis.is_testable:
        remainder = diagnosis.remainder
        share = percent(remainder.share)
        unexplained = [Text(f"{remainder.um:.1f} µm rms, {share} of the error: {remainder.words}")]
        unexplained += [Text(f"{runs_of(band)}, {band.part}: {band.words}", style="dim") for band in diagnosis.left]
        unexplained += map(Text, remains_lines(diagnosis.remains, texts) if diagnosis.remains else ())
    sections = (
        ("Details", [Text(words.findings), Text(words.accuracy)]),
        (texts("passport"), _passport(words)),
        ("Error budget", _budget(diagnosis)),
        ("Fitted effects" if diagnosis.given else "Faults", _faults(diagnosis)),
        ("All steps", [Text(f"{k + 1}. {act}") for k, act in enumerate(acts_in_words(diagnosis, texts))]),
        (texts("steps"), ([stairs_table(stairs)] if stairs else [])),
        (texts("diagnosis"), _gaps(diagnosis)),
        ("Unexplained error", unexplained),
        ("Causes that these tests cannot separate", _inseparable(diagnosis)),
        ("Causes that these tests cannot detect", _undetectable(diagnosis)),
        ("Where model and readings disagree", places_table(diagnosis.where)),
        ("Remarks on the data", [Text(doubt, style="yellow") for doubt in diagnosis.doubts]),
    )
    shown: list[RenderableType] = [*parts]
    for heading, body in sections:
        if body:
            shown += [Text(f"\n{heading}", style="bold"), *(Padding(part, (0, 0, 0, 2)) for part in body)]
    runs = counted(len(diagnosis.runs), "run")
    noise = "from repeats" if diagnosis.repeated else "from residuals" if diagnosis.shows_noise else "assumed"
    footer = f"{diagnosis.rig.name} · {runs} · noise {noise} · {diagnosis.seconds:.1f} s"
    return Group(*shown, Text(f"\n{footer}", style="dim"))


def _budget(diagnosis: Diagnosis) -> list[RenderableType]:
    """Return the table of the error budget. Parts below a thousandth of the error are counted together."""
    if not diagnosis.budget:
        return []
    table = bare_table("part", *map(right, ("µm rms", "share", "× usual")), "size")
    words, (large, small) = AnswerWords(diagnosis), shown_parts(diagnosis)
    for part in large:
        name = ", ".join(filter(None, [words.short_name(part), words.size_of(part)]))
        times = f"{part.times_usual:.1f}" if part.times_usual is not None else ""
        style = "bold" if part.rank == "unusual" else ""
        table.add_row(
            name, error_size(part.um, part.u_um), percent(part.share), times, words.rank_of(part), style=style
        )
        for line in part.shown_together:  # individual sizes of parts that partly cancel and share the line above
            table.add_row(f"  {words.short_name(line)}, alone", error_size(line.um, line.u_um), "", "", "", style="dim")
    if small:
        share = sum(part.share for part in small)
        table.add_row(
            f"{counted(len(small), 'smaller part')} (--json lists all)", "", percent(share), "", "", style="dim"
        )
    cut_off = f"× usual: multiple of the typical size in a healthy arm; a size certainly above {FAULT:g} is unusual"
    return [table, Text(cut_off, style="dim")]


def _passport(words: AnswerWords) -> list[RenderableType]:
    """Return the table of distances of the real arm, and what left the factory state."""
    if not words.passport:
        return []
    table = bare_table("rms in the joint ranges of the runs, base and tool taught", right("µm"))
    for row in words.passport:
        table.add_row(*row)
    return [table, *([Text(words.passport_changes)] if words.passport_changes else [])]


def _faults(diagnosis: Diagnosis) -> list[RenderableType]:
    words, texts = AnswerWords(diagnosis), texts_of("en")
    # Fitted effects that are doubted for a reason other than their usual size
    by_reason: dict[Doubt, list[str]] = {}
    for named in diagnosis.effects:
        if named.doubt is not None and named.doubt != "usual":
            name = words.noun(named.effect)
            by_reason.setdefault(named.doubt, []).append(f"{name} ({micrometres(named.contribution_um)})")
    doubted = [
        Text(texts("unconfirmed", why=texts(f"doubt_{why}"), names="; ".join(names)), style="dim")
        for why, names in by_reason.items()
    ]
    if not (diagnosis.written or diagnosis.standing):
        return list(doubted)
    times, bound = (2.0, "± 2u") if diagnosis.condition == "ambiguous" else (1.0, "± u")
    numbers = (f"size {bound}", "µm rms", "probability", "remaining µm rms")
    table = bare_table("cause", *map(right, numbers))
    for named in diagnosis.written or diagnosis.standing:
        name = " + ".join(map(words.noun, (named.effect, *named.twins)))
        odds = "" if diagnosis.given else sure(named.probability)
        row = (size(named, times), f"{named.contribution_um:.1f}", odds, error_size(named.alone_um, 0.0))
        table.add_row(Text(name, style="bold"), *row)
        for field in other_parameters(named):
            table.add_row(
                f"  {parameter_in_words(field)}", with_uncertainty(named.effect, field, named.sd, times), "", "", ""
            )
        for rival in named.rivals:
            cells = f"  or {words.noun(rival.effect)}", size(rival, times), "", sure(rival.probability), ""
            table.add_row(*cells, style="dim")
    likeliest = Text("The first of each group is the most likely; -o adds it to the rig file.", style="dim")
    return [table, *([likeliest] if diagnosis.condition == "ambiguous" else []), *doubted]


def _gaps(diagnosis: Diagnosis) -> list[RenderableType]:
    words, texts, last = AnswerWords(diagnosis), texts_of("en"), ["explained"] * bool(diagnosis.standing)
    table = bare_table("µm rms", *map(right, [*map(texts, words.gap_cells(diagnosis.train)), *last]))
    places = (("used", diagnosis.train), ("held_out", diagnosis.held_out), ("unseen", diagnosis.unseen))
    for place, gap in places:
        if gap is not None:
            how = "" if gap.keeps_setup else ", separate set-up"
            share = closed(gap)
            percents = [f"{100 * share:.1f} %" if math.isfinite(share) else ""] if last else []
            table.add_row(f"{texts(f'runs_{place}')}{how}", *words.gap_cells(gap).values(), *percents)
    remarks = [
        held_out_rows(diagnosis, texts),
        "" if diagnosis.shows_noise else texts("noise_assumed"),
        texts("about_scatter") if diagnosis.train.of_places else "",
    ]
    return [table, *(Text(remark, style="dim") for remark in remarks if remark)]


def _inseparable(diagnosis: Diagnosis) -> list[RenderableType]:
    lines = [Text(" or ".join(map(name_in_words, group))) for group in diagnosis.groups[:_MOST_GROUPS]]
    others = len(diagnosis.groups) - _MOST_GROUPS
    lines += [Text(f"and {others} more groups (--json lists all)", style="dim")] if others > 0 else []
    return list(lines)


def _undetectable(diagnosis: Diagnosis) -> list[RenderableType]:
    names = diagnosis.not_testable
    if not names:
        return []
    unnamed = len(names) - _MOST_NAMES
    listed = names_in_words(names[:_MOST_NAMES]) + (f"; and {unnamed} more" if unnamed > 0 else "")
    larger = f"even if {LARGEST_FAULT:g} times larger than in a healthy arm"
    return [Text(f"Not visible in these tests, {larger}: {listed}", style="dim")]


BAR_WIDTH = 40
"""Width of the stacked bar in columns on a wide terminal: half of the usual 80."""
_FILLS = "█▓▒░"
"""Fill characters of the segments, distinguishable on a terminal that shows no colours."""


@dataclass(frozen=True)
class StackedBar:
    """Stacked bar for a terminal, at most as wide as the terminal."""

    causes: tuple[BarSegment, ...]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the bar as a single line."""
        width, begin = min(BAR_WIDTH, options.max_width), 0.0
        for fill, cause in zip(_FILLS, self.causes, strict=False):
            end = begin + cause.share
            yield Segment(fill * (round(width * end) - round(width * begin)))
            begin = end
        yield Segment.line()


def summary_on_screen(summary: Summary, texts: Texts, style: str = "bold") -> list[RenderableType]:
    """Return the headline and the tiles as elements of rich, for a terminal of any width."""
    error = summary.error
    causes: list[RenderableType] = [Text("–")]
    if summary.causes:
        names = (f"{fill} {cause.name} {cause.percent}" for fill, cause in zip(_FILLS, summary.causes, strict=False))
        causes = [StackedBar(summary.causes), *map(Text, names)]
    step = [Text(summary.next or "–"), *([Text(summary.command, style="bold")] if summary.command else [])]
    tiles: tuple[tuple[str, list[RenderableType]], ...] = (
        (error.title, [Text(error.words, style="bold"), Text(f"{error.basis} {error.standing}".rstrip())]),
        (texts("main_causes"), causes),
        (texts("do_next"), list(step)),
    )
    shown: list[RenderableType] = [Text(f"{summary.badge}: {summary.headline}", style=style)]
    shown += [Text(unknown, style="yellow") for unknown in summary.unknowns]
    for heading, body in tiles:
        shown += [Text(heading, style="bold"), Padding(Group(*body), (0, 0, 0, 2))]
    return shown

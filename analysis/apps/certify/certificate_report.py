"""A certificate as blocks, and as a page with a picture of the features."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from analysis.apps.certify.certificate import RISK, Certified, Judged
from analysis.apps.certify.program import Listed
from analysis.apps.report.blocks import Block, Figure, Sentence, Table, paragraphs
from analysis.apps.report.html_page import answer_page, write_html
from rigs.text import counted

_COLUMNS = ("feature", "tolerance / mm", "error ± u / mm", "verdict", "after rig correct", "largest cause")
_NOTE = (
    "Frame and tool are taught with the robot, so a motion of the whole arm is no error. accept: inside the tolerance "
    f"with a probability of at least {1 - RISK:.0%}; reject: outside with this probability (JCGM 106:2012)."
)
_MOST_REASONS = 5


def certificate_answer(judged: Sequence[Certified]) -> list[Block]:
    now, after = (Counter(getattr(one, state).verdict for one in judged) for state in ("now", "corrected"))
    first, second = (
        f"{count['accept']} inside, {count['reject']} outside, {count['undecided']} undecided" for count in (now, after)
    )
    corrected = "" if after == now else f" After rig correct: {second}."
    headline = f"{counted(len(judged), 'feature')}: {first}.{corrected}"
    rows = tuple(
        (one.feature.name, f"{one.feature.tolerance_mm:g}", *_cells(one), _verdict(one.corrected), one.cause or "")
        for one in judged
    )
    reasons: dict[str, list[str]] = {}
    for one in judged:
        reasons.setdefault(one.why, []).append(one.feature.name)
    lines = [f"{', '.join(names)}: {why}" for why, names in reasons.items() if why]
    more = len(lines) - _MOST_REASONS
    lines = [*lines[:_MOST_REASONS], f"and {more} more reasons (--json)" if more > 0 else ""]
    lines += [
        f"{one.feature.name}: outside from {day.date} on ({day.earliest} to {day.latest or 'unknown'}), if "
        f"{day.figure} grows on"
        for one in judged
        if (day := one.until)
    ]
    return [
        Sentence(headline, "pass" if now["accept"] == len(judged) else "watch"),
        *paragraphs(lines, "doubt"),
        Table(_COLUMNS, rows, {1, 2}),
        Sentence(_NOTE, "note"),
    ]


def _cells(one: Certified) -> tuple[str, str]:
    now = one.now
    if one.range_mm:
        return f"{one.range_mm[0]:z.3f} to {one.range_mm[1]:z.3f}", now.verdict
    if now.expected_mm is None:
        return "unknown", now.verdict
    u = "" if now.u_mm is None else f" ± {now.u_mm:.3f}"
    return f"{now.expected_mm:z.3f}{u}", _verdict(now)


def _verdict(judged: Judged) -> str:
    is_close = judged.verdict == "undecided" and judged.probability is not None
    return f"{judged.verdict} ({judged.probability:.0%} inside)" if is_close else judged.verdict


def write_page(judged: Sequence[Certified], listed: Listed, path: Path, program: str, rig: str) -> None:
    picture = Figure("Features from above and from the side", _picture(judged, listed))
    write_html(
        answer_page(f"Certificate of {program} on {rig}", [*certificate_answer(judged), picture], "en", boxed=1), path
    )


def _picture(judged: Sequence[Certified], listed: Listed) -> Markup:
    import matplotlib as mpl  # noqa: PLC0415 - slow to import

    from analysis.apps.report.chart import Sheet, svg_of  # noqa: PLC0415

    sheet, green = Sheet(9.0, 4.2), mpl.colormaps["RdYlGn"]
    panels = sheet.subplots(1, 2)
    for axes, across, name in zip(panels, (1, 2), "yz", strict=True):
        for one in judged:
            if one.now.expected_mm is not None:
                places = listed.work.wanted[one.feature.rows][:, [0, across], 3]
                colour = "0.6" if one.now.probability is None else green(one.now.probability)
                axes.plot(*places.T, "o-", ms=5, color=colour)
                axes.annotate(one.feature.name, np.mean(places, axis=0), fontsize=7)
        axes.set(xlabel="x / mm", ylabel=f"{name} / mm")
        axes.set_aspect("equal", adjustable="datalim")
    sheet.colorbar(mpl.cm.ScalarMappable(cmap=green), ax=panels, label="probability inside; grey: unknown")
    return Markup(svg_of(sheet))  # noqa: S704 - matplotlib escapes the names of features

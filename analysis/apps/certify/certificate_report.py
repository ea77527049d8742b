"""A certificate as blocks: headline, reasons of undecided features and dates, and a table of features."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from analysis.apps.certify.certificate import RISK, Certified, Judged
from analysis.apps.report.blocks import Block, Sentence, Table
from rigs.text import counted

_COLUMNS = ("feature", "tolerance / mm", "error ± u / mm", "verdict", "after rig correct", "largest cause")
_NOTE = (
    "Frame and tool are taught with the robot, so a motion of the whole arm is no error. accept: inside the tolerance "
    f"with a probability of at least {1 - RISK:.0%}; reject: outside with this probability (JCGM 106:2012)."
)
_MOST_REASONS = 5


def answer_of(judged: Sequence[Certified]) -> list[Block]:
    now, after = (Counter(getattr(one, state).verdict for one in judged) for state in ("now", "corrected"))
    first, second = (
        f"{count['accept']} inside, {count['reject']} outside, {count['undecided']} undecided" for count in (now, after)
    )
    corrected = "" if after == now else f" After rig correct: {second}."
    headline = f"{counted(len(judged), 'feature')}: {first}.{corrected}"
    rows = tuple(
        (one.feature.name, f"{one.feature.tolerance_mm:g}", *_cells(one.now), _cells(one.corrected)[1], one.cause or "")
        for one in judged
    )
    reasons: dict[str, list[str]] = {}
    for one in judged:
        reasons.setdefault(one.why, []).append(one.feature.name)
    lines = [f"{', '.join(names)}: {why}" for why, names in reasons.items() if why]
    lines[_MOST_REASONS:] = [f"and {len(lines) - _MOST_REASONS} more reasons (--json)"] * (len(lines) > _MOST_REASONS)
    lines += [
        f"{one.feature.name}: outside from {day.date} on ({day.earliest} to {day.latest or 'unknown'}), if "
        f"{day.figure} grows on"
        for one in judged
        if (day := one.until)
    ]
    return [
        Sentence(headline, "pass" if now["accept"] == len(judged) else "watch"),
        *(Sentence(line, "doubt") for line in lines),
        Table(_COLUMNS, rows, frozenset({1, 2})),
        Sentence(_NOTE, "note"),
    ]


def _cells(judged: Judged) -> tuple[str, str]:
    if judged.expected_mm is None:
        return "unknown", judged.verdict
    if judged.u_mm is None or judged.probability is None:
        return f"{judged.expected_mm:z.3f}", judged.verdict
    inside = f" ({judged.probability:.0%} inside)" if judged.verdict == "undecided" else ""
    return f"{judged.expected_mm:z.3f} ± {judged.u_mm:.3f}", f"{judged.verdict}{inside}"

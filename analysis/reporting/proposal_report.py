"""A proposal on the screen, as an object, and as rig files with the proposed circles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.files.write import refuse_existing
from analysis.inference.plan import Judgement
from analysis.inference.proposal import SET_UP_MIN, Proposal, ProposedCircle
from analysis.reporting.plan_report import noise_in_words
from analysis.reporting.wide_tables import whole
from rigs.edit import Keys, Value, with_values
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES

_MOST_REASONS = 3
_MOST_NAME = 63
"""Length of a rig's name, by its schema."""
_MOST_DIGITS = 2
"""Digits of the number of a circle."""


def as_table(found: Proposal) -> RenderableType:
    """The proposed circles, what they add, and what stays untestable."""
    head = f"beside {', '.join(found.tests)}, {found.runs} runs each: circles within {found.minutes:g} min"
    parts: list[RenderableType] = [Text(head, style="bold"), Text(noise_in_words(CIRCLES))]
    reasons = ", ".join(f"{count} {reason}" for reason, count in list(found.refused.items())[:_MOST_REASONS])
    tried = found.feasible + sum(found.refused.values())
    parts.append(Text(f"{found.feasible} of {tried} circles can be driven" + (f" ({reasons})" if reasons else "")))
    if found.circles:
        parts.append(_circles(found))
    else:
        parts.append(Text("no circle within this time makes anything else testable", style="yellow"))
    parts += [Text(f"{name}: {_count(judgement)}") for name, judgement in _judgements(found)]
    if found.after.undetectable:
        parts.append(Text(f"still not testable: {', '.join(found.after.undetectable)}", style="yellow"))
    return Group(*parts)


def _judgements(found: Proposal) -> list[tuple[str, Judgement]]:
    return [("before", found.before), *([("with them", found.after)] if found.circles else [])]


def _count(judgement: Judgement) -> str:
    names, hidden = len(judgement.names), len(judgement.undetectable)
    pairs = "1 pair looks" if len(judgement.pairs) == 1 else f"{len(judgement.pairs) or 'no'} pairs look"
    return f"{names - hidden} of {names} names are testable, {pairs} alike"


def _circles(found: Proposal) -> Table:
    table = Table(title=f"{found.used_min:.0f} min in all, with {SET_UP_MIN:g} min to set up each", title_style="dim")
    table.add_column("circle")
    table.add_column("min", justify="right")
    table.add_column("makes testable", ratio=1)
    table.add_column("separates", ratio=1)
    for number, one in enumerate(found.circles, start=1):
        pairs = ", ".join(" and ".join(pair) for pair in _separated(found, one))
        names = ", ".join(_testable(found, one))
        table.add_row(f"{number}. {one.candidate.words}", f"{one.candidate.minutes:.0f}", names or "–", pairs or "–")
    return whole(table)


def _testable(found: Proposal, one: ProposedCircle) -> list[str]:
    """Names that a circle makes testable, as far as the judgement with all circles, which fits shapes, agrees."""
    return [name for name in one.testable if name not in found.after.undetectable]


def _separated(found: Proposal, one: ProposedCircle) -> list[tuple[str, str]]:
    left = {frozenset(pair.names) for pair in found.after.pairs}
    return [pair for pair in one.separated if frozenset(pair) not in left]


def as_object(found: Proposal, written: list[Path]) -> dict[str, Any]:
    """The same for scripts."""
    return {
        "tests": list(found.tests),
        "runs": found.runs,
        "minutes": found.minutes,
        "driveable": found.feasible,
        "refused": dict(found.refused),
        "circles": [
            {
                "words": one.candidate.words,
                "minutes": one.candidate.minutes,
                "testable": _testable(found, one),
                "separated": [list(pair) for pair in _separated(found, one)],
                "tool_xyz_mm": list(one.candidate.rig.robot.tool.xyz_mm),
                "circle": _circle(one.candidate.rig),
            }
            for one in found.circles
        ],
        "before": _judgement(found.before),
        "after": _judgement(found.after),
        "files": [str(path) for path in written],
    }


def _judgement(judgement: Judgement) -> dict[str, Any]:
    return {
        "not_testable": list(judgement.undetectable),
        "alike": [list(pair.names) for pair in judgement.pairs],
        "effects": [{"name": one.name, "sd": one.sd if not one.hidden else None} for one in judgement.detectabilities],
    }


def _circle(rig: Rig) -> dict[str, Any]:
    assert rig.tests.circle is not None  # noqa: S101 - a proposed circle
    return rig.tests.circle.model_dump(mode="json")


def hold_free(rig: Rig, directory: Path) -> None:
    """Raise FileError where a directory holds proposed circles of a rig already: a proposal takes minutes."""
    for path in sorted(directory.glob(f"{_stem(rig, '')}*.yaml")):
        refuse_existing(path)


def write(found: Proposal, text: str, directory: Path) -> list[Path]:
    """Write a rig file for each proposed circle: the given text with the circle's values. Raises FileError where one is
    there already."""
    from analysis.files.write import holding, write_all_new  # noqa: PLC0415 - slow to import

    files = {}
    for number in range(1, len(found.circles) + 1):
        rig = _named(found, number)
        name = f"{rig.name}.yaml"
        changed = with_values(text, _changes(found.rig, rig), rig, str(directory / name))
        files[name] = holding(changed.encode())
    return write_all_new(directory, files)


def _named(found: Proposal, number: int) -> Rig:
    name = _stem(found.rig, str(number))
    return found.circles[number - 1].candidate.rig.model_copy(update={"name": name})


def _stem(rig: Rig, number: str) -> str:
    """Return the name of a rig with a proposed circle; without its number, what all of them begin with."""
    room = _MOST_NAME - len("-circle-") - _MOST_DIGITS
    return f"{rig.name[:room]}-circle-{number}"


def _changes(rig: Rig, other: Rig) -> dict[Keys, Value]:
    """Return the values in which a rig with a proposed circle differs from the rig that it comes from."""
    before, after = _circle(rig), _circle(other)
    changes: dict[Keys, Value] = {("name",): other.name}
    changes |= {("tests", "circle", key): value for key, value in after.items() if value != before[key]}
    if rig.robot.tool != other.robot.tool:
        changes["robot", "tool", "xyz_mm"] = list(other.robot.tool.xyz_mm)
    return changes

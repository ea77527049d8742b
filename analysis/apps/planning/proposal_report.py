"""A proposal on the screen, as a JSON object, and as rig files with the proposed circles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from analysis.apps.planning.detectability import Judgement
from analysis.apps.planning.plan_report import noise_in_words
from analysis.apps.planning.proposal import SET_UP_MIN, CircleProposal, ProposedCircle
from analysis.apps.report.blocks import Block, Heading, Sentence, Table
from analysis.runs.tabular import pick_fields
from analysis.runs.written_files import refuse_existing
from rigs.edit import Keys, Value, with_values
from rigs.effect_names import name_in_words, names_in_words
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES

_MOST_REASONS = 3
_MOST_NAME = 63
_MOST_DIGITS = 2


def answer_of(proposal: CircleProposal) -> list[Block]:
    head = (
        f"Circles within {proposal.minutes:g} min, in addition to {proposal.runs} runs of {', '.join(proposal.tests)}"
    )
    reasons = ", ".join(f"{count} {reason}" for reason, count in list(proposal.refused.items())[:_MOST_REASONS])
    tried = proposal.feasible + sum(proposal.refused.values())
    driven = f"{proposal.feasible} of {tried} circles can be driven" + (f" ({reasons})" if reasons else "")
    blocks: list[Block] = [Sentence(head, "strong"), Sentence(noise_in_words(CIRCLES)), Sentence(driven)]
    if proposal.circles:
        rows = []
        for number, circle in enumerate(proposal.circles, start=1):
            pairs = "; ".join(" and ".join(map(name_in_words, pair)) for pair in _separated(proposal, circle))
            names = names_in_words(_testable(proposal, circle))
            words = f"{number}. {circle.candidate.words}"
            rows.append((words, f"{circle.candidate.minutes:.0f}", names or "–", pairs or "–"))
        used_min = sum(circle.candidate.minutes for circle in proposal.circles)
        title = f"{used_min:.0f} min in total, including {SET_UP_MIN:g} min to set up each circle"
        heads = ("circle", "min", "also detects", "separates")
        blocks += [Heading(title, 3), Table(heads, rows, {1})]
    else:
        blocks.append(Sentence("Within this time, no further circle makes more errors detectable.", "doubt"))
    judgements = {"before": proposal.before} | ({"with these circles": proposal.after} if proposal.circles else {})
    for when, judgement in judgements.items():
        count, hidden = len(judgement.names), len(judgement.undetectable)
        alike = "1 pair looks" if len(judgement.pairs) == 1 else f"{len(judgement.pairs) or 'no'} pairs look"
        blocks.append(Sentence(f"{when}: {count - hidden} of {count} errors are detectable, {alike} alike"))
    if proposal.after.undetectable:
        blocks.append(Sentence(f"still not detectable: {names_in_words(proposal.after.undetectable)}", "doubt"))
    return blocks


def _testable(proposal: CircleProposal, circle: ProposedCircle) -> list[str]:
    return [name for name in circle.testable if name not in proposal.after.undetectable]


def _separated(proposal: CircleProposal, circle: ProposedCircle) -> list[tuple[str, str]]:
    alike = {frozenset(pair.names) for pair in proposal.after.pairs}
    return [pair for pair in circle.separated if frozenset(pair) not in alike]


def as_object(proposal: CircleProposal, written: list[Path]) -> dict[str, Any]:
    return pick_fields(proposal, "tests", "runs", "minutes") | {
        "driveable": proposal.feasible,
        "refused": proposal.refused,
        "circles": [
            pick_fields(circle.candidate, "words", "minutes")
            | {
                "testable": _testable(proposal, circle),
                "separated": _separated(proposal, circle),
                "tool_xyz_mm": circle.candidate.rig.robot.tool.xyz_mm,
                "circle": _circle(circle.candidate.rig),
            }
            for circle in proposal.circles
        ],
        "before": _judgement(proposal.before),
        "after": _judgement(proposal.after),
        "files": written,
    }


def _judgement(judgement: Judgement) -> dict[str, Any]:
    effects = [{"name": sight.name, "sd": None if sight.hidden else sight.sd} for sight in judgement.detectabilities]
    alike = [pair.names for pair in judgement.pairs]
    return {"not_testable": judgement.undetectable, "alike": alike, "effects": effects}


def _circle(rig: Rig) -> dict[str, Any]:
    assert rig.tests.circle is not None  # noqa: S101 - a proposed circle
    return rig.tests.circle.model_dump(mode="json")


def refuse_earlier_proposal(rig: Rig, directory: Path) -> None:
    """Raise FileError if a directory already contains proposed circles, before a proposal takes minutes."""
    for path in sorted(directory.glob(f"{_stem(rig, '')}*.yaml")):
        refuse_existing(path)


def write(proposal: CircleProposal, text: str, directory: Path) -> list[Path]:
    """Write a rig file for each proposed circle: the given text with the values of the circle."""
    from analysis.runs.written_files import holding, write_all_new  # noqa: PLC0415 - slow to import

    files = {}
    for number, circle in enumerate(proposal.circles, start=1):
        rig = circle.candidate.rig.model_copy(update={"name": _stem(proposal.rig, str(number))})
        name = f"{rig.name}.yaml"
        # The values that differ between the proposed and the original rig
        before, after = _circle(proposal.rig), _circle(rig)
        changes: dict[Keys, Value] = {("name",): rig.name}
        changes |= {("tests", "circle", key): value for key, value in after.items() if value != before[key]}
        if proposal.rig.robot.tool != rig.robot.tool:
            changes["robot", "tool", "xyz_mm"] = list(rig.robot.tool.xyz_mm)
        changed = with_values(text, changes, rig, str(directory / name))
        files[name] = holding(changed.encode())
    return write_all_new(directory, files)


def _stem(rig: Rig, number: str) -> str:
    """Name of a rig with a proposed circle, or with an empty number the common prefix."""
    room = _MOST_NAME - len("-circle-") - _MOST_DIGITS
    return f"{rig.name[:room]}-circle-{number}"

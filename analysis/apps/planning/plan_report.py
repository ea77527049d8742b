"""A plan and a proposal of circles: blocks, JSON, and rig files with the proposed circles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from analysis.apps.planning.capability import CapabilityOfTests
from analysis.apps.planning.circle_candidates import SET_UP_MIN
from analysis.apps.planning.detectability import (
    ASSUMED_JOINT_DEG,
    Detectability,
    Judgement,
    SeparatingTest,
    assumed_noise_um,
)
from analysis.apps.planning.proposal import CircleProposal, ProposedCircle
from analysis.apps.report.blocks import Block, Cell, Heading, Row, Sentence, Table
from analysis.diagnosis.evidence.significance import CERTAIN_SIGMA, ODDS
from analysis.diagnosis.fit.candidates import LARGEST_FAULT
from analysis.diagnosis.fit.selection_state import FAULT
from analysis.diagnosis.plan.expected import SEPARABLE, is_detectable, is_separable
from analysis.procedures.shared.quantity import quantity_of
from analysis.runs.tabular import pick_fields
from analysis.runs.written_files import refuse_existing
from rigs.edit import Keys, Value, with_values
from rigs.effect_names import kind_in_words, name_in_words, names_in_words
from rigs.effects import Effect, healthy_size, size_field
from rigs.rig import Rig
from rigs.schema.effect import name_of
from rigs.schema.vocabulary import CIRCLES, TestName
from rigs.text import counted

_MOST = 3
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


def plan_answer(plan: CapabilityOfTests) -> list[Block]:
    level = f"{plan.level:g} times their usual size."
    if plan.level == 1:
        level = "their usual size. Use --level for the level that a diagnosis found, or for an emulated arm."
    ways = ", circles in both directions" if set(CIRCLES) & set(plan.tests) else ""
    unseen = len(plan.undetectable)
    small = sum(all(map(_is_small, forms)) for forms in plan.names.values())
    alike = counted(len(plan.pairs), "pair looks", "pairs look")
    detected = (
        f"These tests detect {small} of {len(plan.names)} possible errors as soon as they are faults, "
        f"{len(plan.names) - small - unseen} only if they are larger, and {unseen} not at all. {alike} alike."
    )
    best = next((gain for gain in plan.gains if gain.parts + gain.shows), None)
    advice = "No further test would add information." if plan.gains else "The rig file declares no further test."
    if best is not None:
        advice = (
            f"Most useful further test: {best.test} ({best.why}). It separates {best.parts} of the {len(plan.pairs)} "
            f"pairs and detects {best.shows} of the {unseen} hidden errors."
        )
    return [
        Sentence(f"{', '.join(plan.tests)}: {counted(plan.runs, 'run')} of each test{ways}", "strong"),
        Sentence(noise_in_words(plan.tests)),
        Sentence(f"Assumed arm: all other errors have {level}"),
        Sentence(detected),
        Heading(_title("Joints and links"), 3),
        _joint_errors(plan),
        Heading(_title("Other errors"), 3),
        _other_errors(plan),
        *_similar_pairs(plan),
        *_undetected(plan),
        *(Sentence(f"Not possible here: {test}: {reason}", "note") for test, reason in plan.impossible),
        Sentence(advice, "plain" if best is None else "strong"),
    ]


def noise_in_words(tests: Sequence[TestName]) -> str:
    um = [f"{_NOISE.get(name, name)} {um:.1f} µm" for name, um in assumed_noise_um(tests).items()]
    return f"Assumed noise of one run (rms): {'; '.join(um)}; each joint, between runs {ASSUMED_JOINT_DEG:.4f}°"


def _is_small(sight: Detectability) -> bool:
    """True if an effect is detectable as soon as it is a fault."""
    return not sight.hidden and sight.limit <= FAULT * healthy_size(sight.effect)


def _joint_errors(plan: CapabilityOfTests) -> Table:
    kinds, rows = _by_seat(plan, joints=True), list[Row]()
    axes = range(1, max([6, *(int(axis) for by_axis in kinds.values() for axis in by_axis)]) + 1)
    for kind, by_axis in kinds.items():
        effect = next(iter(by_axis.values()))[0].effect
        sizes = [_limit(by_axis.get(str(axis), ())) for axis in axes]
        below = ("worst waves per turn",) if any(size.below for size in sizes) else ()
        name = Cell(f"{kind_in_words(kind)} {_unit(effect)}", below)
        rows.append((name, f"{healthy_size(effect):g}", *sizes))
    heads = ("error", "usual", *(f"axis {axis}" for axis in axes))
    return Table(heads, rows, range(1, len(heads)))


def _other_errors(plan: CapabilityOfTests) -> Table:
    rows = [
        (name_in_words(f"{kind} {seat}".rstrip()), _unit(effect), f"{healthy_size(effect):g}", _limit(sights))
        for kind, seats in _by_seat(plan, joints=False).items()
        for seat, sights in seats.items()
        for effect in [sights[0].effect]
    ]
    return Table(("error", "unit", "usual", "detected from"), rows, {2, 3})


def _unit(effect: Effect) -> str:
    return quantity_of(effect, size_field(effect), {}).sign


def _title(of: str) -> str:
    return f"{of}: smallest size that is detected ({CERTAIN_SIGMA:g} σ)"


def _by_seat(plan: CapabilityOfTests, *, joints: bool) -> dict[str, dict[str, list[Detectability]]]:
    sights_by_kind: dict[str, dict[str, list[Detectability]]] = {}
    for sight in plan.detectabilities:
        kind, _, seat = name_of(sight.effect).partition(" ")
        axis, _, field = seat.partition(".")
        if axis.isdigit() == joints:
            sights_by_kind.setdefault(f"{kind} {field}".rstrip(), {}).setdefault(axis, []).append(sight)
    return sights_by_kind


def _limit(sights: Sequence[Detectability]) -> Cell:
    """Smallest detectable size; for gears with several orders also that of the worst below it."""
    seen = [f"{size:.2g}" for size in sorted(sight.limit for sight in sights if not sight.hidden)]
    if not seen:
        return Cell("–" if sights else "", tone="fail")
    worst = tuple(seen[-1:]) if seen[-1] != seen[0] else ()
    return Cell(seen[0], worst, tone="pass" if all(map(_is_small, sights)) else "watch")


def _similar_pairs(plan: CapabilityOfTests) -> list[Block]:
    if not plan.pairs:
        return [Sentence("All detectable errors can be separated.", "pass")]
    symbols = {sight.name: sight.effect.symbol for sight in plan.detectabilities if sight.effect.symbol}
    rows = list[Row]()
    for group in plan.groups:
        pairs = [pair for pair in plan.pairs if pair.names[0] in group]
        for pair in pairs[:_MOST_PAIRS]:
            words = [(name_in_words(name), symbols.get(name)) for name in pair.labels]
            first, *more = (name if symbol in (None, name) else f"{name} ({symbol})" for name, symbol in words)
            more += [f"(and {pair.others} more)"] * bool(pair.others)
            rows.append((Cell(first, tuple(more)), f"{pair.sigma:.1f} σ", _separating(pair.further)))
        if len(pairs) > _MOST_PAIRS:
            kinds = names_in_words(group)
            rows.append((f"{len(pairs) - _MOST_PAIRS} more pairs (--json lists all): {kinds}", "", Cell("")))
    title = f"Look alike (odds below {ODDS:g} to 1 at the size of a fault)"
    return [Heading(title, 3), Table(("errors", "distance", "separated by"), rows, {1})]


def _separating(further: Sequence[SeparatingTest]) -> Cell:
    helps = [f"{parting.test}: {parting.sigma:.0f} σ" for parting in further if is_separable(parting.sigma)][:_MOST]
    if helps:
        return Cell(helps[0], tuple(helps[1:]))
    if further and further[0].sigma > 0.05:
        return Cell(f"no test; best: {further[0].test}: {further[0].sigma:.1f} σ", tone="watch")
    return Cell("none of the further tests" if further else "the rig file declares no further test", tone="watch")


def _undetected(plan: CapabilityOfTests) -> list[Block]:
    if not plan.hidden:
        return [Sentence("Every error can be detected.", "pass")]
    together: dict[tuple[str, str], list[Detectability]] = {}
    for sight in plan.hidden:
        helps = [parting.test for parting in sight.further if parting.sigma and is_detectable(1 / parting.sigma)]
        together.setdefault((sight.hidden, helps[0] if helps else ""), []).append(sight)
    rows = []
    for (why, test), sights in together.items():
        names = names_in_words(dict.fromkeys(sight.name.partition(" order ")[0] for sight in sights)).split("; ")
        text = "no further test"
        if test:
            sigmas = [sight.further[0].sigma for sight in sights]
            ends = dict.fromkeys((f"{min(sigmas):.2g}", f"{max(sigmas):.2g}"))  # a single value if both are equal
            text = f"{test} ({' … '.join(ends)} σ at the usual size)"
        rows.append((Cell(names[0], tuple(names[1:])), why, text))
    title = f"Not detected, even at {LARGEST_FAULT:g} times the usual size"
    return [Heading(title, 3), Table(("errors", "reason", "detected by"), rows)]


def as_object(plan: CapabilityOfTests) -> dict[str, Any]:
    return {
        "tests": plan.tests,
        "runs": plan.runs,
        "noise": {"source": "assumed", "um": assumed_noise_um(plan.tests), "joint_deg": ASSUMED_JOINT_DEG},
        "alike_below_sigma": SEPARABLE,
        "effects": [
            {
                "name": sight.name,
                "unit": sight.effect.unit(size_field(sight.effect)),
                "healthy": healthy_size(sight.effect),
                "sd": sight.sd,
                "limit": None if sight.hidden else sight.limit,
                **({"hidden": sight.hidden, "further": _partings(sight.further)} if sight.hidden else {}),
            }
            for sight in plan.detectabilities
        ],
        "groups": plan.groups,
        "pairs": [
            {"names": pair.labels} | pick_fields(pair, "sigma", "others") | {"further": _partings(pair.further)}
            for pair in plan.pairs
        ],
        "further": plan.gains,
        "not_possible": [{"test": test, "reason": reason} for test, reason in plan.impossible],
    }


def _partings(partings: Sequence[SeparatingTest]) -> list[dict[str, Any]]:
    return [pick_fields(parting, "test", "sigma") for parting in partings]


_MOST_REASONS = 3
_MOST_NAME = 63
_MOST_DIGITS = 2


def proposal_answer(proposal: CircleProposal) -> list[Block]:
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


def proposal_object(proposal: CircleProposal, written: list[Path]) -> dict[str, Any]:
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

"""The answer of a diagnosis as blocks by section, in the order of a reader's questions, for terminal, page and JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.apps.report.act_words import ActWords, without_idle_mounts
from analysis.apps.report.answer_words import SMALL_SHARE, AnswerWords
from analysis.apps.report.blocks import (
    Block,
    Cell,
    Command,
    Heading,
    Row,
    Segments,
    Sentence,
    Table,
    as_object,
    paragraphs,
)
from analysis.apps.report.diagnosis_words import (
    LEAST_ODDS,
    error_size,
    has_measured_noise,
    micrometres,
    other_parameters,
    percent,
    plain_name,
    remains_rows,
    runs_of,
    size,
    stretch,
    sure,
    with_uncertainty,
)
from analysis.apps.report.summary_words import Summary, summarise
from analysis.apps.report.texts import ENGLISH, Texts, joined
from analysis.diagnosis.fit.candidates import LARGEST_FAULT
from analysis.diagnosis.fit.selection_state import FAULT
from analysis.diagnosis.judge.acts import Act, Doubt
from analysis.diagnosis.judge.comparison import LocatedResidual
from analysis.diagnosis.judge.named import Named
from analysis.diagnosis.judge.residuals import ModelResidual, ResidualPlace, Staircase
from analysis.diagnosis.judge.result import Diagnosis
from analysis.procedures.shared.quantity import Quantity
from rigs.effect_names import name_in_words, names_in_words, parameter_in_words
from rigs.schema.effect import name_of
from rigs.schema.vocabulary import CIRCLES
from rigs.text import counted

_MOST_PLACES = 6
_MOST_GROUPS = 6
_MOST_NAMES = 40
_STRONG = 0.7
"""Correlation from which a pair is listed: each size then has half of its variance from the other one."""
_MOST_PAIRS = 10
_SAME_DEG = 15.0
"""Distance below which places on the circle count as the same reversal, seen in two runs."""
_TENTHS = 1000
Sections = dict[str, list[Block]]
"""Blocks of an answer by section, each after its heading; sections without contents are missing."""


def summary_parts(summary: Summary, texts: Texts) -> list[list[Block]]:
    error = summary.error
    commands = map(Command, summary.command.splitlines())
    basis = Sentence(f"{error.basis} {error.standing}".rstrip())
    return [
        [
            Sentence(summary.headline, summary.tone, summary.badge),
            *paragraphs(summary.unknowns, "doubt"),
        ],
        [Heading(error.title, 3), Sentence(error.words, "strong"), basis],
        [Heading(texts("main_causes"), 3), Segments(summary.causes) if summary.causes else Sentence("–")],
        [Heading(texts("do_next"), 3), Sentence(summary.next or "–"), *commands],
    ]


def summary_blocks(summary: Summary, texts: Texts) -> list[Block]:
    return sum(summary_parts(summary, texts), list[Block]())


def sections_of(
    diagnosis: Diagnosis,
    texts: Texts,
    acts: Sequence[Act] | None = None,
    *,
    instead: Sequence[Act] = (),
    corrected: bool = False,
) -> Sections:
    """acts: the open acts, by default all; corrected: the robot drives corrected; instead: acts that would replace this
    correction."""
    words = ActWords(diagnosis, texts)
    open_acts = without_idle_mounts(diagnosis.acts) if acts is None else acts
    steps = [Sentence(f"{k}. {words.sentence(act, corrected=corrected)}") for k, act in enumerate(open_acts, 1)]
    ways = [Sentence(f"• {words.sentence(act, corrected=corrected)}") for act in instead]
    steps += [Sentence(texts("instead_of_correction")), *ways] if ways else []
    stairs = stairs_of(diagnosis, texts)
    # The condition unless the faults state it, the effects of the rig file, and the present accuracy
    is_named = diagnosis.condition in ("named", "ambiguous")
    condition = "" if is_named else words.usual_or_faults or words.condition_sentence
    details = [condition, words.already_held, "" if corrected else words.accuracy]
    groups = [Sentence(" or ".join(map(name_in_words, group))) for group in diagnosis.groups[:_MOST_GROUPS]]
    if (others := len(diagnosis.groups) - _MOST_GROUPS) > 0:
        groups.append(Sentence(f"and {others} more groups (--json lists all)", "note"))
    is_sound = bool(diagnosis.next_act and diagnosis.next_act.why == "sound")
    sections: dict[str, tuple[str, Iterable[Block]]] = {
        "details": ("details", paragraphs(details)),
        "passport": ("passport", _passport(words)),
        "budget": ("budget", _budget(words)),
        "faults": ("fitted" if diagnosis.given else "faults", _faults(words)),
        "correlations": ("correlations", _correlations(words)),
        "acts": ("then_sound" if is_sound else "then", steps),
        "steps": ("steps", [stairs_table(stairs, texts)] if stairs else []),
        "gaps": ("diagnosis", _gaps(words)),
        "unexplained": ("unexplained", _unexplained(words) if diagnosis.is_testable else []),
        "inseparable": ("inseparable", groups),
        "undetectable": ("undetectable", _undetectable(diagnosis)),
        "where": ("where_heading", places_blocks(diagnosis.where)),
        "doubts": ("doubts_heading", paragraphs(diagnosis.doubts, "doubt")),
    }
    return {key: [Heading(texts(name)), *blocks] for key, (name, given) in sections.items() if (blocks := list(given))}


def diagnosis_answer(diagnosis: Diagnosis, texts: Texts = ENGLISH) -> list[Block]:
    runs = counted(len(diagnosis.runs), "run")
    noise = "from repeats" if diagnosis.repeated else "from residuals" if diagnosis.shows_noise else "assumed"
    footer = f"{diagnosis.rig.name} · {runs} · noise {noise} · {diagnosis.seconds:.1f} s"
    sections = sections_of(diagnosis, texts).values()
    first = summary_blocks(summarise(diagnosis, texts), texts)
    return [*first, *sum(sections, list[Block]()), Sentence(footer, "note")]


def plain_object(diagnosis: Diagnosis) -> dict[str, Any]:
    return diagnosis.to_dict() | {"blocks": as_object(diagnosis_answer(diagnosis))}


def _budget(words: AnswerWords) -> list[Block]:
    """A row for each part of the error, and one for all small parts."""
    diagnosis, texts = words.diagnosis, words.texts
    if not diagnosis.budget:
        return []
    small = [part for part in diagnosis.budget if part.share < SMALL_SHARE and part.rank != "unusual"]
    large = [part for part in diagnosis.budget if part not in small]
    shares = [part.share for part in large] + [sum(part.share for part in small)] * bool(small)
    shown = [Cell(f"{tenths / 10:.1f} %", bar=max(0.0, share / max(shares)))
             for share, tenths in zip(shares, _tenths(shares), strict=True)]  # fmt: skip
    rows = list[Row]()
    for part, share in zip(large, shown, strict=False):
        named = diagnosis.named_of(part)
        odds = texts("likely", odds=sure(named.probability)) if named and not diagnosis.given else ""
        doubt = texts(f"doubt_{part.doubt}") if part.doubt and part.doubt != "usual" else ""
        below = (joined([words.size_of(part), odds], ", "), words.likely_members(part), doubt)
        name = Cell(words.part_name(part), (*below, *words.describe_parts_alone(part.shown_together)))
        rank = Cell(texts(f"rank_{part.rank}") if part.rank else "", (words.times_usual(part),))
        rows.append((name, share, error_size(part.um, part.u_um), rank))
    if small:
        rows.append((texts.counted("smaller_parts", len(small)), shown[-1], "", ""))
    columns = [*map(texts, ("part", "share", "rms_and_u", "rank"))]
    ranks = [part.rank or "other" for part in large] + ["other"] * bool(small)
    about = texts("about_budget", whole=micrometres(diagnosis.train.before_um), cut_off=f"{FAULT:g}")
    return [Table(columns, rows, {2}, ranks, "budget"), Sentence(about, "note")]


def _tenths(shares: Sequence[float]) -> list[int]:
    """Shares in tenths of a percent that add up to 1000: those with the largest rounding losses are rounded up."""
    exact = _TENTHS * np.array(shares)
    whole = np.floor(exact).astype(int)
    whole[np.argsort(whole - exact, kind="stable")[: _TENTHS - whole.sum()]] += 1
    return list(whole)


def _passport(words: AnswerWords) -> list[Block]:
    passport, texts = words.diagnosis.passport, words.texts
    if not (passport and passport.distances):
        return []
    key = "passport_moved" if passport.last_visit else "passport_changed"
    changed = texts(key, names=", ".join(map(words.noun, passport.changed))) if passport.changed else ""
    rows = [(texts(f"passport_{name}"), _distance(of, words)) for name, of in passport.distances.items()]
    return [Sentence(joined([texts("about_passport"), changed])), Table(("", "µm"), rows, {1})]


def _distance(distance: Quantity, words: AnswerWords) -> str:
    if math.isnan(distance.value):
        return words.texts("passport_unknown", u=micrometres(distance.u))
    return error_size(distance.value, distance.u)


def _faults(words: AnswerWords) -> list[Block]:
    diagnosis, texts = words.diagnosis, words.texts
    # Fitted effects that are doubted for a reason other than their usual size
    by_reason: dict[Doubt, list[str]] = {}
    for named in diagnosis.effects:
        if named.doubt is not None and named.doubt != "usual":
            um, odds = micrometres(named.contribution_um), sure(named.probability)
            probable = texts("probable", name=words.noun(named.effect), um=um, odds=odds)
            by_reason.setdefault(named.doubt, []).append(probable)
    notes = [
        texts("unconfirmed", why=texts(f"doubt_{why}"), names="; ".join(names)) for why, names in by_reason.items()
    ]
    faults = sorted(diagnosis.written or diagnosis.standing, key=lambda named: -named.contribution_um)
    if not faults:
        return paragraphs(notes, "note")
    keys = ("check_column_cause", "fault_size", "rms_um", "check_column_probability", "fault_rest")
    rows = [_fault(words, named) for named in faults]
    likeliest = texts("likeliest_first") if diagnosis.condition == "ambiguous" else ""
    table = Table([*map(texts, keys)], rows, {1, 2, 3, 4}, ["unusual"] * len(rows), "stack")
    return [table, *paragraphs([likeliest, *notes, *_lists(words)], "note")]


def _lists(words: AnswerWords) -> list[str]:
    """Sentences that name the effects of --fit and of --fix; none after a search."""
    diagnosis, texts = words.diagnosis, words.texts
    if not diagnosis.given:
        return []
    fitted = names_in_words(name_of(named.effect) for named in diagnosis.effects)
    fixed = names_in_words(map(name_of, diagnosis.fixed))
    return [texts("were_fitted", names=fitted), texts("were_fixed", names=fixed) if fixed else texts("none_fixed")]


def _correlations(words: AnswerWords) -> list[Block]:
    """The strongly correlated pairs of fitted sizes, or the strongest pair."""
    pairs, texts = words.diagnosis.correlations, words.texts
    if not pairs:
        return []
    strong = [pair for pair in pairs if abs(pair.value) >= _STRONG]
    shown = strong[:_MOST_PAIRS] or pairs[:1]
    rows = [(words.noun(pair.first), words.noun(pair.second), f"{pair.value:+.2f}") for pair in shown]
    more = texts("more_correlated", count=len(strong) - len(shown)) if len(strong) > len(shown) else ""
    table = Table([*map(texts, ("check_column_cause", "correlated_with", "correlation"))], rows, {2}, key="stack")
    return [Sentence(texts("about_correlations")), table, *paragraphs([more], "note")]


def _fault(words: AnswerWords, named: Named) -> Row:
    diagnosis, texts = words.diagnosis, words.texts
    below = [
        *(f"{parameter_in_words(field)} {with_uncertainty(named.effect, field, named.sd)}"
          for field in other_parameters(named)),
        _where(diagnosis, named, texts),
        texts("twins", others=texts("and").join(map(words.noun, named.twins))) if named.twins else "",
        *(texts("or_rival", cause=words.noun(rival.effect), size=size(rival), odds=sure(rival.probability))
          for rival in named.rivals),
        texts("or_unknown", odds=sure(named.unknown)) if named.unknown >= LEAST_ODDS else "",
    ]  # fmt: skip
    odds = "" if diagnosis.given else sure(named.probability)
    name = Cell(words.noun(named.effect), below)
    return name, size(named), f"{named.contribution_um:.1f}", odds, error_size(named.alone_um, 0.0)


def _where(diagnosis: Diagnosis, named: Named, texts: Texts) -> str:
    """Places on the circle where the faulty joint reverses and the readings disagree with the model."""
    axis, middles = getattr(named.effect, "axis", 0), list[float]()
    places = [place for place in diagnosis.where if place.joint == axis and place.test in CIRCLES]
    for place in sorted(places, key=lambda place: -place.sigma):
        middle = (place.from_deg + ((place.to_deg - place.from_deg) % 360.0) / 2) % 360.0
        if all(abs((middle - known_deg + 180.0) % 360.0 - 180.0) > _SAME_DEG for known_deg in middles):
            middles.append(middle)
    listed = texts("and").join(f"{middle:.0f}°" for middle in sorted(middles))
    return texts("where", places=listed) if listed else ""


def _gaps(words: AnswerWords) -> list[Block]:
    diagnosis, texts = words.diagnosis, words.texts
    has_share = bool(diagnosis.standing)
    columns = (texts("gap_rms"), *map(texts, words.gap_cells(diagnosis.train)), *[texts("explained")] * has_share)
    rows = list[Row]()
    for place, gap in (("used", diagnosis.train), ("held_out", diagnosis.held_out), ("unseen", diagnosis.unseen)):
        if gap is not None:
            name = Cell(texts(f"runs_{place}"), ("" if gap.keeps_setup else texts("separate_setup"),))
            share = 1 - (gap.calibrated_um / gap.before_um) ** 2 if gap.before_um > 0 else math.nan  # of the energy
            explained = f"{100 * share:.1f} %" if math.isfinite(share) else ""
            rows.append((name, *words.gap_cells(gap).values(), *[explained] * has_share))
    # Validation rows that rig selected, by run
    chosen = diagnosis.held_out.rows if diagnosis.held_out else {}
    counts = ", ".join(f"{name} {len(numbers)}" for name, numbers in chosen.items())
    notes = [
        texts("about_diagnosis"),
        texts("validation_rows", counts=counts, keys="gap.held_out.rows") if chosen else "",
        "" if diagnosis.shows_noise else texts("noise_assumed"),
        texts("about_scatter") if diagnosis.train.of_places else "",
    ]
    table = Table(columns, rows, range(1, len(columns)), key="narrow stack")
    return [table, *paragraphs(notes, "note")]


def _unexplained(words: AnswerWords) -> list[Block]:
    diagnosis, texts, residual = words.diagnosis, words.texts, words.diagnosis.residual
    share = texts("share_of_error", share=percent(residual.share))
    blocks: list[Block] = [Sentence(f"{residual.um:.1f} µm rms, {share}: {residual.words}")]
    blocks += paragraphs((f"{runs_of(band)}, {band.part}: {band.words}" for band in diagnosis.bands), "note")
    if (held_out := residual.held_out) is None:
        return blocks
    table = Table((texts("remains_against"), texts("remains_share")), remains_rows(held_out, texts))
    remains = texts("remains", um=micrometres(held_out.um), noise=micrometres(held_out.noise_um))
    return [*blocks, Sentence(remains), table]


def _undetectable(diagnosis: Diagnosis) -> list[Block]:
    names, more = diagnosis.not_testable, len(diagnosis.not_testable) - _MOST_NAMES
    listed = names_in_words(names[:_MOST_NAMES]) + (f"; and {more} more" if more > 0 else "")
    larger = f"even if {LARGEST_FAULT:g} times larger than in a healthy arm"
    return [Sentence(f"Not visible in these tests, {larger}: {listed}", "note")] if names else []


def places_blocks(where: Sequence[ResidualPlace]) -> list[Block]:
    if not where:
        return [Sentence("They agree everywhere within the noise.")]
    worst = sorted(where, key=lambda place: -place.sigma)[:_MOST_PLACES]
    rows = [
        (runs_of(place), place.part, stretch(place), f"{place.joint or ''}", place.why, f"{place.rms_um:.1f}",
         f"{place.sigma:.0f}")
        for place in worst
    ]  # fmt: skip
    columns = ("test", "part", "where", "axis", "difference", "µm rms", "sigma")
    notes = [f"and {len(where) - _MOST_PLACES} more (--json lists all)"] * (len(where) > _MOST_PLACES)
    if any(place.test in CIRCLES for place in where):
        notes.append("distance: mean of both gauges; angle: difference of the gauges; axis: this axis reverses there")
    return [Table(columns, rows, {3, 5, 6}, key="stack"), *paragraphs(notes, "note")]


# The staircase of the gap: the part that each step adds, and the residual after it.


@dataclass(frozen=True)
class Stairs:
    places: tuple[str, ...]
    """Text keys of the places, the runs used first."""
    names: tuple[str, ...]
    """The initial model, then the part that each step adds."""
    left: tuple[tuple[ModelResidual, ...], ...]
    """Residuals of each step by place."""

    def step_names(self, texts: Texts) -> list[str]:
        return [self.names[0], *(texts("step_with", part=part) for part in self.names[1:])]


def stairs_of(diagnosis: Diagnosis, texts: Texts = ENGLISH) -> Stairs | None:
    if diagnosis.staircase is None:
        return None
    words, names = AnswerWords(diagnosis, texts), [str(texts("step_first"))]
    for step in diagnosis.staircase.steps[1:]:
        single = words.part_name(diagnosis.budget[step.parts[0]]) if len(step.parts) == 1 else ""
        names.append(single or texts.counted("smaller_parts", len(step.parts)))
    return _stairs(diagnosis.staircase, names, has_u=has_measured_noise(diagnosis))


def stairs_of_model(residual: LocatedResidual) -> Stairs | None:
    if residual.staircase is None:
        return None
    parts = [*(plain_name(residual.rig, effect) for effect in residual.rig.effects), ENGLISH("step_calibration")]
    added = [parts[step.parts[0]] for step in residual.staircase.steps[1:]]
    return _stairs(residual.staircase, [ENGLISH("step_bare"), *added], has_u=True)


def _stairs(staircase: Staircase, names: Sequence[str], *, has_u: bool) -> Stairs:
    left = [[residual for residual in (step.used, step.held_out, step.unseen) if residual] for step in staircase.steps]
    shown = (tuple(residual if has_u else replace(residual, u_um=0.0) for residual in step) for step in left)
    return Stairs(staircase.places, tuple(names), tuple(shown))


def residual_words(residual: ModelResidual) -> str:
    return error_size(residual.um, residual.u_um)


def step_sentences(stairs: Stairs, texts: Texts) -> list[str]:
    first, *parts = stairs.names
    later = [texts("step_now", number=number, count=len(parts), part=part) for number, part in enumerate(parts, 1)]
    return [texts("step_start", count=len(parts), name=first), *later]


def stairs_table(stairs: Stairs, texts: Texts) -> Table:
    largest_um = max(1e-9, *(residual.um for step in stairs.left for residual in step))
    rows: list[Row] = [
        (name, Cell(residual_words(used), bar=used.um / largest_um), *map(residual_words, others))
        for name, (used, *others) in zip(stairs.step_names(texts), stairs.left, strict=True)
    ]
    columns = (texts("step_left"), *(texts(f"runs_{place}") for place in stairs.places))
    return Table(columns, rows, range(2, len(columns)), key="steps")

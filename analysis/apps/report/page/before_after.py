"""A correction and the error of the path before and after it, for the page and the end of a session."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from analysis.apps.report.blocks import Block, Command, Heading, Sentence, Table, paragraphs
from analysis.apps.report.diagnosis_words import micrometres
from analysis.apps.report.page.accuracy import PageVerdict, verdict_blocks
from analysis.apps.report.summary import Summary
from analysis.apps.report.texts import Texts, joined
from analysis.correction.deviation import Deviation, Expected, Side, Work


@dataclass(frozen=True)
class BeforeAfter:
    correction: str
    """What the operator has to do for it, in English."""
    way: Literal["entries", "programs", "none"]
    rows: tuple[Side, ...]
    work: Work | None = None
    judged: tuple[float, float] | None = None
    """Errors in µm before and with the model at the other place, before its runs joined."""
    joined: int = 0
    """Number of runs that joined."""
    own_programs: str = ""
    """Command that corrects programs of the user."""
    verdict: PageVerdict | None = None
    summary: Summary | None = None
    """Headline and tiles for the corrected robot; None for those of the diagnosis."""

    @property
    def driven(self) -> tuple[Deviation, Deviation] | None:
        return self._at("same")

    @property
    def elsewhere(self) -> tuple[Deviation, Deviation] | None:
        return self._at("elsewhere")

    def _at(self, place: str) -> tuple[Deviation, Deviation] | None:
        return next(((row.before, row.after) for row in self.rows if row.place == place and row.after), None)


def now_sentence(after: BeforeAfter, texts: Texts) -> str:
    """The error now, here and at the second place, and that expected over the work; empty if no run followed."""

    def change(key: str, before_um: float, after_um: float, u_um: float) -> str:
        return texts(key, before=micrometres(before_um), after=micrometres(after_um), u=micrometres(u_um))

    if after.driven is None:
        return ""
    keys = ((f"is_now_{after.way}", after.driven), ("is_now_elsewhere", after.elsewhere))
    sentences = [change(key, pair[0].um, pair[1].um, pair[1].u_um) for key, pair in keys if pair]
    if work := after.work:
        sentences.append(change("over_the_work", work.before_um, work.after_um, work.u_um))
        sentences.append(texts.not_known(work.unknown))
    return joined(sentences)


def now_blocks(after: BeforeAfter, texts: Texts) -> list[Block]:
    own = texts(f"your_programs_{after.way}") if after.own_programs else ""
    blocks: list[Block] = [
        Sentence(now_sentence(after, texts), "strong"), Sentence(joined([texts("arm_unchanged"), own])),
    ]  # fmt: skip
    blocks += [Command(after.own_programs)] if own else []
    if after.verdict and after.verdict.judged:
        blocks.append(verdict_blocks(after.verdict, texts, texts("corrected_now")))
    return blocks


def path_blocks(after: BeforeAfter, texts: Texts) -> list[Block]:
    is_driven = after.driven is not None
    lines = [texts("about_before_after")] if is_driven else [after.correction, texts("about_before_after")]
    if after.joined and after.judged:
        before, model = map(micrometres, after.judged)
        lines.append(texts("second_place_joined", count=after.joined, before=before, after=model))
    keys = ("error_before", "error_after", "error_expected") if is_driven else ("error",)
    rows = []
    for row in after.rows:
        cells = (_measured(row.before, texts), _measured(row.after, texts), _expected(row.expected, texts))
        rows.append((texts(f"place_{row.place}"), *cells[: len(keys)]))
    table = Table([*map(texts, ("driven_where", *keys))], rows, key="stack")
    head = Heading(texts("before_after" if is_driven else "path_error"))
    return [head, *paragraphs(lines), *([table] if rows else [])]


def _measured(error: Deviation | None, texts: Texts) -> str:
    if error is None:
        return "–"
    um, u = round(error.um, 1), round(error.u_um, 1)
    return texts.counted("rms_and_largest", error.runs, um=um, u=u, largest=round(error.largest_um))


def _expected(error: Expected | None, texts: Texts) -> str:
    if error is None or error.u_um is None:
        return "–" if error is None else texts("rms_without_u", um=round(error.um, 1))
    return texts("rms_and_u_of", um=round(error.um, 1), u=round(error.u_um, 1))

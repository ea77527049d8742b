"""Verdict on accuracy: figures compared with limits, of which the worst decides, and the error before and after a
correction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import yaml

from analysis.api import Result
from analysis.apps.report.blocks import Block, Cell, Command, Heading, Row, Sentence, Table, paragraphs
from analysis.apps.report.diagnosis_words import micrometres
from analysis.apps.report.summary_words import Summary
from analysis.apps.report.texts import Texts, joined
from analysis.correction.deviation import Deviation, Expected, Side, Work
from analysis.diagnosis.judge.result import Diagnosis
from analysis.diagnosis.judge.verdict import JudgedFigure, judged_figures
from analysis.procedures.shared.test_kind import labels_of
from analysis.runs.tables import TESTS
from rigs.schema.limits import COVERAGE, Limits, Standing
from rigs.schema.vocabulary import TestName

Overall = Standing | Literal["unjudged"]


@dataclass(frozen=True)
class PageVerdict:
    overall: Overall
    """Standing by the tolerance given to the diagnosis, otherwise the worst one."""
    judged: tuple[JudgedFigure, ...]
    """Figures, worst first."""
    tests: tuple[TestName, ...]
    by_tolerance: bool = False


def judge(results: Sequence[Result], limits: Limits, diagnosis: Diagnosis | None = None) -> PageVerdict:
    judged = judged_figures(results, limits)
    tests = tuple(dict.fromkeys(result.measured.run.manifest.test for result in results))
    if diagnosis is not None and diagnosis.accuracy.limit == "tolerance" and diagnosis.accuracy.standing is not None:
        return PageVerdict(diagnosis.accuracy.standing, judged, tests, by_tolerance=True)
    return PageVerdict(judged[0].standing if judged else "unjudged", judged, tests)


def verdict_blocks(verdict: PageVerdict, texts: Texts, when: str = "") -> Sentence:
    """when: phrase before the standing."""
    standing = joined([when, texts(f"standing_{verdict.overall}")])
    return Sentence(verdict_sentence(verdict, texts), verdict.overall, standing)


def verdict_sentence(verdict: PageVerdict, texts: Texts) -> str:
    if verdict.by_tolerance:
        return texts("verdict_tolerance")
    if verdict.overall == "unjudged":
        return texts("verdict_unjudged", tests=", ".join(texts.test(test) for test in verdict.tests))
    if verdict.overall == "pass":
        return texts("verdict_pass", count=len(verdict.judged))
    bad = [figure for figure in verdict.judged if figure.standing == verdict.overall]
    worst = bad[0]
    # The limit that failed, or the limits around the figure, and a remark if the uncertainty reaches across one
    bounds = {"watch_above": None if worst.standing == "fail" else worst.limit.watch, "fail_above": worst.limit.fail}
    limits = [f"{texts(key)} {bound:g} {worst.figure.sign}" for key, bound in bounds.items() if bound is not None]
    limits += [texts("not_proven")] if worst.straddled else []
    figure = texts("bad_figure", figure=figure_title(worst, texts), value=worst.figure, limits=", ".join(limits))
    key = f"verdict_{verdict.overall}{'_single' * (len(bad) == 1)}"
    return texts(key, bad=len(bad), count=len(verdict.judged), worst=figure)


def limits_blocks(verdict: PageVerdict, texts: Texts, heading: str) -> list[Block]:
    rows = list[Row]()
    for one in verdict.judged:
        watch, fail = (
            "" if bound is None else f"{bound:g} {one.figure.sign}" for bound in (one.limit.watch, one.limit.fail)
        )
        source = texts("data_sheet") if one.of_data_sheet else ""
        remark = texts("not_proven") if one.straddled and one.standing == "watch" else ""
        standing = Cell(texts(f"standing_{one.standing}"), (remark,), tone=one.standing)
        rows.append((figure_title(one, texts), str(one.figure), watch, Cell(fail, (source,)), standing))
    columns = [*map(texts, ("figure", "value", "watch_above", "fail_above", "standing"))]
    table = Table(columns, rows, {1, 2, 3}, key="stack")
    rule = Sentence(texts("rule", coverage=f"{COVERAGE:g}"), "note")
    return [Heading(texts(heading)), table, rule] if rows else []


def figure_title(figure: JudgedFigure, texts: Texts) -> str:
    direction = texts("acw_against_cw") if figure.column.kind == "pairs" else figure.column.direction
    return f"{joined([texts.test(figure.test), direction])}: {texts.whole_label(figure.name)}"


def example_limits(verdict: PageVerdict) -> str:
    """Limits section of a rig file for the tests made, with bounds to replace."""
    bounds = {
        test: {name: {"watch": watch, "fail": fail}}
        for test in TESTS
        if test in verdict.tests and test in Limits.model_fields and (example := labels_of(test).example)
        for name, watch, fail in [example]
    }
    return yaml.safe_dump({"limits": bounds}, sort_keys=False, default_flow_style=None) if bounds else ""


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
    """Command that corrects programs of the user, or converts those with taught points after values were entered."""
    verdict: PageVerdict | None = None
    summary: Summary | None = None
    """Headline and tiles for the corrected robot; None for those of the diagnosis."""

    @property
    def driven(self) -> tuple[Deviation, Deviation] | None:
        return self.at("same")

    def at(self, place: str) -> tuple[Deviation, Deviation] | None:
        return next(((row.before, row.after) for row in self.rows if row.place == place and row.after), None)


def now_sentence(after: BeforeAfter, texts: Texts) -> str:
    """The error now, here and at the second place, and that expected over the work; empty if no run followed."""

    if after.driven is None:
        return ""
    pairs = {f"is_now_{after.way}": after.driven, "is_now_elsewhere": after.at("elsewhere")}
    changes = {key: (pair[0].um, pair[1].um, pair[1].u_um) for key, pair in pairs.items() if pair}
    if work := after.work:
        changes["over_the_work"] = work.before_um, work.after_um, work.u_um
    sentences = []
    for key, errors_um in changes.items():
        before, reached, u = map(micrometres, errors_um)
        sentences.append(texts(key, before=before, after=reached, u=u))
    return joined([*sentences, texts.not_known(work.unknown) if work else ""])


def now_blocks(after: BeforeAfter, texts: Texts) -> list[Block]:
    blocks: list[Block] = [Sentence(now_sentence(after, texts), "strong"), *own_program_blocks(after, texts)]
    if after.verdict and after.verdict.judged:
        blocks.append(verdict_blocks(after.verdict, texts, texts("corrected_now")))
    return blocks


def own_program_blocks(after: BeforeAfter, texts: Texts) -> list[Block]:
    """What to do with other programs of the user after a correction, with the command."""
    return [Sentence(texts(f"your_programs_{after.way}")), Command(after.own_programs)] if after.own_programs else []


def path_blocks(after: BeforeAfter, texts: Texts) -> list[Block]:
    is_driven = after.driven is not None
    lines = ["" if is_driven else after.correction, texts("about_before_after")]
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
    return "–" if error is None else texts.counted("rms_and_largest", error.runs, error=error)


def _expected(error: Expected | None, texts: Texts) -> str:
    if error is None:
        return "–"
    return texts("rms_without_u" if error.u_um is None else "rms_and_u_of", error=error)

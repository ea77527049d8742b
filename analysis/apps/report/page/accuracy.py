"""Verdict on accuracy: figures compared with limits; the worst standing decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import yaml

from analysis.api import Diagnosis, Result
from analysis.apps.report.blocks import Block, Cell, Heading, Row, Sentence, Table
from analysis.apps.report.texts import Texts, joined, whole_label
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
    return Sentence(
        verdict_sentence(verdict, texts), verdict.overall, joined([when, texts(f"standing_{verdict.overall}")])
    )


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
    watch = None if worst.standing == "fail" else worst.limit.watch
    bounds = (("watch_above", watch), ("fail_above", worst.limit.fail))
    limits = [f"{texts(key)} {bound:g} {worst.figure.sign}" for key, bound in bounds if bound is not None]
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
        source = (texts("data_sheet"),) if one.of_data_sheet else ()
        remark = (texts("not_proven"),) if one.straddled and one.standing == "watch" else ()
        standing = Cell(texts(f"standing_{one.standing}"), remark, tone=one.standing)
        rows.append((figure_title(one, texts), str(one.figure), watch, Cell(fail, source), standing))
    columns = tuple(map(texts, ("figure", "value", "watch_above", "fail_above", "standing")))
    table = Table(columns, rows, {1, 2, 3}, key="stack")
    rule = Sentence(texts("rule", coverage=f"{COVERAGE:g}"), "note")
    return [Heading(texts(heading)), table, rule] if rows else []


def figure_title(figure: JudgedFigure, texts: Texts) -> str:
    direction = texts("acw_against_cw") if figure.column.kind == "pairs" else figure.column.direction
    return f"{joined([texts.test(figure.test), direction])}: {whole_label(figure.name, texts.label)}"


def example_limits(verdict: PageVerdict) -> str:
    """Limits section of a rig file for the tests made, with bounds to replace."""
    bounds = {
        test: {name: {"watch": watch, "fail": fail}}
        for test in TESTS
        if test in verdict.tests and test in Limits.model_fields and (example := labels_of(test).example)
        for name, watch, fail in [example]
    }
    return yaml.safe_dump({"limits": bounds}, sort_keys=False, default_flow_style=None) if bounds else ""

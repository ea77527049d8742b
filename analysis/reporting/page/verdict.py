"""The verdict on accuracy: every figure that has a limit, decided with its uncertainty, and the worst of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import yaml

from analysis.inference.result import Diagnosis
from analysis.inference.verdict import JudgedFigure, judged_figures
from analysis.measures.pooled import FigureColumn
from analysis.measures.results import Result
from analysis.reporting.labels import whole_label
from analysis.reporting.texts import Texts
from analysis.traces.kind import kinds
from rigs.schema.limits import COVERAGE, Limits, Standing
from rigs.schema.vocabulary import TestName

Overall = Standing | Literal["unjudged"]
_MOST_NAMED = 3


@dataclass(frozen=True)
class Verdict:
    """overall: that of the tolerance which a diagnosis was given, else the worst standing, `unjudged` without limits;
    judged: the worst first; tests: those that were made; by_tolerance: whether a tolerance decided."""

    overall: Overall
    judged: tuple[JudgedFigure, ...]
    tests: tuple[TestName, ...]
    by_tolerance: bool = False

    def with_standing(self, standing: Overall) -> list[JudgedFigure]:
        """The figures that stand so."""
        return [figure for figure in self.judged if figure.standing == standing]


def judge(results: Sequence[Result], limits: Limits, diagnosis: Diagnosis | None = None) -> Verdict:
    """The verdict on runs by the limits of a rig file, or by the tolerance that a diagnosis of them was given."""
    judged = judged_figures(results, limits)
    tests = tuple(dict.fromkeys(result.measured.run.manifest.test for result in results))
    if diagnosis is not None and diagnosis.accuracy.limit == "tolerance" and diagnosis.accuracy.standing is not None:
        return Verdict(diagnosis.accuracy.standing, judged, tests, by_tolerance=True)
    return Verdict(judged[0].standing if judged else "unjudged", judged, tests)


def verdict_sentence(verdict: Verdict, texts: Texts) -> str:
    """Why the verdict is what it is, in one sentence."""
    if verdict.by_tolerance:
        return texts("why_tolerance")
    if verdict.overall == "unjudged":
        return texts("why_unjudged", tests=", ".join(texts.test(test) for test in verdict.tests))
    if verdict.overall == "pass":
        return texts("why_pass", count=len(verdict.judged))
    bad = verdict.with_standing(verdict.overall)
    worst = [
        texts("bad_figure", figure=named(figure, texts), value=figure.figure, limits=_bounds(figure, texts))
        for figure in bad[:_MOST_NAMED]
    ]
    ending = [texts("and_more", count=len(bad) - len(worst))] if len(bad) > len(worst) else []
    numbers = {"bad": len(bad), "count": len(verdict.judged), "worst": "; ".join([*worst, *ending])}
    return texts(f"why_{verdict.overall}", **numbers)


def named(figure: JudgedFigure, texts: Texts) -> str:
    """What a figure is of, and its label."""
    title = title_of(figure.column, texts)
    of = texts.test(figure.test) + (f" {title}" if title else "")
    return f"{of}: {whole_label(figure.name, texts.label)}"


def example_limits(verdict: Verdict) -> str:
    """The lines of a rig file by which a figure of each test is judged, with bounds to be replaced; none of tests that
    have no limits there."""
    bounds = {
        kind.test: {name: {"watch": watch, "fail": fail}}
        for kind in kinds()
        if kind.test in verdict.tests and kind.example and kind.test in Limits.model_fields
        for name, watch, fail in [kind.example]
    }
    return yaml.safe_dump({"limits": bounds}, sort_keys=False, default_flow_style=None) if bounds else ""


def _bounds(figure: JudgedFigure, texts: Texts) -> str:
    """The limit that a figure fails, or those between which it is, and that its uncertainty reaches over one."""
    watch = None if figure.standing == "fail" else figure.limit.watch
    bounds = (("watch_above", watch), ("fail_above", figure.limit.fail))
    words = [f"{texts(key)} {bound:g} {figure.figure.sign}" for key, bound in bounds if bound is not None]
    return ", ".join([*words, *([texts("not_proven")] if figure.straddled else [])])


def rule(texts: Texts) -> str:
    """The decision rule in words."""
    return texts("rule", coverage=f"{COVERAGE:g}")


def title_of(column: FigureColumn, texts: Texts) -> str:
    """What a column is of: a direction, or both against each other; empty where the test has no direction."""
    return texts("acw_against_cw") if column.kind == "pairs" else column.direction

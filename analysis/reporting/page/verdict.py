"""The verdict: every figure that has a limit, decided with its uncertainty, and the worst of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import yaml

from analysis.diagnosis.diagnosis import Diagnosis
from analysis.measures.quantity import Quantity
from analysis.measures.results import Result, by_test
from analysis.reporting.labels import whole_label
from analysis.reporting.page.columns import columns_of
from analysis.reporting.page.texts import Texts
from rigs.schema.limits import COVERAGE, Limit, Limits, Standing
from rigs.schema.vocabulary import TestName

Overall = Standing | Literal["unjudged"]
_WORST: tuple[Standing, ...] = ("fail", "watch", "pass")
_MOST_NAMED = 3
_EXAMPLES: dict[TestName, tuple[str, float, float]] = {
    "yaw": ("circular_deviation_mm", 0.05, 0.10),
    "roll": ("circular_deviation_mm", 0.05, 0.10),
    "radial": ("band_mm", 0.2, 0.3),
    "repeatability": ("bi_mm", 0.05, 0.10),
    "pose": ("rms_mm", 0.5, 1.0),
}
"""A figure of each test, and bounds of the size of those in docs/rig-file.md: examples, to be replaced."""


@dataclass(frozen=True)
class Judged:
    """A figure of a test against its limit. straddled: the uncertainty reaches over a bound."""

    test: str
    title: str
    name: str
    figure: Quantity
    limit: Limit
    standing: Standing
    straddled: bool
    of_data_sheet: bool

    def named(self, texts: Texts) -> str:
        """What the figure is of, and its label."""
        of = texts(f"test_{self.test}") + (f" {self.title}" if self.title else "")
        return f"{of}: {whole_label(self.name, texts.label)}"

    @property
    def excess(self) -> float:
        """Size of the figure in units of its last bound, by which the worst comes first."""
        bound = self.limit.fail if self.limit.fail is not None else self.limit.watch
        return abs(self.figure.value) / (bound or 1.0)


@dataclass(frozen=True)
class Verdict:
    """overall: the worst standing, `unjudged` without limits; judged: the worst first; fault: a diagnosis found one,
    which is to be watched where no limit fails; tests: those that were made."""

    overall: Overall
    judged: tuple[Judged, ...]
    fault: bool
    tests: tuple[TestName, ...]

    def with_standing(self, standing: Standing) -> list[Judged]:
        """The figures that stand so."""
        return [one for one in self.judged if one.standing == standing]


def judge(results: Sequence[Result], limits: Limits, found: Diagnosis | None, texts: Texts) -> Verdict:
    """The verdict on runs by the limits of a rig file, and by what a diagnosis found beside them."""
    judged: list[Judged] = []
    for group in by_test(results):
        test = group[0].measured.run.manifest.test
        for column in columns_of(group, texts):
            for name, figure in column.figures.items():
                if (limit := limits.of(test, name)) is not None:
                    standing, straddled = (
                        limit.standing(figure.value, figure.u),
                        limit.straddled(figure.value, figure.u),
                    )
                    sheet = limits.from_data_sheet(test, name)
                    judged.append(Judged(test, column.title, name, figure, limit, standing, straddled, sheet))
    judged.sort(key=lambda one: (_WORST.index(one.standing), -one.excess))
    fault = found is not None and found.condition in ("named", "ambiguous", "outside_library")
    overall: Overall = judged[0].standing if judged else "unjudged"
    tests = tuple(dict.fromkeys(result.measured.run.manifest.test for result in results))
    return Verdict("watch" if fault and overall != "fail" else overall, tuple(judged), fault, tests)


def verdict_sentence(verdict: Verdict, texts: Texts) -> str:
    """Why the verdict is what it is, in one sentence."""
    if not verdict.judged:
        tests = ", ".join(texts(f"test_{test}") for test in verdict.tests)
        return texts("why_fault_unjudged" if verdict.fault else "why_unjudged", tests=tests)
    bad = verdict.with_standing(verdict.overall) if verdict.overall != "unjudged" else []
    if not bad:
        return texts("why_fault", count=len(verdict.judged))
    if verdict.overall == "pass":
        return texts("why_pass", count=len(verdict.judged))
    worst = [
        texts("bad_figure", figure=one.named(texts), value=one.figure, limits=_bounds(one, texts))
        for one in bad[:_MOST_NAMED]
    ]
    more = [texts("and_more", count=len(bad) - len(worst))] if len(bad) > len(worst) else []
    numbers = {"bad": len(bad), "count": len(verdict.judged), "worst": "; ".join([*worst, *more])}
    return texts(f"why_{verdict.overall}", **numbers)


def example_limits(verdict: Verdict) -> str:
    """The lines of a rig file by which a figure of each test is judged, with bounds to be replaced."""
    bounds = {
        test: {name: {"watch": watch, "fail": fail}}
        for test, (name, watch, fail) in _EXAMPLES.items()
        if test in verdict.tests
    }
    return yaml.safe_dump({"limits": bounds}, sort_keys=False, default_flow_style=None)


def _bounds(one: Judged, texts: Texts) -> str:
    """The limit that a figure fails, or those between which it is, and that its uncertainty reaches over one."""
    watch = None if one.standing == "fail" else one.limit.watch
    bounds = (("watch_above", watch), ("fail_above", one.limit.fail))
    words = [f"{texts(key)} {bound:g} {one.figure.sign}" for key, bound in bounds if bound is not None]
    return ", ".join([*words, *([texts("not_proven")] if one.straddled else [])])


def rule(texts: Texts) -> str:
    """The decision rule in words."""
    return texts("rule", coverage=f"{COVERAGE:g}")

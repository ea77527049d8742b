"""All that the page is made of, gathered once: results, measured beside simulated, the diagnosis, and what a correction
did: what the error was, is, was expected to be, and over the work; and the verdict on accuracy: every figure that has a
limit, decided with its uncertainty, and the worst of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import yaml

from analysis.api import Compared, Diagnosis, Result, RigError, diagnose
from analysis.correction.deviation import Deviation, Side, Work
from analysis.diagnosis.judge.compare_runs import compare
from analysis.diagnosis.judge.verdict import JudgedFigure, judged_figures
from analysis.procedures.facts import labels_of
from analysis.procedures.pooled import FigureColumn
from analysis.report.diagnosis_report import calibration_file
from analysis.report.texts import Texts, whole_label
from analysis.runs.parts_of_tests import TESTS
from analysis.runs.table_format import format_of
from rigs.errors import FileError
from rigs.rig import Rig
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
    worst = []
    for figure in bad[:_MOST_NAMED]:
        # The limit that it fails, or those between which it is, and that its uncertainty reaches over one
        watch = None if figure.standing == "fail" else figure.limit.watch
        bounds = (("watch_above", watch), ("fail_above", figure.limit.fail))
        limits = [f"{texts(key)} {bound:g} {figure.figure.sign}" for key, bound in bounds if bound is not None]
        limits += [texts("not_proven")] if figure.straddled else []
        values = {"figure": named(figure, texts), "value": figure.figure, "limits": ", ".join(limits)}
        worst.append(texts("bad_figure", **values))
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
        test: {name: {"watch": watch, "fail": fail}}
        for test in TESTS
        if test in verdict.tests and test in Limits.model_fields and (example := labels_of(test).example)
        for name, watch, fail in [example]
    }
    return yaml.safe_dump({"limits": bounds}, sort_keys=False, default_flow_style=None) if bounds else ""


def rule(texts: Texts) -> str:
    """The decision rule in words."""
    return texts("rule", coverage=f"{COVERAGE:g}")


def title_of(column: FigureColumn, texts: Texts) -> str:
    """What a column is of: a direction, or both against each other; empty where the test has no direction."""
    return texts("acw_against_cw") if column.kind == "pairs" else column.direction


@dataclass(frozen=True)
class BeforeAfter:
    """What was corrected, by what, and the error before and after on the same circle and at the other place.

    way: the tense and the words of the page follow from it. work: None where nothing was corrected. judged: what the
    other place said of the model before its runs joined the last diagnosis, µm rms before and with it; None where none
    judged. verdict: the figures of the runs afterwards against their limits, on the same circle, None where there were
    no such runs. own_programs: the command that corrects programs of the reader's own.
    """

    correction: str
    way: Literal["entries", "programs", "none"]
    rows: tuple[Side, ...]
    work: Work | None = None
    judged: tuple[float, float] | None = None
    joined: int = 0
    own_programs: str = ""
    verdict: Verdict | None = None

    @property
    def driven(self) -> tuple[Deviation, Deviation] | None:
        """The error before and after on the same circle; None where nothing was driven afterwards."""
        return next(((row.before, row.after) for row in self.rows if row.place == "same" and row.after), None)

    @property
    def elsewhere(self) -> tuple[Deviation, Deviation] | None:
        """The same at the other place."""
        return next(((row.before, row.after) for row in self.rows if row.place == "elsewhere" and row.after), None)


@dataclass(frozen=True)
class Report:
    """Runs of one robot, evaluated. rig: the model and the limits; simulated: the runs beside the model; corrected:
    beside the model with all parts that were found, None where there are none; undiagnosed: why there is no diagnosis;
    left_out: the errors of runs that could not be evaluated."""

    rig: Rig
    results: tuple[Result, ...]
    simulated: Compared | None
    corrected: Compared | None
    found: Diagnosis | None
    undiagnosed: str
    left_out: tuple[str, ...]
    after: BeforeAfter | None = None
    """What a correction did, measured on the robot."""

    @property
    def title(self) -> str:
        """The robot that was measured: the name of its rig, which no other robot has, and its type."""
        return f"{self.results[0].measured.rig.name} – {self.rig.robot.name}"


def gather(
    results: Sequence[Result],
    rig: Rig | None = None,
    *,
    diagnosed: bool = True,
    diagnosis: Diagnosis | None = None,
    left_out: Sequence[RigError] = (),
    after: BeforeAfter | None = None,
    progress: Callable[[str], None],
) -> Report:
    """Compare and diagnose runs that were evaluated. found: a diagnosis made already; diagnosed: whether to make one;
    left_out: why other runs could not be evaluated; after: what a correction did.

    Runs that cannot be compared or diagnosed are reported all the same, with the reason. Raises FileError for runs of
    several robots.
    """
    runs = [result.measured for result in results]
    model = rig if rig is not None else runs[0].rig
    # Two robots of one type differ in the names of their rigs; the model may have a rig file of its own
    for run in runs:
        if run.rig.robot.name != model.robot.name:
            problem = f"is of {run.rig.robot.name}, and the report is about {model.robot.name}"
            raise FileError(str(run.path), problem, "make a report for each robot")
        if run.rig.name != runs[0].rig.name:
            problem = f"is of rig {run.rig.name}, and the report is about rig {runs[0].rig.name}"
            raise FileError(str(run.path), problem, "make a report for each robot")
    undiagnosed = ""
    if diagnosis is None and diagnosed:
        try:
            diagnosis = diagnose(runs, rig=model, progress=progress)
        except RigError as error:
            undiagnosed = str(error)
    progress("simulating the runs")
    simulated, corrected = _compared(results, model), None
    if diagnosis is not None and diagnosis.calibrated is not None:
        with_findings = diagnosis.extended_rig.with_calibration(
            calibration_file("found.calibration.json", diagnosis.calibrated.content), diagnosis.calibrated
        )
        corrected = _compared(results, with_findings)
    return Report(model, tuple(results), simulated, corrected, diagnosis, undiagnosed, tuple(map(str, left_out)), after)


def _compared(results: Sequence[Result], rig: Rig) -> Compared | None:
    """The runs beside a model; None where it cannot be simulated beside them, as of poses."""
    runs = [result.measured for result in results if format_of(result.measured.table.test).gauges]
    try:
        return compare(runs, rig) if runs else None
    except RigError:
        return None

"""Contents of the page: results, comparison with simulation, diagnosis, effect of a correction, and verdict on
accuracy.

The verdict compares figures with limits, including the uncertainty, and takes the worst standing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import yaml

from analysis.api import Compared, Diagnosis, Result, RigError, diagnose
from analysis.apps.report.diagnosis_report import calibration_file
from analysis.apps.report.texts import Texts, whole_label
from analysis.correction.deviation import Deviation, Side, Work
from analysis.diagnosis.judge.compare_runs import compare
from analysis.diagnosis.judge.verdict import JudgedFigure, judged_figures
from analysis.procedures.facts import labels_of
from analysis.procedures.pooled import FigureColumn
from analysis.runs.table_format import TESTS, format_of
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.limits import COVERAGE, Limits, Standing
from rigs.schema.vocabulary import TestName

Overall = Standing | Literal["unjudged"]


@dataclass(frozen=True)
class PageVerdict:
    """Verdict on accuracy.

    overall: standing by the tolerance given to the diagnosis, otherwise the worst standing; `unjudged` if no limits are
    given. judged: figures, worst first. tests: the tests made. by_tolerance: whether a tolerance determined the
    verdict.
    """

    overall: Overall
    judged: tuple[JudgedFigure, ...]
    tests: tuple[TestName, ...]
    by_tolerance: bool = False

    def with_standing(self, standing: Overall) -> list[JudgedFigure]:
        """Return the figures with a given standing."""
        return [figure for figure in self.judged if figure.standing == standing]


def judge(results: Sequence[Result], limits: Limits, diagnosis: Diagnosis | None = None) -> PageVerdict:
    """Judge runs by the limits of a rig file, or by the tolerance given to their diagnosis."""
    judged = judged_figures(results, limits)
    tests = tuple(dict.fromkeys(result.measured.run.manifest.test for result in results))
    if diagnosis is not None and diagnosis.accuracy.limit == "tolerance" and diagnosis.accuracy.standing is not None:
        return PageVerdict(diagnosis.accuracy.standing, judged, tests, by_tolerance=True)
    return PageVerdict(judged[0].standing if judged else "unjudged", judged, tests)


def verdict_sentence(verdict: PageVerdict, texts: Texts) -> str:
    """Return the reason for the verdict as a sentence."""
    if verdict.by_tolerance:
        return texts("verdict_tolerance")
    if verdict.overall == "unjudged":
        return texts("verdict_unjudged", tests=", ".join(texts.test(test) for test in verdict.tests))
    if verdict.overall == "pass":
        return texts("verdict_pass", count=len(verdict.judged))
    bad = verdict.with_standing(verdict.overall)
    worst = bad[0]
    # The limit that failed, or the limits around the figure, and a remark if the uncertainty reaches across one
    watch = None if worst.standing == "fail" else worst.limit.watch
    bounds = (("watch_above", watch), ("fail_above", worst.limit.fail))
    limits = [f"{texts(key)} {bound:g} {worst.figure.sign}" for key, bound in bounds if bound is not None]
    limits += [texts("not_proven")] if worst.straddled else []
    figure = texts("bad_figure", figure=figure_title(worst, texts), value=worst.figure, limits=", ".join(limits))
    key = f"verdict_{verdict.overall}{'_single' * (len(bad) == 1)}"
    return texts(key, bad=len(bad), count=len(verdict.judged), worst=figure)


def figure_title(figure: JudgedFigure, texts: Texts) -> str:
    """Return the test, the direction and the label of a figure."""
    title = title_of(figure.column, texts)
    of = texts.test(figure.test) + (f" {title}" if title else "")
    return f"{of}: {whole_label(figure.name, texts.label)}"


def example_limits(verdict: PageVerdict) -> str:
    """Return an example of the limits section of a rig file for the tests made, with bounds to replace.

    Tests that cannot have limits are omitted.
    """
    bounds = {
        test: {name: {"watch": watch, "fail": fail}}
        for test in TESTS
        if test in verdict.tests and test in Limits.model_fields and (example := labels_of(test).example)
        for name, watch, fail in [example]
    }
    return yaml.safe_dump({"limits": bounds}, sort_keys=False, default_flow_style=None) if bounds else ""


def rule(texts: Texts) -> str:
    """Return the decision rule as text."""
    return texts("rule", coverage=f"{COVERAGE:g}")


def title_of(column: FigureColumn, texts: Texts) -> str:
    """Return the title of a column: a direction, or the comparison of both; empty for a test without directions."""
    return texts("acw_against_cw") if column.kind == "pairs" else column.direction


@dataclass(frozen=True)
class BeforeAfter:
    """A correction, and the error before and after it on the same circle and at the other place.

    way: the kind of correction, which determines the wording of the page. work: None if nothing was corrected. judged:
    rms in µm before and with the model at the other place, before the runs joined the last diagnosis; None if the model
    was not validated. joined: number of the runs that joined. verdict: figures of the runs after the correction on the
    same circle; None if these runs do not exist. own_programs: the command that corrects the user's programs.
    """

    correction: str
    way: Literal["entries", "programs", "none"]
    rows: tuple[Side, ...]
    work: Work | None = None
    judged: tuple[float, float] | None = None
    joined: int = 0
    own_programs: str = ""
    verdict: PageVerdict | None = None

    @property
    def driven(self) -> tuple[Deviation, Deviation] | None:
        """The error before and after on the same circle; None if no run followed the correction."""
        return next(((row.before, row.after) for row in self.rows if row.place == "same" and row.after), None)

    @property
    def elsewhere(self) -> tuple[Deviation, Deviation] | None:
        """The error before and after at the other place; None if that place was not measured."""
        return next(((row.before, row.after) for row in self.rows if row.place == "elsewhere" and row.after), None)


@dataclass(frozen=True)
class Report:
    """Evaluated runs of a robot.

    rig: model and limits. simulated: the runs compared with the model; corrected: with the model including the found
    parts, if any. undiagnosed: the reason for a missing diagnosis. left_out: errors of runs that could not be
    evaluated.
    """

    rig: Rig
    results: tuple[Result, ...]
    simulated: Compared | None
    corrected: Compared | None
    found: Diagnosis | None
    undiagnosed: str
    left_out: tuple[str, ...]
    after: BeforeAfter | None = None
    """Measured effect of a correction."""

    @property
    def title(self) -> str:
        """Name of the rig, which is unique, and type of the robot."""
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
    """Compare and diagnose evaluated runs.

    diagnosis: an existing diagnosis; diagnosed: whether to make one. left_out: errors of runs that could not be
    evaluated. after: measured effect of a correction.

    Runs that cannot be compared or diagnosed are reported with the reason. Raises FileError for runs of several robots.
    """
    runs = [result.measured for result in results]
    model = rig if rig is not None else runs[0].rig
    # Two robots of one type differ in rig names; the model may come from a separate rig file
    for run in runs:
        if run.rig.robot.name != model.robot.name:
            problem = f"is of {run.rig.robot.name}, and the report is about {model.robot.name}"
            raise FileError(str(run.path), problem, "make a report for each robot", code="report.other_robot")
        if run.rig.name != runs[0].rig.name:
            problem = f"is of rig {run.rig.name}, but the report is about rig {runs[0].rig.name}"
            raise FileError(str(run.path), problem, "make a report for each robot", code="report.other_robot")
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
    """Compare runs with a model; None if the runs cannot be simulated, such as poses."""
    runs = [result.measured for result in results if format_of(result.measured.table.test).gauges]
    try:
        return compare(runs, rig) if runs else None
    except RigError:
        return None
